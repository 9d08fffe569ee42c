"""The thing that a box in one view means: what is in it and hangs together less with what is outside than with itself.

A box says what is not meant: all that is seen beside it. What in it is meant is found by dividing the surface many
times, each time with a stronger pull of what the box shows towards the object: a weak pull separates only what hangs
by a thread, a strong one takes the box's whole content. Of all pieces that come off, the one is taken that fills the
box, whose boundary is short and runs where surfaces fold or colours change, and whose colours are not those of its
surroundings. A box in whose depths several things lie one behind the other is searched at each depth.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians, rotation_matrices
from gaussian_trimmer.geometry.components import connected_points
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.selecting.propagation import COLOUR_ROUNDS, GAP, HIDDEN, LEAST_SURFACE, colour_trust
from gaussian_trimmer.selecting.surface import Surface, look_around
from gaussian_trimmer.views import Box, bounding_box

_PULLS = np.geomspace(0.05, 1.6, 8)
"""Pulls of what is seen in the box that are tried, by area in squared radii."""
_COLOUR = 2.0
"""Pull of colours, relative to that of what is seen and by log-ratio."""
_LATTICE = 16
"""Places along each side of a box at which its depth is measured."""
_LAYER_GAP, _LEAST_LAYER = 1.0, 0.03
"""Depths farther apart than this, in radii, belong to different layers; smallest share of the places that one holds."""
_CONTRIBUTORS, _LEAST_ALPHA = 10, 0.3
_MARGIN = 0.5
"""How far beside the box the surroundings are looked at, relative to its sides."""
_BEYOND_PICTURE = 2.0
"""How much farther things are followed that may go on beyond the picture's edge."""
_LEAST_SEEN = 0.02
"""Smallest area of a piece that is seen in the box, in squared radii."""
_SAME_DEPTH = 1.5
"""Factor by which a piece may be nearer or farther than the layer that it is found in."""
_BORDER = 0.3
"""How far beside the box pieces are drawn, relative to its sides."""
_TOGETHER = 16
"""Pieces that are drawn in one pass."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """What a box may mean."""

    selection: BoolArray
    """(N,)."""
    overlap: float
    """Intersection over union of the box and the bounds of what is visible of it."""
    score: float
    """How good an answer it is, 0 to 1."""


def best_in_box(
    gaussians: Gaussians, camera: Camera, box: Box, up: Float64Array, renderer: Renderer,
    seen_from: Sequence[Camera] = (),
) -> Candidate | None:  # fmt: skip
    """The best answer to what a box means; None if nothing comes off in it.

    Where the box reaches the picture's edge, the thing may go on beyond it.

    Args:
        box: within the view.
        up: the scene's up vector, (3,).
        seen_from: training cameras, if known: things are not looked at from where they were not.
    """
    low, high = _open_ends(box, camera)
    margin = _MARGIN * np.subtract(box[2:], box[:2])
    labels = np.zeros((camera.height, camera.width), np.uint8)
    labels[box[1] : box[3], box[0] : box[2]] = 1
    beside, within = renderer.blend_weights(gaussians, camera, labels, 2).T
    inside = _between(gaussians.means, camera, low, high) & (within >= beside)
    unseen = np.flatnonzero(inside & (within <= 0))
    inside[unseen] = _wholly_between(gaussians.select(unseen), camera, low, high)
    wanted = _between(gaussians.means, camera, low - margin, high + margin)
    reach = _BEYOND_PICTURE if np.isinf([low, high]).any() else 1.0
    best: Candidate | None = None
    for centre, radius in _layers(gaussians, camera, box, renderer):
        surface = look_around(gaussians, camera, centre, radius, wanted, up, renderer, seen_from, reach)
        if len(surface.rows) < LEAST_SURFACE:
            continue
        parts = _pieces(surface, inside[surface.rows], camera)
        for part, overlap in zip(parts, _overlaps(gaussians, camera, box, surface, parts, renderer), strict=True):
            score = _score(surface, part, overlap)
            if best is None or score > best.score:
                best = Candidate(surface.with_hidden(gaussians, part, inside), overlap, score)
    return best


def _pieces(surface: Surface, inside: BoolArray, camera: Camera) -> list[BoolArray]:
    """All pieces that come off in the box, each once, (S,) each."""
    seen = inside & surface.in_first
    depths = camera.project(surface.places.astype(np.float64))[1]
    layer = float(camera.to_camera(surface.centre[None])[0, 2])
    found: dict[bytes, BoolArray] = {}
    for division in _divisions(surface, inside, seen):
        rows = np.flatnonzero(division)
        piece = connected_points(surface.places[rows].astype(np.float64), GAP * surface.radius)
        areas = np.bincount(piece, surface.areas[rows] * seen[rows])
        for number in np.flatnonzero(areas > _LEAST_SEEN):
            part = np.zeros(len(inside), np.bool_)
            part[rows[piece == number]] = True
            if 1 / _SAME_DEPTH < np.median(depths[part & seen]) / layer < _SAME_DEPTH:
                found.setdefault(part.tobytes(), part)
    return list(found.values())


def _divisions(surface: Surface, inside: BoolArray, seen: BoolArray) -> Iterator[BoolArray]:
    """The surface divided with stronger and stronger pulls, without colours and with them, (S,) each."""
    previous = np.zeros(len(inside), np.bool_)
    for pull in _PULLS:
        pulls = np.where(inside, surface.areas * np.where(seen, pull, HIDDEN), -np.inf)
        division = surface.divide(pulls)
        if not division.any() or np.array_equal(division, previous):
            continue
        previous = division
        yield division
        for _ in range(COLOUR_ROUNDS):
            ratio, told = surface.colour_evidence(division)
            refined = surface.divide(pulls + _COLOUR * pull * colour_trust(told) * surface.areas * ratio)
            if not refined.any() or np.array_equal(refined, division):
                break
            division = refined
            yield division


def _score(surface: Surface, part: BoolArray, overlap: float) -> float:
    """How well a part of the surface fills the box, and how clearly it is parted from the rest, 0 to 1."""
    cost, length = surface.boundary(part)
    _, told = surface.colour_evidence(part)
    contrast = 1 - cost / max(length, 1e-12)
    return overlap**2 * told * contrast * float(np.exp(-0.25 * cost / np.sqrt(surface.areas[part].sum())))


def _overlaps(
    gaussians: Gaussians, camera: Camera, box: Box, surface: Surface, parts: Sequence[BoolArray], renderer: Renderer
) -> list[float]:
    """Intersection over union of the box with the bounds of what is visible of each part."""
    cropped, box = _cropped(camera, box)
    overlaps = []
    for start in range(0, len(parts), _TOGETHER):
        some = parts[start : start + _TOGETHER]
        values = np.zeros((len(gaussians), len(some)), np.float32)
        values[surface.rows] = np.stack(some, axis=1)
        shown = renderer.blend_values(gaussians, cropped, values) > 0.5
        masks = [shown[..., k] for k in range(len(some))]
        overlaps += [box_overlap(bounding_box(mask), box) if mask.any() else 0.0 for mask in masks]
    return overlaps


def box_overlap(a: Box, b: Box) -> float:
    """Intersection over union of two boxes.

    >>> box_overlap((0, 0, 2, 2), (1, 0, 3, 2))
    0.3333333333333333
    """
    width, height = (min(a[k + 2], b[k + 2]) - max(a[k], b[k]) for k in (0, 1))
    shared = max(width, 0) * max(height, 0)
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (a, b)]
    return shared / (sum(areas) - shared)


def _layers(gaussians: Gaussians, camera: Camera, box: Box, renderer: Renderer) -> list[tuple[Float64Array, float]]:
    """Places in the middle of the box at each depth at which it shows something, and half of its larger side there."""
    x0, y0, x1, y1 = box
    across, down = (np.linspace(low, high - 1, _LATTICE).astype(np.int64) for low, high in ((x0, x1), (y0, y1)))
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    depths = np.sort(surface_depths(gaussians, camera, pixels, renderer))
    depths = depths[np.isfinite(depths)]
    half = max(x1 - x0, y1 - y0) / 2 / camera.K[0, 0]
    ray = camera.ray_directions(np.array([[x0 + x1, y0 + y1]]) / 2)[0]
    ray /= ray @ camera.forward
    ends = np.flatnonzero(np.diff(depths) > _LAYER_GAP * half * depths[:-1]) + 1
    layers = [layer for layer in np.split(depths, ends) if len(layer) >= max(1.0, _LEAST_LAYER * len(depths))]
    return [(camera.centre + ray * np.median(layer), float(half * np.median(layer))) for layer in layers]


def surface_depths(gaussians: Gaussians, camera: Camera, pixels: NDArray[np.int64], renderer: Renderer) -> Float64Array:
    """Depth of the surface at some pixels (P, 2), infinite where nothing is seen, (P,).

    It is the weighted median depth of the Gaussians that show most, so that a thin thing is not blended with what
    lies behind it.
    """
    rows, weights = renderer.top_contributors(gaussians, camera, pixels, _CONTRIBUTORS)
    depths = camera.project(gaussians.means[np.maximum(rows, 0).ravel()].astype(np.float64))[1].reshape(rows.shape)
    depths[rows < 0] = np.inf
    weights = np.where(rows < 0, 0, weights)
    order = np.argsort(depths, axis=1)
    depths, weights = np.take_along_axis(depths, order, 1), np.take_along_axis(weights, order, 1)
    cumulative = np.cumsum(weights, axis=1)
    middle = np.argmax(cumulative >= cumulative[:, -1:] / 2, axis=1)
    found = depths[np.arange(len(pixels)), middle]
    return np.where(cumulative[:, -1] < _LEAST_ALPHA, np.inf, found)


def _open_ends(box: Box, camera: Camera) -> tuple[Float64Array, Float64Array]:
    """Lower and upper ends of a box along x and y, infinite where it reaches the picture's edge, (2,) each."""
    low, high = np.array(box[:2], np.float64), np.array(box[2:], np.float64)
    size = np.array([camera.width, camera.height])
    return np.where(low <= 0, -np.inf, low), np.where(high >= size, np.inf, high)


def _between(points: NDArray[np.floating], camera: Camera, low: Float64Array, high: Float64Array) -> BoolArray:
    """Which points (N, 3) are seen between two corners of the picture, (N,)."""
    pixels, depths = camera.project(points.astype(np.float64))
    return np.asarray((depths > 0) & (pixels > low).all(axis=1) & (pixels < high).all(axis=1))


def _wholly_between(gaussians: Gaussians, camera: Camera, low: Float64Array, high: Float64Array) -> BoolArray:
    """Which Gaussians have both ends of their longest axis, two standard deviations out, between two corners, (N,)."""
    longest = np.argmax(gaussians.log_scales, axis=1)
    axes = rotation_matrices(gaussians.quaternions)[np.arange(len(gaussians)), :, longest]
    arms = 2 * np.exp(gaussians.log_scales.max(axis=1).astype(np.float64))[:, None] * axes
    ends = [_between(gaussians.means + sign * arms, camera, low, high) for sign in (-1, 1)]
    return ends[0] & ends[1]


def _cropped(camera: Camera, box: Box) -> tuple[Camera, Box]:
    """The part of a view around a box, and the box in it."""
    x0, y0, x1, y1 = box
    border = int(_BORDER * max(x1 - x0, y1 - y0)) + 2
    left, top = max(0, x0 - border), max(0, y0 - border)
    right, bottom = min(camera.width, x1 + border), min(camera.height, y1 + border)
    K = camera.K.copy()
    K[:2, 2] -= left, top
    cropped = replace(camera, K=K, width=right - left, height=bottom - top)
    return cropped, (x0 - left, y0 - top, x1 - left, y1 - top)
