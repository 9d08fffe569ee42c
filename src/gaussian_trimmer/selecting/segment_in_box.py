"""The object or part in a box of one view, on all of its sides: what is weakly connected to everything outside the box.

A box says what is not meant: all that is visible outside. What is meant inside is found by cutting the surface graph
many times, with a growing unary term for the surface that is visible in the box: a small one separates only what
hardly hangs on the surroundings, a large one takes all that the box holds. Of all pieces that come off, the best one
fills the box, has a short boundary along concave edges and changes of colour, and has other colours than its
surroundings. Where the box shows surfaces at several depths, each depth is searched.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, mask_of_rows
from gaussian_trimmer.rendering import blend_values, top_contributors
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
"""Weight of the colours' log-likelihood ratio, relative to that term."""
_COLOUR_ROUNDS = 3
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
        cut = SurfaceCut(graph, nothing, True, graph.areas, _COLOUR_ROUNDS)
        parts = _pieces(cut, allowed[graph.rows], camera)
        for part, overlap in zip(parts, _overlaps(scene, box, graph, parts), strict=True):
            score = overlap**2 * cut.separation(part)
            if score > best_score:
                best, best_overlap, best_score = graph.with_hidden(gaussians, part, allowed), overlap, score
    return best, best_overlap


def box_overlap(a: Box, b: Box) -> float:
    """Return the intersection over union of two boxes.

    >>> box_overlap((0, 0, 2, 2), (1, 0, 3, 2))
    0.3333333333333333
    """
    width, height = (min(a[k + 2], b[k + 2]) - max(a[k], b[k]) for k in (0, 1))
    shared = max(width, 0) * max(height, 0)
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (a, b)]
    return shared / (sum(areas) - shared)


def fills(mask: BoolArray, box: Box) -> float:
    """Return the intersection over union of a mask's bounding box and a box; zero for an empty mask."""
    return box_overlap(bounding_box(mask), box) if mask.any() else 0.0


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
