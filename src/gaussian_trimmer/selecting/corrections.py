"""A click that moves the boundary of a selection: what is around the pixel changes sides.

The click stands in the middle of what is wrong, so its distance from the selection's outline tells how wide that is
about. How far it reaches is searched on the surface graph: the cheaper it is made for Gaussians to change sides, the
more of them follow the clicked ones. Of the regions that come off in this way, the best one has a short boundary along
concave edges and changes of colour, and is about as wide as the click says.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.geometry.components import connected_points
from gaussian_trimmer.geometry.distances import distance_to_outside
from gaussian_trimmer.geometry.kd_tree import nearest
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.selecting.propagation import MIN_NODES, colour_weight
from gaussian_trimmer.selecting.surface_graph import SurfaceGraph, build_surface_graph
from gaussian_trimmer.views import HALF

_INERTIA = np.geomspace(0.05, 25.0, 14)
"""Costs of changing sides to try, by area in squared radii."""
_CERTAIN = 1e4
"""Cost that no cut pays."""
_COLOUR = 2.0
"""Weight of the colours' log-likelihood ratio, relative to that cost."""
_COLOUR_ROUNDS = 2
_SEED = 0.5
"""Radius around a click of what certainly changes sides, relative to its distance from the outline."""
_MIN_SEED = 0.02
"""Smallest such radius, in radii of the graph."""
_SPREAD = 0.7
"""How fast the score falls with the logarithm of the ratio of found and expected width."""
_MAX_WIDTH = 3.0
"""Width of a region, relative to the expected one, up to which nothing speaks against it but its shape."""
_LENGTH_PENALTY = 0.25
"""How fast the score falls with the boundary's weight, relative to the root of the region's area."""
_HIDDEN_NEIGHBOURS, _HIDDEN_REACH = 4, 0.5
"""Number of nodes that a hidden Gaussian follows, and its largest distance from the nearest, in radii."""
_QUANTILES = (0.05, 0.95)


@dataclass(frozen=True, eq=False)
class Seed:
    """A place that the user said belongs to the object, or does not."""

    point: Float64Array
    """World point, (3,)."""
    radius: float
    """How far around it that holds, in scene units."""
    inside: bool


@dataclass(frozen=True, eq=False)
class Correction:
    """A selection whose boundary was moved."""

    selection: BoolArray
    """The whole selection, (N,)."""
    seed: Seed
    """What the click says."""


def expected_radius(shown: BoolArray, x: int, y: int, depth: float, camera: Camera) -> float:
    """Half the width of the wrong region that a pixel is the middle of, in scene units.

    Args:
        shown: where the selection is visible, (H, W).
        depth: of the surface at the pixel.
    """
    same = shown if shown[y, x] else ~shown
    pixels = distance_to_outside(same, beyond=not shown[y, x])[y, x]
    return float(max(pixels, 1.0)) * depth / float(camera.K[0, 0])


def move_boundary(
    gaussians: Gaussians, camera: Camera, selection: BoolArray, seed: Seed, earlier: Sequence[Seed], up: Float64Array,
    renderer: Renderer, seen_from: Sequence[Camera] = (),
) -> Correction:  # fmt: skip
    """The selection after the region around a seed has changed sides.

    Args:
        camera: the view of the click.
        selection: before the click, (N,).
        seed: the clicked point, with the radius that is expected of the region.
        earlier: seeds of earlier clicks, which keep their sides.
        up: the scene's up vector, (3,).
        seen_from: training cameras, if known: the surface is not looked at from other sides.
    """
    radius = _graph_radius(gaussians.means, selection, seed)
    everything = np.ones(len(gaussians), np.bool_)
    graph = build_surface_graph(gaussians, camera, seed.point, radius, everything, up, renderer, seen_from)
    rows = np.concatenate([graph.rows, graph.hidden])
    if len(graph.rows) < MIN_NODES:
        return Correction(_ball(gaussians, selection, seed), seed)
    before = selection[graph.rows]
    fixed = _fixed(graph, before, seed, earlier)
    best, best_score = None, -1.0
    for part in _candidates(graph, before, fixed, seed):
        score = _score(graph, before, part, seed)
        if score > best_score:
            best, best_score = part, score
    if best is None:
        return Correction(_ball(gaussians, selection, seed), seed)
    changed = best != before
    result = selection.copy()
    result[graph.rows[changed]] = seed.inside
    result[_followers(gaussians, graph, changed, selection, rows, seed)] = seed.inside
    return Correction(result, seed)


def _graph_radius(means: FloatArray, selection: BoolArray, seed: Seed) -> float:
    """The unit of the graph: about half the size of the selection, and no less than what the click is about."""
    low, high = np.quantile(means[selection].astype(np.float64), _QUANTILES, axis=0)
    return max(float(np.linalg.norm(high - low)) / 2, 2 * seed.radius)


def _ball(gaussians: Gaussians, selection: BoolArray, seed: Seed) -> BoolArray:
    """The selection after a ball around the seed has changed sides, where there is no surface to follow."""
    result = selection.copy()
    result[np.linalg.norm(gaussians.means - seed.point, axis=1) < seed.radius] = seed.inside
    return result


def _fixed(graph: SurfaceGraph, before: BoolArray, seed: Seed, earlier: Sequence[Seed]) -> IntArray:
    """Which nodes are certainly inside (1), certainly outside (-1), or free (0), (S,)."""
    fixed = np.where(before == seed.inside, 1 if seed.inside else -1, 0)
    for other in earlier:
        near = np.linalg.norm(graph.means - other.point, axis=1) < max(_SEED * other.radius, _MIN_SEED * graph.radius)
        fixed[near] = 1 if other.inside else -1
    distance = np.linalg.norm(graph.means - seed.point, axis=1)
    near = distance < max(_SEED * seed.radius, _MIN_SEED * graph.radius)
    near[np.argmin(distance)] = True
    fixed[near] = 1 if seed.inside else -1
    return fixed


def _candidates(graph: SurfaceGraph, before: BoolArray, fixed: IntArray, seed: Seed) -> Iterator[BoolArray]:
    """Selections of nodes (S,) by cuts in which it gets ever harder for a node to change sides."""
    stay = np.where(before, 1.0, -1.0)
    certain = np.where(fixed == 1, _CERTAIN, np.where(fixed == -1, -np.inf, 0.0))
    seen: set[bytes] = set()
    for inertia in _INERTIA:
        unaries = np.where(fixed == 0, inertia * stay * graph.areas, certain)
        part = graph.cut(unaries)
        for round_ in range(_COLOUR_ROUNDS + 1):
            part = _connected(graph, before, part, seed)
            if part.tobytes() in seen:
                break
            seen.add(part.tobytes())
            yield part
            if round_ == _COLOUR_ROUNDS:
                break
            ratio, accuracy = _colours(graph, before, part, seed)
            term = _COLOUR * inertia * colour_weight(accuracy) * graph.areas * ratio
            part = graph.cut(np.where(fixed == 0, unaries + (term if seed.inside else -term), certain))


def _connected(graph: SurfaceGraph, before: BoolArray, part: BoolArray, seed: Seed) -> BoolArray:
    """The part, where only the piece of what changed sides that lies at the seed has changed them, (S,)."""
    rows = np.flatnonzero(part != before)
    if len(rows) == 0:
        return part
    piece = connected_points(graph.means[rows].astype(np.float64), graph.gap)
    at_seed = piece[np.argmin(np.linalg.norm(graph.means[rows] - seed.point, axis=1))]
    result = before.copy()
    result[rows[piece == at_seed]] = seed.inside
    return result


def _colours(graph: SurfaceGraph, before: BoolArray, part: BoolArray, seed: Seed) -> tuple[Float64Array, float]:
    """Colour evidence for what changed sides, against what it was separated from."""
    others = (~before if seed.inside else before) & (part == before)
    return graph.colour_evidence(part != before, others)


def _score(graph: SurfaceGraph, before: BoolArray, part: BoolArray, seed: Seed) -> float:
    """How well what changed sides is separated from what did not, and how well its width fits the click, 0 to 1."""
    changed = part != before
    others = (~before if seed.inside else before) & ~changed
    if not changed.any() or not others.any():
        return 0.0
    across = (changed[graph.edges[:, 0]] & others[graph.edges[:, 1]]) | (
        changed[graph.edges[:, 1]] & others[graph.edges[:, 0]]
    )
    weight, length = float(graph.weights[across].sum()), float(graph.lengths[across].sum())
    _, accuracy = graph.colour_evidence(changed, others)
    area = float(graph.areas[changed].sum())
    contrast = 1 - weight / max(length, 1e-12)
    shortness = float(np.exp(-_LENGTH_PENALTY * weight / np.sqrt(area)))
    expected = seed.radius / graph.radius
    distance = float(np.linalg.norm(graph.means[others] - seed.point, axis=1).min()) / graph.radius
    too_near = min(0.0, np.log(max(distance, 1e-6) / expected))
    too_wide = max(0.0, 0.5 * np.log(area / (np.pi * (_MAX_WIDTH * expected) ** 2)))
    fit = float(np.exp(-0.5 * (too_near**2 + too_wide**2) / _SPREAD**2))
    return (0.1 + contrast) ** 2 * accuracy * shortness * fit


def _followers(
    gaussians: Gaussians, graph: SurfaceGraph, changed: BoolArray, selection: BoolArray, rows: IntArray, seed: Seed
) -> IntArray:
    """Rows of the scene that are no nodes and follow the nearest nodes to the other side."""
    rows = rows[(selection[rows] != seed.inside)]
    rows = rows[~np.isin(rows, graph.rows)]
    if len(rows) == 0:
        return rows
    squared, near = nearest(graph.means, gaussians.means[rows], min(_HIDDEN_NEIGHBOURS, len(graph.means)))
    # Of the nodes around, those count that are on the side that the Gaussian is on, or were.
    comparable = (changed | (selection[graph.rows] != seed.inside))[near]
    share = (changed[near] & comparable).sum(axis=1) / np.maximum(comparable.sum(axis=1), 1)
    return np.asarray(rows[(share > HALF) & (squared[:, 0] < (_HIDDEN_REACH * graph.radius) ** 2)])
