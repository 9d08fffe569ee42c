"""Selections by volumes, and selections that grow and shrink. N Gaussians."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.cameras import up_frame
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray
from gaussian_trimmer.geometry.neighbours import nearest
from gaussian_trimmer.selecting.marks import Box3D, Coordinates, Sphere

_MIN_GAUSSIANS = 2


def inside_shape(means: FloatArray, shape: Box3D | Sphere, up: Float64Array) -> BoolArray:
    """Return which centres (N, 3) lie in a box or a ball, (N,).

    Args:
        up: the scene's up vector (3,), along which z points where the shape's coordinates are `up`.

    Raises:
        InputError: the box is empty, or the radius is not above zero.
    """
    points = _in_coordinates(means, shape.coordinates, up)
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


def _in_coordinates(means: FloatArray, coordinates: Coordinates, up: Float64Array) -> Float64Array:
    points = means.astype(np.float64)
    return points @ up_frame(up).T if coordinates == "up" else points
