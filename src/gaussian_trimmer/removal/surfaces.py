"""The flat surfaces that an object stands on, hangs on or leans against: table, floor, wall, the corner of two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
"""Quantile of the object's positions along a direction that is taken for its end, so that floaters do not count."""
_BIN_RADII = 0.02
_MIN_SHARE = 0.1
"""Smallest share that a surface must hold of the visible Gaussians around the object."""
_MIN_ABOVE = 0.9
"""Smallest share of the object's Gaussians that must lie on the surface's side."""
_MAX_SURFACES = 3
_MAX_ALIKE = 0.9
"""Cosine of the angle between surfaces from which on they are one: of a cloth and its table, the cloth counts."""


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


def find_surfaces(means: FloatArray, members: BoolArray, visible: FloatArray, bounds: Bounds) -> list[Surface]:
    """Return the flat surfaces that an object touches, the largest first: at most one horizontal one, and walls.

    Args:
        means: centres of the object's Gaussians and of those around it, (N, 3).
        members: which of them are the object, (N,).
        visible: blend weight of each in views from all around, (N,).
        bounds: the object's bounds; their third axis is up.
    """
    local = (means - bounds.centre) @ bounds.axes.T / bounds.radius
    around = ~members & (visible > 0) & (np.linalg.norm(local, axis=1) < _REACH_RADII)
    if around.sum() < MIN_INLIERS or not members.any():
        return []
    points, weights, object_points = local[around], visible[around].astype(np.float64), local[members]
    total, free = weights.sum(), np.ones(len(points), np.bool_)
    directions, found = floor_and_wall_directions(), list[Plane]()

    def where_the_object_ends(direction: Float64Array) -> BoolArray:
        end, heights = np.quantile(object_points @ direction, _END_QUANTILE), points @ direction
        return np.asarray(free & (heights > end - _BELOW_RADII) & (heights < end + _ABOVE_RADII))

    while len(directions) and len(found) < _MAX_SURFACES:
        plane, _, held = find_plane(points, weights, directions, where_the_object_ends, _BIN_RADII, THICKNESS_RADII)
        if held.max() < _MIN_SHARE * total:
            break
        if (plane.signed_distance(object_points) > -THICKNESS_RADII).mean() >= _MIN_ABOVE:
            found.append(plane)
            free &= np.abs(plane.signed_distance(points)) > 2 * THICKNESS_RADII
        directions = directions[directions @ plane.normal < _MAX_ALIKE]
    return [_surface(plane, bounds) for plane in found]


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
