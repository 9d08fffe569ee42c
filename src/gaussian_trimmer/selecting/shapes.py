"""Selections by volumes, by what is drawn over in a view, and such that grow and shrink. N Gaussians."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera, Viewpoint, up_frame
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians
from gaussian_trimmer.geometry.graphs import nearest
from gaussian_trimmer.rendering import blend_weights, render, top_contributors
from gaussian_trimmer.selecting.marks import Box3D, Sphere, Stroke
from gaussian_trimmer.surface.viewed_scene import CONTRIBUTORS, small_view, surface_depths, surface_points
from gaussian_trimmer.views.view import HALF, MIN_SEEN_PIXELS

_MIN_GAUSSIANS = 2
_SHIFT = 4
"""Bits of a pixel's fraction in OpenCV's coordinates."""
_SHOWS = 0.1
"""Blend weight at a pixel from which on a Gaussian is part of what shows there."""


def inside_shape(means: FloatArray, shape: Box3D | Sphere, up: Float64Array) -> BoolArray:
    """Return which centres (N, 3) lie in a box or a ball, (N,).

    Args:
        up: the scene's up vector (3,), along which z points where the shape's coordinates are `up`.

    Raises:
        InputError: the box is empty, or the radius is not above zero.
    """
    points = means.astype(np.float64)
    points = points @ up_frame(up).T if shape.coordinates == "up" else points
    if isinstance(shape, Box3D):
        low, high = np.array(shape.low, np.float64), np.array(shape.high, np.float64)
        if not (low < high).all():
            raise InputError(
                f"The 3D box goes from {low.tolist()} to {high.tolist()}; each of the first three numbers must be "
                "below its partner."
            )
        return np.asarray(((points >= low) & (points <= high)).all(axis=1))
    if not shape.radius > 0:
        raise InputError(f"The sphere's radius is {shape.radius:g}; it must be above zero.")
    return np.asarray(np.linalg.norm(points - np.array(shape.centre), axis=1) <= shape.radius)


def grown(means: FloatArray, selection: BoolArray, spacings: float) -> BoolArray:
    """Return the selection (N,) and all Gaussians within some spacings of it, (N,).

    Args:
        spacings: distance in median distances between neighbouring Gaussians of the selection.

    Raises:
        InputError: the distance is not above zero.
    """
    return selection | _near(means, selection, _reach(means, selection, spacings, "grown"))


def shrunk(means: FloatArray, selection: BoolArray, spacings: float) -> BoolArray:
    """Return the selection (N,) without the Gaussians within some spacings of others that are not selected, (N,).

    Args:
        spacings: as for `grown`.

    Raises:
        InputError: the distance is not above zero.
    """
    return selection & ~_near(means, ~selection, _reach(means, selection, spacings, "shrunk"))


def _near(means: FloatArray, some: BoolArray, reach: float) -> BoolArray:
    """Return which of the other Gaussians lie within reach of some (N,), (N,)."""
    near, others = np.zeros(len(some), np.bool_), np.flatnonzero(~some)
    if reach > 0 and len(others) and some.any():
        squared, _ = nearest(means[some], means[others], 1)
        near[others[squared[:, 0] <= reach**2]] = True
    return near


def in_spacings(length: float, means: FloatArray, selection: BoolArray) -> float:
    """Return a length in median distances between neighbours of a selection; 0 if there are none."""
    spacing = _reach(means, selection, 1.0, "measured")
    return length / spacing if spacing > 0 else 0.0


def _reach(means: FloatArray, selection: BoolArray, spacings: float, what: str) -> float:
    if not (np.isfinite(spacings) and spacings > 0):
        raise InputError(f"The selection cannot be {what} by {spacings:g} spacings; give a number above zero.")
    selected = means[selection]
    if len(selected) < _MIN_GAUSSIANS:
        return 0.0
    squared, _ = nearest(selected, selected, 2)
    return float(spacings * np.sqrt(np.median(squared[:, 1])))


def drawn_over(stroke: Stroke) -> tuple[Camera, BoolArray]:
    """Return a small view, and which of its pixels were drawn over, (H, W)."""
    camera, radius = _small(stroke)
    mask = np.zeros((camera.height, camera.width), np.uint8)
    places = np.array(stroke.places) * (camera.width, camera.height) - 0.5
    line = np.round(places * (1 << _SHIFT)).astype(np.int32)
    if radius is None:
        cv2.fillPoly(mask, [line], 1, shift=_SHIFT)
    else:
        cv2.polylines(mask, [line], False, 1, max(1, round(2 * radius)), shift=_SHIFT)
        for x, y in line:
            cv2.circle(mask, (int(x), int(y)), max(1, round(radius * (1 << _SHIFT))), 1, -1, shift=_SHIFT)
    return camera, mask.astype(np.bool_)


def _small(stroke: Stroke) -> tuple[Camera, float | None]:
    """Return the small view, and the brush's radius in its pixels."""
    assert isinstance(stroke.view, Viewpoint), "views are resolved"
    camera = small_view(stroke.view.camera)
    return camera, None if stroke.radius is None else stroke.radius * camera.width / stroke.view.camera.width


def under_stroke(gaussians: Gaussians, stroke: Stroke, *, through: bool, by_centres: bool) -> BoolArray:
    """Return which Gaussians a stroke means, (N,): of what shows there those that show mostly there.

    What is hidden below the surface is meant by its centre, as deep as the brush's radius, or half of the width that a
    lasso has.

    Args:
        gaussians: those that are shown.
        stroke: what was drawn over.
        through: take all depths, not only the surface.
        by_centres: go by centres alone.
    """
    camera, mask = drawn_over(stroke)
    pixels, depths = camera.project(gaussians.means.astype(np.float64))
    rows = np.flatnonzero((depths > camera.near) & camera.contains(pixels))
    x, y = pixels[rows].astype(np.int64).T
    rows, x, y = (values[mask[y, x]] for values in (rows, x, y))
    top, weights = top_contributors(gaussians, camera, np.argwhere(mask)[:, ::-1], CONTRIBUTORS)
    if not through:
        radius = _small(stroke)[1]
        reach = np.sqrt(np.count_nonzero(mask) / np.pi) if radius is None else radius
        surface = np.full(mask.shape, np.inf)
        surface[mask] = surface_depths(gaussians, camera, top, weights)
        rows = rows[depths[rows] <= surface[y, x] * (1 + reach / camera.K[0, 0])]
    taken = np.zeros(len(gaussians), np.bool_)
    taken[rows] = True
    if by_centres:
        return taken
    beside, under = blend_weights(gaussians, camera, mask.astype(np.uint8), 2).T
    mostly = under > HALF * (under + beside)
    taken &= mostly | (under + beside < MIN_SEEN_PIXELS)
    shown = np.unique(top[(top >= 0) & (weights >= _SHOWS)])
    taken[shown] = mostly[shown]
    return taken


def in_spheres(gaussians: Gaussians, stroke: Stroke) -> BoolArray:
    """Return which Gaussians have their centres within a brush's radius of the surface under its line, (N,)."""
    camera, mask = drawn_over(replace(stroke, radius=0.5))
    radius = _small(stroke)[1]
    assert radius is not None, "a brush has a radius"
    points = surface_points(gaussians, camera, np.argwhere(mask)[:, ::-1])
    points = points[np.isfinite(points[:, 0])]
    if not len(points):
        return np.zeros(len(gaussians), np.bool_)
    reach = radius / camera.K[0, 0] * camera.to_camera(points)[:, 2]
    squared, number = nearest(points, gaussians.means, 1, 1.001 * float(reach.max()))
    return np.asarray(squared[:, 0] <= reach[number[:, 0]] ** 2)


def shows_under(gaussians: Gaussians, stroke: Stroke) -> bool:
    """Tell whether anything shows where something was drawn."""
    camera, mask = drawn_over(stroke)
    return bool((render(gaussians, camera).alpha[mask] >= _SHOWS).any())
