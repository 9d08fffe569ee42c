"""What a cut of the surface graph separates in one view: the part in a box, or the region that a click corrects.

A box says what is not meant: all that is visible outside. What is meant inside is found by cutting the graph many
times, with a growing unary term for the surface that is visible in the box: a small one separates only what hardly
hangs on the surroundings, a large one takes all that the box holds. Of all pieces that come off, the best one fills
the box, has a short boundary along concave edges and changes of colour, and has other colours than its surroundings.
Where the box shows surfaces at several depths, each depth is searched.

A click stands in the middle of what is wrong, so its distance from the selection's outline tells how wide that is
about. The cheaper it is for Gaussians to change sides, the more of them follow the clicked ones. The best region is
well separated from the rest and about as wide as the click says.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, IntArray, mask_of_rows
from gaussian_trimmer.geometry.graphs import distance_to_outside
from gaussian_trimmer.rendering import blend_values, top_contributors
from gaussian_trimmer.selecting.marks import Effect
from gaussian_trimmer.selecting.selection import Seed
from gaussian_trimmer.surface.regions import region_apart
from gaussian_trimmer.surface.surface_graph import (
    HIDDEN_UNARY,
    SurfaceCut,
    SurfaceGraph,
    axis_ends,
    build_surface_graph,
)
from gaussian_trimmer.surface.viewed_scene import CONTRIBUTORS, ViewedScene, surface_depths
from gaussian_trimmer.views.view import Box, bounding_box, box_slices

_UNARIES = np.geomspace(0.05, 1.6, 8)
"""Unary terms of the surface that is visible in the box to try, by area in squared radii."""
_COLOUR_WEIGHT = 2.0
"""Weight of the colours' log-likelihood ratio, relative to the unary term or the cost that is tried."""
_ROUNDS_IN_BOX = 3
_LATTICE_PIXELS = 16
"""Number of pixels along each side of the box at which depth is measured."""
_LAYER_GAP, _MIN_LAYER = 1.0, 0.03
"""Gap between the depths of two surfaces, in radii; smallest share of the pixels on one of them."""
_SURROUNDINGS_SHARE = 0.5
"""Width of the surroundings that are looked at, relative to the box's sides."""
_REACH_BEYOND_EDGE = 2.0
"""Factor on the reach for objects that may go on beyond the picture's edge."""
_MIN_VISIBLE_AREA = 0.02
"""Smallest area of a piece that is visible in the box, in squared radii."""
_DEPTH_RATIO = 1.5
"""Largest ratio of the depths of a piece and of the surface that it was searched on."""
_BORDER_SHARE = 0.3
"""Width of the border around the box in which pieces are drawn, relative to its larger side."""
_PIECES_PER_PASS = 16
"""Number of pieces that are drawn in one pass."""


def segment_in_box(scene: ViewedScene, box: Box) -> tuple[BoolArray, float]:
    """Find the best segment in a box (N,), and how well its box fits; nothing where nothing can be separated.

    On sides where the box reaches the picture's edge, the object may go on beyond it.

    Args:
        scene: the scene in the user's view.
        box: within the view.
    """
    gaussians, camera = scene.gaussians, scene.camera
    low, high = _limits(box, camera)
    margin = _SURROUNDINGS_SHARE * np.subtract(box[2:], box[:2])
    mask = np.zeros((camera.height, camera.width), np.bool_)
    mask[box_slices(box)] = True
    outside, inside = scene.label_weights(mask)
    allowed = _between(gaussians.means, camera, low, high) & (inside >= outside)
    unseen = np.flatnonzero(allowed & (inside <= 0))
    for ends in axis_ends(gaussians.select(unseen)):
        allowed[unseen] &= _between(ends, camera, low, high)
    candidates = _between(gaussians.means, camera, low - margin, high + margin)
    reach = _REACH_BEYOND_EDGE if np.isinf([low, high]).any() else 1.0
    best, best_overlap, best_score = np.zeros(len(gaussians), np.bool_), 0.0, -1.0
    for centre, radius in _surfaces(scene, box):
        graph = build_surface_graph(scene, centre, radius, candidates, reach)
        if graph is None:
            continue
        nothing = np.zeros(len(graph.rows), np.bool_)
        cut = SurfaceCut(graph, nothing, True, graph.areas, _ROUNDS_IN_BOX)
        parts = _pieces(cut, allowed[graph.rows], camera)
        for part, overlap in zip(parts, _overlaps(scene, box, graph, parts), strict=True):
            score = overlap**2 * cut.separation(part)
            if score > best_score:
                best, best_overlap, best_score = graph.with_hidden(gaussians, part, allowed), overlap, score
    return best, best_overlap


def fills(mask: BoolArray, box: Box) -> float:
    """Return the intersection over union of a mask's bounding box and a box; zero for an empty mask.

    >>> fills(np.array([[True, True, False]]), (1, 0, 3, 1))
    0.3333333333333333
    """
    if not mask.any():
        return 0.0
    own = bounding_box(mask)
    width, height = (min(own[k + 2], box[k + 2]) - max(own[k], box[k]) for k in (0, 1))
    shared = max(width, 0) * max(height, 0)
    areas = [(one[2] - one[0]) * (one[3] - one[1]) for one in (own, box)]
    return shared / (sum(areas) - shared)


def _pieces(cut: SurfaceCut, allowed: BoolArray, camera: Camera) -> list[BoolArray]:
    """Return all connected pieces of all cuts, each once, (S,) each."""
    graph = cut.graph
    visible = allowed & graph.visible_in_view
    depths = camera.project(graph.means.astype(np.float64))[1]
    surface_depth = float(camera.to_camera(graph.centre[None])[0, 2])
    terms = (
        (np.where(allowed, graph.areas * np.where(visible, unary, HIDDEN_UNARY), -np.inf), _COLOUR_WEIGHT * unary)
        for unary in _UNARIES
    )
    found: dict[bytes, BoolArray] = {}
    for chosen in cut.sweep(terms):
        rows, piece = graph.pieces(chosen)
        areas = np.bincount(piece, graph.areas[rows] * visible[rows])
        for number in np.flatnonzero(areas > _MIN_VISIBLE_AREA):
            part = mask_of_rows(rows[piece == number], len(allowed))
            if 1 / _DEPTH_RATIO < np.median(depths[part & visible]) / surface_depth < _DEPTH_RATIO:
                found.setdefault(part.tobytes(), part)
    return list(found.values())


def _overlaps(scene: ViewedScene, box: Box, graph: SurfaceGraph, parts: Sequence[BoolArray]) -> list[float]:
    """Return the intersection over union of the box and the bounding box of each visible part, (P,)."""
    cropped, box = _cropped(scene.camera, box)
    overlaps = []
    for start in range(0, len(parts), _PIECES_PER_PASS):
        some = parts[start : start + _PIECES_PER_PASS]
        values = np.zeros((len(scene.gaussians), len(some)), np.float32)
        values[graph.rows] = np.stack(some, axis=1)
        shown = blend_values(scene.gaussians, cropped, values) > 0.5
        overlaps += [fills(shown[..., k], box) for k in range(len(some))]
    return overlaps


def _surfaces(scene: ViewedScene, box: Box) -> list[tuple[Float64Array, float]]:
    """Return the middle of a box (3,), and half its larger side, at each depth at which it shows a surface."""
    camera = scene.camera
    x0, y0, x1, y1 = box
    columns, rows = (np.linspace(low, high - 1, _LATTICE_PIXELS).astype(np.int64) for low, high in ((x0, x1), (y0, y1)))
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    contributors = top_contributors(scene.gaussians, camera, pixels, CONTRIBUTORS)
    depths = np.sort(surface_depths(scene.gaussians, camera, *contributors))
    depths = depths[np.isfinite(depths)]
    half = max(x1 - x0, y1 - y0) / 2 / camera.K[0, 0]
    ray = camera.ray_directions(np.array([[x0 + x1, y0 + y1]]) / 2)[0]
    ray /= ray @ camera.forward
    ends = np.flatnonzero(np.diff(depths) > _LAYER_GAP * half * depths[:-1]) + 1
    layers = [layer for layer in np.split(depths, ends) if len(layer) >= max(1.0, _MIN_LAYER * len(depths))]
    return [(camera.centre + ray * np.median(layer), float(half * np.median(layer))) for layer in layers]


def _limits(box: Box, camera: Camera) -> tuple[Float64Array, Float64Array]:
    """Return lower and upper limits of a box in x and y, infinite on sides at the picture's edge, (2,) each."""
    low, high = np.array(box[:2], np.float64), np.array(box[2:], np.float64)
    size = np.array([camera.width, camera.height])
    return np.where(low <= 0, -np.inf, low), np.where(high >= size, np.inf, high)


def _between(points: NDArray[np.floating], camera: Camera, low: Float64Array, high: Float64Array) -> BoolArray:
    """Return which world points (N, 3) project between two corners (2,) of the image, (N,)."""
    pixels, depths = camera.project(points.astype(np.float64))
    return np.asarray((depths > 0) & (pixels > low).all(axis=1) & (pixels < high).all(axis=1))


def _cropped(camera: Camera, box: Box) -> tuple[Camera, Box]:
    """Return the part of a view around a box, and the box in it."""
    x0, y0, x1, y1 = box
    border = int(_BORDER_SHARE * max(x1 - x0, y1 - y0)) + 2
    left, top = max(0, x0 - border), max(0, y0 - border)
    right, bottom = min(camera.width, x1 + border), min(camera.height, y1 + border)
    return camera.part(left, top, right, bottom), (x0 - left, y0 - top, x1 - left, y1 - top)


_COSTS = np.geomspace(0.05, 25.0, 14)
"""Costs of changing sides to try, by area in squared radii."""
_CERTAIN_COST = 1e4
"""Cost that no cut pays."""
_ROUNDS_AT_CLICK = 2
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
    """Return the selected nodes (S,) after the best region has changed sides; None if none can.

    Where clicks have added something, what a click takes away is the largest region that none of them is in.
    """
    held = nearest_to([place for place in earlier if place.inside], graph.means)
    if len(held) and not seed.inside:
        return before & ~_region_apart(graph, before, seed, held)
    fixed = _fixed(graph, before, seed, earlier)
    stay, certain = np.where(before, 1.0, -1.0), np.where(fixed == 1, _CERTAIN_COST, -np.inf)
    cut = SurfaceCut(graph, before, seed.inside, np.where(fixed == 0, graph.areas, 0.0), _ROUNDS_AT_CLICK)
    terms = ((np.where(fixed == 0, cost * stay * graph.areas, certain), _COLOUR_WEIGHT * cost) for cost in _COSTS)
    best, best_score = None, -1.0
    for part in cut.sweep(terms, lambda part: _connected(graph, before, part, seed)):
        score = cut.separation(part, _LEAST_CONTRAST) * _width_fit(graph, cut.sides(part), seed)
        if score > best_score:
            best, best_score = part, score
    return best


def _region_apart(graph: SurfaceGraph, among: BoolArray, seed: Seed, held: IntArray) -> BoolArray:
    """Return the largest region among some nodes (S,) that has the node at a seed and none that is held, (S,)."""
    rows = np.flatnonzero(among)
    numbers = np.cumsum(among) - 1
    inner = among[graph.edges].all(axis=1)
    node = int(nearest_to([seed], graph.means[rows])[0])
    edges, weights = numbers[graph.edges[inner]], graph.weights[inner]
    found = region_apart(edges, weights, graph.areas[rows], node, numbers[held[among[held]]])
    return mask_of_rows(rows[found], len(among))


def nearest_to(seeds: Sequence[Seed], means: FloatArray) -> IntArray:
    """Return which of some centres (N, 3) is nearest to each seed, (P,)."""
    return np.array([np.argmin(np.linalg.norm(means - seed.point, axis=1)) for seed in seeds], np.int64)


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
