"""The object or part in a box of one view, on all of its sides: what is weakly connected to everything outside the box.

A box says what is not meant: all that is visible outside. What is meant inside is found by cutting the surface graph
many times, with a growing unary term for the surface that is visible in the box: a small one separates only what
hardly hangs on the surroundings, a large one takes all that the box holds. Of all pieces that come off, the best one
fills the box, has a short boundary along concave edges and changes of colour, and has other colours than its
surroundings. Where the box shows surfaces at several depths, each depth is searched.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians, IntArray
from gaussian_trimmer.geometry.components import connected_points
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.selecting.propagation import COLOUR_ROUNDS, HIDDEN, MIN_NODES, colour_weight
from gaussian_trimmer.selecting.surface_graph import SurfaceGraph, axis_ends, build_surface_graph
from gaussian_trimmer.views import Box, bounding_box

_UNARIES = np.geomspace(0.05, 1.6, 8)
"""Unary terms of the surface that is visible in the box to try, by area in squared radii."""
_COLOUR = 2.0
"""Weight of the colours' log-likelihood ratio, relative to that term."""
_LATTICE = 16
"""Number of pixels along each side of the box at which depth is measured."""
_LAYER_GAP, _MIN_LAYER = 1.0, 0.03
"""Gap between the depths of two surfaces, in radii; smallest share of the pixels on one of them."""
CONTRIBUTORS, _MIN_ALPHA = 10, 0.3
"""Number of the largest contributors to a pixel that are looked at, and least opacity at which something is visible."""
_MARGIN = 0.5
"""Width of the surroundings that are looked at, relative to the box's sides."""
_BEYOND_EDGE = 2.0
"""Factor on the reach for objects that may go on beyond the picture's edge."""
_MIN_VISIBLE = 0.02
"""Smallest area of a piece that is visible in the box, in squared radii."""
_DEPTH_RATIO = 1.5
"""Largest ratio of the depths of a piece and of the surface that it was searched on."""
_BORDER = 0.3
"""Width of the border around the box in which pieces are drawn, relative to its larger side."""
_TOGETHER = 16
"""Number of pieces that are drawn in one pass."""
_LENGTH_PENALTY = 0.25
"""How fast the score falls with the boundary's weight, relative to the root of the piece's area."""


@dataclass(frozen=True, eq=False)
class BoxSegment:
    """What a box may stand for."""

    selection: BoolArray
    """(N,)."""
    overlap: float
    """Intersection over union of the box and the bounding box of the visible segment."""
    score: float
    """How well it fills the box and is separated from the rest, 0 to 1."""


def segment_in_box(
    gaussians: Gaussians, camera: Camera, box: Box, up: Float64Array, renderer: Renderer,
    seen_from: Sequence[Camera] = (),
) -> BoxSegment | None:  # fmt: skip
    """The best segment in a box; None if nothing can be separated there.

    On sides where the box reaches the picture's edge, the object may go on beyond it.

    Args:
        box: within the view.
        up: the scene's up vector, (3,).
        seen_from: training cameras, if known: the surface is not looked at from other sides.
    """
    low, high = _limits(box, camera)
    margin = _MARGIN * np.subtract(box[2:], box[:2])
    labels = np.zeros((camera.height, camera.width), np.uint8)
    labels[box[1] : box[3], box[0] : box[2]] = 1
    outside, inside = renderer.blend_weights(gaussians, camera, labels, 2).T
    allowed = _between(gaussians.means, camera, low, high) & (inside >= outside)
    unseen = np.flatnonzero(allowed & (inside <= 0))
    for ends in axis_ends(gaussians.select(unseen)):
        allowed[unseen] &= _between(ends, camera, low, high)
    candidates = _between(gaussians.means, camera, low - margin, high + margin)
    reach = _BEYOND_EDGE if np.isinf([low, high]).any() else 1.0
    best: BoxSegment | None = None
    for centre, radius in _surfaces(gaussians, camera, box, renderer):
        graph = build_surface_graph(gaussians, camera, centre, radius, candidates, up, renderer, seen_from, reach)
        if len(graph.rows) < MIN_NODES:
            continue
        parts = _pieces(graph, allowed[graph.rows], camera)
        for part, overlap in zip(parts, _overlaps(gaussians, camera, box, graph, parts, renderer), strict=True):
            score = _score(graph, part, overlap)
            if best is None or score > best.score:
                best = BoxSegment(graph.with_hidden(gaussians, part, allowed), overlap, score)
    return best


def box_overlap(a: Box, b: Box) -> float:
    """Intersection over union of two boxes.

    >>> box_overlap((0, 0, 2, 2), (1, 0, 3, 2))
    0.3333333333333333
    """
    width, height = (min(a[k + 2], b[k + 2]) - max(a[k], b[k]) for k in (0, 1))
    shared = max(width, 0) * max(height, 0)
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (a, b)]
    return shared / (sum(areas) - shared)


def _pieces(graph: SurfaceGraph, allowed: BoolArray, camera: Camera) -> list[BoolArray]:
    """All connected pieces of all cuts, each once, (S,) each."""
    visible = allowed & graph.visible_in_view
    depths = camera.project(graph.means.astype(np.float64))[1]
    surface_depth = float(camera.to_camera(graph.centre[None])[0, 2])
    found: dict[bytes, BoolArray] = {}
    for chosen in _cuts(graph, allowed, visible):
        rows = np.flatnonzero(chosen)
        piece = connected_points(graph.means[rows].astype(np.float64), graph.gap)
        areas = np.bincount(piece, graph.areas[rows] * visible[rows])
        for number in np.flatnonzero(areas > _MIN_VISIBLE):
            part = np.zeros(len(allowed), np.bool_)
            part[rows[piece == number]] = True
            if 1 / _DEPTH_RATIO < np.median(depths[part & visible]) / surface_depth < _DEPTH_RATIO:
                found.setdefault(part.tobytes(), part)
    return list(found.values())


def _cuts(graph: SurfaceGraph, allowed: BoolArray, visible: BoolArray) -> Iterator[BoolArray]:
    """Cuts of the graph with growing unary terms, without colour models and with them, (S,) each."""
    previous = np.zeros(len(allowed), np.bool_)
    for unary in _UNARIES:
        unaries = np.where(allowed, graph.areas * np.where(visible, unary, HIDDEN), -np.inf)
        chosen = graph.cut(unaries)
        if not chosen.any() or np.array_equal(chosen, previous):
            continue
        previous = chosen
        yield chosen
        for _ in range(COLOUR_ROUNDS):
            ratio, accuracy = graph.colour_evidence(chosen)
            refined = graph.cut(unaries + _COLOUR * unary * colour_weight(accuracy) * graph.areas * ratio)
            if not refined.any() or np.array_equal(refined, chosen):
                break
            chosen = refined
            yield chosen


def _score(graph: SurfaceGraph, part: BoolArray, overlap: float) -> float:
    """How well a part of the surface (S,) fills the box and is separated from the rest, 0 to 1."""
    weight, length = graph.boundary(part)
    _, accuracy = graph.colour_evidence(part)
    contrast = 1 - weight / max(length, 1e-12)
    shortness = float(np.exp(-_LENGTH_PENALTY * weight / np.sqrt(graph.areas[part].sum())))
    return overlap**2 * contrast**2 * accuracy * shortness


def _overlaps(
    gaussians: Gaussians, camera: Camera, box: Box, graph: SurfaceGraph, parts: Sequence[BoolArray], renderer: Renderer
) -> list[float]:
    """Intersection over union of the box and the bounding box of each visible part, (P,)."""
    cropped, box = _cropped(camera, box)
    overlaps = []
    for start in range(0, len(parts), _TOGETHER):
        some = parts[start : start + _TOGETHER]
        values = np.zeros((len(gaussians), len(some)), np.float32)
        values[graph.rows] = np.stack(some, axis=1)
        shown = renderer.blend_values(gaussians, cropped, values) > 0.5
        masks = [shown[..., k] for k in range(len(some))]
        overlaps += [box_overlap(bounding_box(mask), box) if mask.any() else 0.0 for mask in masks]
    return overlaps


def _surfaces(
    gaussians: Gaussians, camera: Camera, box: Box, renderer: Renderer
) -> list[tuple[Float64Array, float]]:  # fmt: skip
    """For each depth at which the box shows a surface, the point in its middle (3,) and half its larger side there."""
    x0, y0, x1, y1 = box
    columns, rows = (np.linspace(low, high - 1, _LATTICE).astype(np.int64) for low, high in ((x0, x1), (y0, y1)))
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    contributors = renderer.top_contributors(gaussians, camera, pixels, CONTRIBUTORS)
    depths = np.sort(surface_depths(gaussians, camera, *contributors))
    depths = depths[np.isfinite(depths)]
    half = max(x1 - x0, y1 - y0) / 2 / camera.K[0, 0]
    ray = camera.ray_directions(np.array([[x0 + x1, y0 + y1]]) / 2)[0]
    ray /= ray @ camera.forward
    ends = np.flatnonzero(np.diff(depths) > _LAYER_GAP * half * depths[:-1]) + 1
    layers = [layer for layer in np.split(depths, ends) if len(layer) >= max(1.0, _MIN_LAYER * len(depths))]
    return [(camera.centre + ray * np.median(layer), float(half * np.median(layer))) for layer in layers]


def surface_depths(gaussians: Gaussians, camera: Camera, rows: IntArray, weights: NDArray[np.floating]) -> Float64Array:
    """Depth of the surface at some pixels, infinite where hardly anything is visible, (P,).

    It is the weighted median over the largest contributors, which does not mix thin objects with what is behind them.

    Args:
        rows: rows of the pixels' largest contributors, -1 for none, (P, K).
        weights: their blend weights, (P, K).
    """
    depths = camera.project(gaussians.means[np.maximum(rows, 0).ravel()].astype(np.float64))[1].reshape(rows.shape)
    depths, weights = np.where(rows < 0, np.inf, depths), np.where(rows < 0, 0, weights)
    order = np.argsort(depths, axis=1)
    cumulative = np.cumsum(np.take_along_axis(weights, order, axis=1), axis=1)
    median = np.argmax(cumulative >= cumulative[:, -1:] / 2, axis=1)
    found = depths[np.arange(len(rows)), order[np.arange(len(rows)), median]]
    return np.where(cumulative[:, -1] < _MIN_ALPHA, np.inf, found)


def _limits(box: Box, camera: Camera) -> tuple[Float64Array, Float64Array]:
    """Lower and upper limits of a box in x and y, infinite on sides at the picture's edge, (2,) each."""
    low, high = np.array(box[:2], np.float64), np.array(box[2:], np.float64)
    size = np.array([camera.width, camera.height])
    return np.where(low <= 0, -np.inf, low), np.where(high >= size, np.inf, high)


def _between(points: NDArray[np.floating], camera: Camera, low: Float64Array, high: Float64Array) -> BoolArray:
    """Which world points (N, 3) project between two corners (2,) of the image, (N,)."""
    pixels, depths = camera.project(points.astype(np.float64))
    return np.asarray((depths > 0) & (pixels > low).all(axis=1) & (pixels < high).all(axis=1))


def _cropped(camera: Camera, box: Box) -> tuple[Camera, Box]:
    """The part of a view around a box, and the box in it."""
    x0, y0, x1, y1 = box
    border = int(_BORDER * max(x1 - x0, y1 - y0)) + 2
    left, top = max(0, x0 - border), max(0, y0 - border)
    right, bottom = min(camera.width, x1 + border), min(camera.height, y1 + border)
    return camera.part(left, top, right, bottom), (x0 - left, y0 - top, x1 - left, y1 - top)
