"""The hole that an object leaves in the flat surface that it stood on, closed with Gaussians like those around it.

Nobody has seen the surface there. What is filled in is a guess: flat Gaussians in a grid. Of the lines through each
that cross the hole, those count most whose two ends on the rim have the same colour, so that boards and stripes go on.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.gaussians import (
    SH_C0,
    BoolArray,
    Float64Array,
    Gaussians,
    IntArray,
    concatenate,
    logit,
    quaternions_of,
)
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.kd_tree import nearest
from gaussian_trimmer.geometry.support_plane import SupportPlane
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.views import HALF

_FOOT = 0.3
"""Height above the plane up to which the object stands in the surface, in object radii."""
_FINEST, _CELLS_ACROSS = 0.01, 80
"""Least width of a cell of the grid in object radii, and most cells along the footprint."""
_SPACINGS = 1.2
"""Width of a cell in median distances between neighbours in the surface."""
_LARGEST = 3
"""Cells around the centre of a Gaussian of the surface that it covers, at most."""
_MARGIN = 6
"""Cells of the grid around the footprint, of which the rim's colours are taken."""
_OVERLAP, _FLAT = 0.75, 0.1
"""Standard deviations of new Gaussians along and across the surface, in cells."""
_OPACITY = 0.95
_SHOWN = 0.3
"""Largest blend weight of a new Gaussian below the object, relative to that without the object."""
_MIN_SURFACE = 20
_RIM_NEIGHBOURS = 8
_DEPTH = 0.25
"""Quantile of these neighbours' heights at which new Gaussians lie: above the surface they would hide the foot."""
_DIRECTIONS = 8
_ALIKE = 0.05
"""Difference of the colours at a line's ends at which it counts 1/e as much as one of equal ends."""
_PICTURE, _FOV = 256, np.radians(30)
"""Size and field of view of the picture of the surface from above."""


def fill_hole(
    gaussians: Gaussians, keep: BoolArray, surface: BoolArray, bounds: Bounds, plane: SupportPlane, renderer: Renderer
) -> Gaussians:
    """New Gaussians that close the hole below the object; none where there is no hole, or too little around it.

    Args:
        gaussians: the object and the Gaussians around it, N of them.
        keep: which of them are the object, (N,).
        surface: which ones are the visible surface that it stands on, (N,).
        bounds: the object's bounds; their third axis is up.
        plane: that surface's plane.
        renderer: draws the surface from above.
    """
    nothing = gaussians.select(np.zeros(0, np.int64))
    local = (gaussians.means - bounds.centre) @ bounds.axes.T / bounds.radius
    foot = keep & (local[:, 2] < plane.height + _FOOT)
    if surface.sum() < _MIN_SURFACE or not foot.any():
        return nothing
    around = np.flatnonzero(surface)
    places = local[around, :2].astype(np.float32)
    squared, _ = nearest(places, places, 2)
    size = float(np.ptp(local[foot, :2], axis=0).max())
    cell = max(_SPACINGS * float(np.sqrt(np.median(squared[:, 1]))), size / _CELLS_ACROSS, _FINEST)
    widths = np.exp(np.sort(gaussians.log_scales[around], axis=1)[:, 1]) / bounds.radius
    low = local[foot, :2].min(axis=0) - _MARGIN * cell
    shape = tuple(np.ceil(np.ptp(local[foot, :2], axis=0) / cell).astype(int) + 2 * _MARGIN)
    hole, covered = _hole((local[foot, :2] - low) / cell, (places - low) / cell, widths / cell, shape)

    def in_the_world(cells: IntArray, heights: Float64Array) -> Float64Array:
        points = np.column_stack([low + (cells + 0.5) * cell, heights])
        return np.asarray(points * bounds.radius @ bounds.axes + bounds.centre)

    cells = np.argwhere(hole)
    if not len(cells):
        return nothing
    grid = np.argwhere(np.ones(shape, np.bool_))
    colours, shown = _seen_from_above(
        gaussians.select(around), in_the_world(grid, np.full(len(grid), plane.height)), bounds, renderer
    )
    filled = _continued(cells, colours.reshape(*shape, 3), covered & shown.reshape(shape))
    _, rim = nearest(places, (low + (cells + 0.5) * cell).astype(np.float32), min(_RIM_NEIGHBOURS, len(around)))
    n, axes = len(cells), np.array([_OVERLAP, _OVERLAP, _FLAT]) * cell * bounds.radius
    return Gaussians(
        in_the_world(cells, np.quantile(local[around[rim], 2], _DEPTH, axis=1)).astype(np.float32),
        np.tile(np.log(axes), (n, 1)).astype(np.float32),
        np.tile(quaternions_of(bounds.axes.T[None]), (n, 1)),
        np.full(n, logit(np.array([_OPACITY]))[0], np.float32),
        ((filled - 0.5) / SH_C0).astype(np.float32),
        np.zeros((n, 3, gaussians.sh_rest.shape[2]), np.float32),
    )


def without_what_shows(
    filled: Gaussians, gaussians: Gaussians, keep: BoolArray, cameras: Sequence[Camera], renderer: Renderer
) -> Gaussians:
    """The new Gaussians without those that show although the object stands on them.

    Args:
        filled: the new Gaussians.
        gaussians: the object and what is left of the Gaussians around it, N of them.
        keep: which of them are the object, (N,).
        cameras: views of the object.
        renderer: draws the scene with and without the object.
    """
    if not len(filled):
        return filled
    shown = []
    for part in (gaussians, gaussians.select(~keep)):
        both = concatenate([part, filled])
        one = [np.zeros((camera.height, camera.width), np.uint8) for camera in cameras]
        pairs = zip(cameras, one, strict=True)
        shown.append(sum(renderer.blend_weights(both, camera, label, 1)[len(part) :, 0] for camera, label in pairs))
    return filled.select(np.asarray(shown[0] <= _SHOWN * shown[1], np.bool_))


def _hole(
    foot: Float64Array, places: Float64Array, widths: NDArray[np.floating], shape: tuple[int, ...]
) -> tuple[BoolArray, BoolArray]:
    """Cells below the object that no Gaussian of the surface covers, and cells that one does; all in units of cells."""
    footprint, covered = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
    footprint[tuple(np.clip(foot.astype(int), 0, np.array(shape) - 1).T)] = 1
    footprint = np.asarray(cv2.dilate(footprint, np.ones((3, 3), np.uint8)), np.uint8)
    outlines, _ = cv2.findContours(footprint, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(footprint, outlines, -1, 1, cv2.FILLED)
    near = ((places > -_LARGEST) & (places < np.array(shape) + _LARGEST)).all(axis=1)
    for (row, column), width in zip(places[near], widths[near], strict=True):
        cv2.circle(covered, (int(column), int(row)), min(round(float(width)), _LARGEST), 1, cv2.FILLED)
    return (footprint > 0) & (covered == 0), covered > 0


def _seen_from_above(
    surface: Gaussians, points: Float64Array, bounds: Bounds, renderer: Renderer
) -> tuple[Float64Array, BoolArray]:
    """Colours of the surface at points (P, 3), and whether it is there, (P,)."""
    middle = points.mean(axis=0)
    reach = float(np.linalg.norm(points - middle, axis=1).max())
    eye = middle + bounds.axes[2] * 1.2 * reach / np.tan(_FOV / 2)
    K = intrinsics(_FOV, _PICTURE, _PICTURE)
    camera = Camera(look_at(eye, middle, bounds.axes[0]), K, _PICTURE, _PICTURE, near=0.01 * bounds.radius)
    picture = renderer.render(surface, camera)
    column, row = np.clip(camera.project(points)[0].astype(int), 0, _PICTURE - 1).T
    alpha = picture.alpha[row, column]
    return picture.rgb[row, column] / np.maximum(alpha, 1e-3)[:, None].astype(np.float64), alpha > HALF


def _continued(cells: IntArray, colours: Float64Array, known: BoolArray) -> Float64Array:
    """Colours of unknown cells (P, 2) from the known ones at both ends of lines through them, (P, 3)."""
    total, weights = np.zeros((len(cells), 3)), np.full(len(cells), 1e-12)
    total += colours[known].mean(axis=0) * 1e-12 if known.any() else 0.5e-12
    for angle in np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS:
        step = np.array([np.cos(angle), np.sin(angle)])
        (first, a), (second, b) = (_rim(cells, sign * step, colours, known) for sign in (1, -1))
        apart = np.abs(first - second).max(axis=1)
        ends = np.isfinite(a + b)
        a, b = np.where(ends, a, 1.0), np.where(ends, b, 1.0)
        weight, share = np.where(ends, np.exp(-apart / _ALIKE) / (a + b), 0.0), (b / (a + b))[:, None]
        total += weight[:, None] * (share * first + (1 - share) * second)
        weights += weight
    return np.asarray(total / weights[:, None])


def _rim(
    cells: IntArray, step: Float64Array, colours: Float64Array, known: BoolArray
) -> tuple[Float64Array, Float64Array]:
    """Colour of the first known cell in a direction, (P, 3), and its distance in cells, infinite if there is none."""
    found, distance = np.zeros((len(cells), 3)), np.full(len(cells), np.inf)
    for i in range(1, max(known.shape)):
        at = np.round(cells + i * step).astype(int)
        inside: BoolArray = np.asarray(((at >= 0) & (at < known.shape)).all(axis=1), np.bool_)
        at = np.where(inside[:, None], at, 0)
        hit = np.flatnonzero(inside & known[at[:, 0], at[:, 1]] & np.isinf(distance))
        found[hit], distance[hit] = colours[at[hit, 0], at[hit, 1]], i
    return found, distance
