"""The flat surfaces that an object stands on, hangs on or leans against: table, floor, wall, the corner of two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.planes import MIN_INLIERS, Plane, find_plane, floor_and_wall_directions

THICKNESS_RADII = 0.05
"""Half of a surface's thickness, in object radii."""
_REACH_RADII = 2.0
"""Distance from the object's centre within which surfaces are looked for, in object radii."""
_BELOW_RADII, _ABOVE_RADII = 0.4, 0.1
"""How far a surface may lie beyond the object's end, and before it, in object radii."""
_END_QUANTILE = 0.02
"""Share of what is seen of the object that may lie beyond its end, so that floaters do not count."""
_BIN_RADII = 0.02
_MIN_SHARE = 0.12
"""Smallest share that a surface must hold of what is seen around the object from before it: floors and walls of the
benchmark's scenes hold 0.16 and more, other layers 0.09 and less."""
_MIN_ABOVE = 0.9
"""Smallest share of the object's Gaussians that must lie on the surface's side."""
_LEAST_RISE = 0.15
"""Sine of the angle above a surface from which on a view sees it; those from its edge look into walls."""
_MAX_SURFACES = 3
_MAX_ALIKE = 0.9
"""Cosine of the angle between surfaces from which on they are one: of a cloth and its table, the cloth counts."""

_MAX_OPPOSED = -0.5
"""The same of surfaces that face each other, which an object cannot both lean against and be seen."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A plane, and a frame in it, with lengths in object radii."""

    origin: Float64Array
    """The point of the plane nearest to the object's centre, (3,)."""
    axes: Float64Array
    """Unit vectors: two in the plane and its normal, which points to the object; right-handed, (3, 3)."""
    unit: float
    """The object's radius in scene units."""

    def coordinates(self, points: FloatArray | Float64Array) -> Float64Array:
        """Return two coordinates in the plane and the height above it of points (N, 3), in object radii."""
        return np.asarray((points - self.origin) @ self.axes.T / self.unit)

    def heights(self, points: FloatArray | Float64Array) -> Float64Array:
        """Return heights of points (N, 3) above the plane, in object radii, (N,)."""
        return np.asarray((points - self.origin) @ self.axes[2] / self.unit)

    def points(self, coordinates: Float64Array) -> Float64Array:
        """Return the points of the scene with given coordinates (N, 3)."""
        return np.asarray(coordinates @ self.axes * self.unit + self.origin)


def find_surfaces(
    means: FloatArray, members: BoolArray, visible: FloatArray, eyes: Float64Array, bounds: Bounds
) -> list[Surface]:
    """Return the flat surfaces that an object touches, the largest first: at most one horizontal one, and walls.

    Only views from before a surface count: behind walls hangs what no photograph shows.

    Args:
        means: centres of the object's Gaussians and of those around it, (N, 3).
        members: which of them are the object, (N,).
        visible: blend weight of each in V views from all around, (V, N).
        eyes: where these look from, (V, 3).
        bounds: the object's bounds; their third axis is up.
    """
    local = (means - bounds.centre) @ bounds.axes.T / bounds.radius
    around = ~members & visible.any(axis=0) & (np.linalg.norm(local, axis=1) < _REACH_RADII)
    if around.sum() < MIN_INLIERS or not members.any():
        return []
    points, object_points, eyes = local[around], local[members], (eyes - bounds.centre) @ bounds.axes.T
    eyes /= np.linalg.norm(eyes, axis=1, keepdims=True)
    free, directions, found = np.ones(len(points), np.bool_), floor_and_wall_directions(), list[Plane]()

    @cache
    def weights_from(side: bytes) -> tuple[Float64Array, Float64Array]:
        seen = visible[np.frombuffer(side, np.bool_)].sum(axis=0, dtype=np.float64)
        return seen[around], seen[members]

    def weights_from_before(direction: Float64Array) -> tuple[Float64Array, Float64Array]:
        return weights_from((eyes @ direction > _LEAST_RISE).tobytes())

    def weights_at_the_end(direction: Float64Array) -> Float64Array:
        weights, of_object = weights_from_before(direction)
        end, heights = _low_quantile(object_points @ direction, of_object), points @ direction
        return np.where(free & (heights > end - _BELOW_RADII) & (heights < end + _ABOVE_RADII), weights, 0)

    while len(directions) and len(found) < _MAX_SURFACES:
        plane, guess, _ = find_plane(points, directions, weights_at_the_end, _BIN_RADII, THICKNESS_RADII)
        weights, of_object = weights_from_before(guess.normal)
        if weights @ (np.abs(plane.signed_distance(points)) < THICKNESS_RADII) <= _MIN_SHARE * weights.sum():
            break
        if of_object @ (plane.signed_distance(object_points) > -THICKNESS_RADII) >= _MIN_ABOVE * of_object.sum():
            found.append(plane)
            free &= np.abs(plane.signed_distance(points)) > 2 * THICKNESS_RADII
        alike = directions @ plane.normal
        directions = directions[(alike < _MAX_ALIKE) & (alike > _MAX_OPPOSED)]
    return [_surface(plane, bounds) for plane in found]


def _low_quantile(heights: Float64Array, weights: Float64Array) -> float:
    """Return the height below which only a small share of the weight lies, to a quarter of a bin."""
    lowest, bin_height = float(heights.min()), _BIN_RADII / 4
    held = np.cumsum(np.bincount(((heights - lowest) / bin_height).astype(np.int64), weights))
    return lowest + bin_height * float(np.searchsorted(held, _END_QUANTILE * held[-1]))


def _surface(plane: Plane, bounds: Bounds) -> Surface:
    """Return a plane of the bounds' own coordinates, in object radii, with a frame in it."""
    normal = plane.normal
    across = np.eye(3)[0] if abs(normal[0]) < _MAX_ALIKE else np.eye(3)[1]
    first = np.cross(across, normal)
    first /= np.linalg.norm(first)
    frame = np.stack([first, np.cross(normal, first), normal])
    return Surface(
        bounds.centre + plane.offset * bounds.radius * normal @ bounds.axes, frame @ bounds.axes, bounds.radius
    )


def above_all(surfaces: Sequence[Surface], points: FloatArray | Float64Array, margin: float) -> BoolArray:
    """Return the points (N, 3) that lie higher than a margin, in object radii, above every surface, (N,)."""
    above = np.ones(len(points), np.bool_)
    for surface in surfaces:
        above &= surface.heights(points) > margin
    return above
