"""A click that corrects a selection: what is around the pixel changes sides.

The click stands in the middle of what is wrong, so its distance from the selection's outline tells how wide that is
about. How far it reaches is searched on the surface graph: the cheaper it is for Gaussians to change sides, the more of
them follow the clicked ones. The best region is well separated from the rest and about as wide as the click says.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray
from gaussian_trimmer.geometry.graphs import distance_to_outside
from gaussian_trimmer.selecting.marks import Effect
from gaussian_trimmer.selecting.selection import Seed
from gaussian_trimmer.surface.surface_graph import SurfaceCut, SurfaceGraph, build_surface_graph
from gaussian_trimmer.surface.viewed_scene import ViewedScene

_COSTS = np.geomspace(0.05, 25.0, 14)
"""Costs of changing sides to try, by area in squared radii."""
_CERTAIN_COST = 1e4
"""Cost that no cut pays."""
_COLOUR_WEIGHT = 2.0
"""Weight of the colours' log-likelihood ratio, relative to that cost."""
_COLOUR_ROUNDS = 2
_SEED_RADIUS = 0.5
"""Radius around a click of what certainly changes sides, relative to its distance from the outline."""
_MIN_SEED_RADIUS = 0.02
"""Smallest such radius, in radii of the graph."""
_WIDTH_SPREAD = 0.7
"""How fast the score falls with the logarithm of the ratio of found and expected width."""
_MAX_WIDTH = 3.0
"""Width of a region, relative to the expected one, up to which nothing speaks against it but its shape."""
_LEAST_CONTRAST = 0.1
"""What is added to the contrast of a region's boundary, since an object's parts may join smoothly."""
_EXTENT_QUANTILES = (0.05, 0.95)
_DISJOINT_SHARE = 0.1
"""A thing of which a smaller share than this is selected is added as a whole."""
_SELECTED_SHARE = 0.5
"""A thing of which a larger share than this is selected is removed as a whole, where others are selected too."""
_OTHERS_SHARE = 0.2
"""Others are selected too if the rest of the selection is more than this, relative to the thing."""


def expected_radius(shown: BoolArray, x: int, y: int, depth: float, camera: Camera) -> float:
    """Return half the width of the wrong region that a pixel is the middle of, in scene units.

    Args:
        shown: where the selection is visible, (H, W).
        depth: of the surface at the pixel.
    """
    same = shown if shown[y, x] else ~shown
    pixels = distance_to_outside(same, beyond=not shown[y, x])[y, x]
    return float(max(pixels, 1.0)) * depth / float(camera.K[0, 0])


def correct_at_click(scene: ViewedScene, selection: BoolArray, seed: Seed, earlier: Sequence[Seed]) -> BoolArray:
    """Return the selection (N,) after the region around a seed has changed sides.

    Args:
        scene: the scene in the view of the click.
        selection: before the click, (N,); it may be empty.
        seed: the clicked point, with the radius that is expected of the region.
        earlier: seeds of earlier clicks, which keep their sides.
    """
    everything = np.ones(len(selection), np.bool_)
    radius = _graph_radius(scene.gaussians.means, selection, seed)
    graph = build_surface_graph(scene, seed.point, radius, everything)
    best = _best_region(graph, selection[graph.rows], seed, earlier) if graph is not None else None
    result = selection.copy()
    if graph is None or best is None:  # there is no surface to follow
        result[np.linalg.norm(scene.gaussians.means - seed.point, axis=1) < seed.radius] = seed.inside
        return result
    changed = best != selection[graph.rows]
    result[graph.rows[changed]] = seed.inside
    result[_hidden_neighbours(scene.gaussians, graph, changed, selection, seed)] = seed.inside
    return result


def _best_region(graph: SurfaceGraph, before: BoolArray, seed: Seed, earlier: Sequence[Seed]) -> BoolArray | None:
    """Return the selected nodes (S,) after the best region has changed sides; None if none can."""
    fixed = _fixed(graph, before, seed, earlier)
    stay, certain = np.where(before, 1.0, -1.0), np.where(fixed == 1, _CERTAIN_COST, -np.inf)
    cut = SurfaceCut(graph, before, seed.inside, np.where(fixed == 0, graph.areas, 0.0), _COLOUR_ROUNDS)
    terms = ((np.where(fixed == 0, cost * stay * graph.areas, certain), _COLOUR_WEIGHT * cost) for cost in _COSTS)
    best, best_score = None, -1.0
    for part in cut.sweep(terms, lambda part: _connected(graph, before, part, seed)):
        score = cut.separation(part, _LEAST_CONTRAST) * _width_fit(graph, cut.sides(part), seed)
        if score > best_score:
            best, best_score = part, score
    return best


def _graph_radius(means: FloatArray, selection: BoolArray, seed: Seed) -> float:
    """Return the unit of the graph: about half the size of the selection, and no less than what the click is about."""
    if not selection.any():
        return 2 * seed.radius
    low, high = np.quantile(means[selection].astype(np.float64), _EXTENT_QUANTILES, axis=0)
    return max(float(np.linalg.norm(high - low)) / 2, 2 * seed.radius)


def _fixed(graph: SurfaceGraph, before: BoolArray, seed: Seed, earlier: Sequence[Seed]) -> IntArray:
    """Return which nodes are certainly inside (1), certainly outside (-1), or free (0), (S,)."""
    fixed = np.where(before == seed.inside, 1 if seed.inside else -1, 0)
    for place in (*earlier, seed):
        distance = np.linalg.norm(graph.means - place.point, axis=1)
        near = distance < max(_SEED_RADIUS * place.radius, _MIN_SEED_RADIUS * graph.radius)
        if place is seed:
            near[np.argmin(distance)] = True
        fixed[near] = 1 if place.inside else -1
    return fixed


def _connected(graph: SurfaceGraph, before: BoolArray, part: BoolArray, seed: Seed) -> BoolArray:
    """Return the part, where only the piece of what changed sides that lies at the seed has changed them, (S,)."""
    rows, piece = graph.pieces(part != before)
    if len(rows) == 0:
        return part
    at_seed = piece[np.argmin(np.linalg.norm(graph.means[rows] - seed.point, axis=1))]
    result = before.copy()
    result[rows[piece == at_seed]] = seed.inside
    return result


def _width_fit(graph: SurfaceGraph, sides: tuple[BoolArray, BoolArray], seed: Seed) -> float:
    """Return how well the width of what changed sides fits the click, 0 to 1."""
    changed, others = sides
    if not changed.any() or not others.any():
        return 0.0
    expected = seed.radius / graph.radius
    distance = float(np.linalg.norm(graph.means[others] - seed.point, axis=1).min()) / graph.radius
    too_near = min(0.0, np.log(max(distance, 1e-6) / expected))
    area = float(graph.areas[changed].sum())
    too_wide = max(0.0, 0.5 * np.log(area / (np.pi * (_MAX_WIDTH * expected) ** 2)))
    return float(np.exp(-0.5 * (too_near**2 + too_wide**2) / _WIDTH_SPREAD**2))


def _hidden_neighbours(
    gaussians: Gaussians, graph: SurfaceGraph, changed: BoolArray, selection: BoolArray, seed: Seed
) -> IntArray:
    """Return rows of hidden Gaussians that follow the nearest nodes to the other side."""
    hidden = graph.hidden[selection[graph.hidden] != seed.inside]
    # Of the nodes around, those count that are on the side that the Gaussian is on, or were.
    comparable = changed | (selection[graph.rows] != seed.inside)
    return graph.followers(gaussians, changed, comparable, hidden)


def is_meant_whole(piece: BoolArray, selected: BoolArray, effect: Effect) -> bool:
    """Tell whether a click adds, or removes, a whole thing (N,), by what of it and beside it is selected, (N,)."""
    size, ours, rest = (int(np.count_nonzero(rows)) for rows in (piece, piece & selected, selected & ~piece))
    if effect == "add":
        return ours < _DISJOINT_SHARE * size
    return ours > _SELECTED_SHARE * size and rest > _OTHERS_SHARE * size
