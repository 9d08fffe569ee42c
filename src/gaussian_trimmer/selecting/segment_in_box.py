"""The object or part in a box of one view, on all of its sides: what is weakly connected to everything outside the box.

A box says what is not meant: all that is visible outside. What is meant inside is found by cutting the surface graph
many times, with a growing unary term for the surface that is visible in the box: a small one separates only what
hardly hangs on the surroundings, a large one takes all that the box holds. Of all pieces that come off, the best one
fills the box, has a short boundary along concave edges and changes of colour, and has other colours than its
surroundings. Where the box shows surfaces at several depths, each depth is searched.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, IntArray
from gaussian_trimmer.selecting.surface_cut import HIDDEN_UNARY, MIN_NODES, SurfaceCut
from gaussian_trimmer.selecting.surface_graph import axis_ends, build_surface_graph
from gaussian_trimmer.selecting.viewed_scene import CONTRIBUTORS, ViewedScene, surface_depths
from gaussian_trimmer.views import HALF, Box, bounding_box, box_slices

_UNARIES = np.geomspace(0.05, 1.6, 8)
"""Unary terms of the surface that is visible in the box to try, by area in squared radii."""
_COLOUR_WEIGHT = 2.0
"""Weight of the colours' log-likelihood ratio, relative to that term."""
_COLOUR_ROUNDS = 3
_LATTICE_PIXELS = 40
"""Number of pixels along half of the larger side of the box at which is looked up what shows."""
_LAYER_GAP, _MIN_LAYER = 1.0, 0.03
"""Gap between the depths of two surfaces, in radii; smallest share of the pixels on one of them."""
_SURROUNDINGS = 0.5
"""Width of the surroundings that are looked at, relative to the box's sides."""
_REACH_BEYOND_EDGE = 2.0
"""Factor on the reach for objects that may go on beyond the picture's edge."""
_MIN_VISIBLE_AREA = 0.02
"""Smallest area of a piece that is visible in the box, in squared radii."""
_DEPTH_RATIO = 1.5
"""Largest ratio of the depths of a piece and of the surface that it was searched on."""


def segment_in_box(scene: ViewedScene, box: Box) -> tuple[BoolArray, float]:
    """The best segment in a box (N,), and how well its bounding box fits; nothing where nothing can be separated.

    On sides where the box reaches the picture's edge, the object may go on beyond it.

    Args:
        scene: the scene in the user's view.
        box: within the view.
    """
    gaussians, camera = scene.gaussians, scene.camera
    low, high = _limits(box, camera)
    margin = _SURROUNDINGS * np.subtract(box[2:], box[:2])
    mask = np.zeros((camera.height, camera.width), np.bool_)
    mask[box_slices(box)] = True
    outside, inside = scene.label_weights(mask)
    allowed = _between(gaussians.means, camera, low, high) & (inside >= outside)
    unseen = np.flatnonzero(allowed & (inside <= 0))
    for ends in axis_ends(gaussians.select(unseen)):
        allowed[unseen] &= _between(ends, camera, low, high)
    candidates = _between(gaussians.means, camera, low - margin, high + margin)
    reach = _REACH_BEYOND_EDGE if np.isinf([low, high]).any() else 1.0
    half = max(box[2] - box[0], box[3] - box[1]) / 2
    step = max(1, int(half / _LATTICE_PIXELS))
    pixels = _pixels_around(box, int(half), step, camera)
    contributors, weights = scene.renderer.top_contributors(gaussians, camera, pixels, CONTRIBUTORS)
    within = ((pixels >= box[:2]) & (pixels < box[2:])).all(axis=1)
    depths = surface_depths(gaussians, camera, contributors[within], weights[within])
    ray = camera.ray_directions(np.array([[box[0] + box[2], box[1] + box[3]]]) / 2)[0]
    best, best_overlap, best_score = np.zeros(len(gaussians), np.bool_), 0.0, 0.0
    for depth in _layers(depths, half / camera.K[0, 0]):
        centre = camera.centre + ray * depth / (ray @ camera.forward)
        graph = build_surface_graph(scene, centre, half / camera.K[0, 0] * depth, candidates, reach)
        if len(graph.rows) < MIN_NODES:
            continue
        cut = SurfaceCut(graph, np.zeros(len(graph.rows), np.bool_), True, graph.areas, _COLOUR_ROUNDS)
        for part in _pieces(cut, allowed[graph.rows], camera, depth):
            selection = np.zeros(len(gaussians), np.bool_)
            selection[graph.rows[part]] = True
            shown = pixels[(weights * selection[contributors]).sum(axis=1, where=contributors >= 0) > HALF]
            if len(shown):
                (x0, y0), (x1, y1) = shown.min(axis=0).tolist(), (shown.max(axis=0) + step).tolist()
                overlap = box_overlap((x0, y0, x1, y1), box)
                score = overlap**2 * cut.separation(part)
                if score > best_score:
                    best, best_overlap, best_score = graph.with_hidden(gaussians, part, allowed), overlap, score
    return best, best_overlap


def box_overlap(a: Box, b: Box) -> float:
    """Intersection over union of two boxes.

    >>> box_overlap((0, 0, 2, 2), (1, 0, 3, 2))
    0.3333333333333333
    """
    width, height = (min(a[k + 2], b[k + 2]) - max(a[k], b[k]) for k in (0, 1))
    shared = max(width, 0) * max(height, 0)
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (a, b)]
    return shared / (sum(areas) - shared)


def fills(mask: BoolArray, box: Box) -> float:
    """Intersection over union of a mask's bounding box and a box; zero for an empty mask."""
    return box_overlap(bounding_box(mask), box) if mask.any() else 0.0


def _pieces(cut: SurfaceCut, allowed: BoolArray, camera: Camera, depth: float) -> list[BoolArray]:
    """All connected pieces of all cuts about as deep as the surface that was searched, each once, (S,) each."""
    graph = cut.graph
    visible = allowed & graph.visible_in_view
    depths = camera.project(graph.means.astype(np.float64))[1]
    terms = (
        (np.where(allowed, graph.areas * np.where(visible, unary, HIDDEN_UNARY), -np.inf), _COLOUR_WEIGHT * unary)
        for unary in _UNARIES
    )
    found: dict[bytes, BoolArray] = {}
    for chosen in cut.sweep(terms):
        rows, piece = graph.pieces(chosen)
        areas = np.bincount(piece, graph.areas[rows] * visible[rows])
        for number in np.flatnonzero(areas > _MIN_VISIBLE_AREA):
            part = np.zeros(len(allowed), np.bool_)
            part[rows[piece == number]] = True
            if 1 / _DEPTH_RATIO < np.median(depths[part & visible]) / depth < _DEPTH_RATIO:
                found[part.tobytes()] = part
    return list(found.values())


def _pixels_around(box: Box, border: int, step: int, camera: Camera) -> IntArray:
    """A lattice of pixels over a box and a border of the picture, (P, 2)."""
    columns = np.arange(max(0, box[0] - border), min(camera.width, box[2] + border), step)
    lines = np.arange(max(0, box[1] - border), min(camera.height, box[3] + border), step)
    return np.asarray(np.stack(np.meshgrid(columns, lines), axis=-1).reshape(-1, 2))


def _layers(depths: Float64Array, radius: float) -> list[float]:
    """The depths of surfaces that pixels show, by the pixels' own depths (P,), and the radius relative to these."""
    depths = np.sort(depths[np.isfinite(depths)])
    ends = np.flatnonzero(np.diff(depths) > _LAYER_GAP * radius * depths[:-1]) + 1
    layers = np.split(depths, ends)
    return [float(np.median(layer)) for layer in layers if len(layer) >= max(1.0, _MIN_LAYER * len(depths))]


def _limits(box: Box, camera: Camera) -> tuple[Float64Array, Float64Array]:
    """Lower and upper limits of a box in x and y, infinite on sides at the picture's edge, (2,) each."""
    low, high = np.array(box[:2], np.float64), np.array(box[2:], np.float64)
    size = np.array([camera.width, camera.height])
    return np.where(low <= 0, -np.inf, low), np.where(high >= size, np.inf, high)


def _between(points: NDArray[np.floating], camera: Camera, low: Float64Array, high: Float64Array) -> BoolArray:
    """Which world points (N, 3) project between two corners (2,) of the image, (N,)."""
    pixels, depths = camera.project(points.astype(np.float64))
    return np.asarray((depths > 0) & (pixels > low).all(axis=1) & (pixels < high).all(axis=1))
