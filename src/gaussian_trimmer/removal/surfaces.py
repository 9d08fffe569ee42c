"""The flat surfaces that an object stands on, hangs on or leans against: table, floor, wall, the corner of two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.support_plane import densest_layer, plane_through

THICKNESS_RADII = 0.05
"""Half of a surface's thickness, in object radii."""
_REACH_RADII = 2.0
"""Distance from the object's centre within which surfaces are looked for, in object radii."""
_BELOW_RADII, _ABOVE_RADII = 0.4, 0.1
"""How far a surface may lie beyond the object's end, and before it, in object radii."""
_END_QUANTILE = 0.02
"""Quantile of the object's positions along a direction that is taken for its end, so that floaters do not count."""
_DIRECTIONS_AROUND = 48
"""Number of horizontal directions that a wall may face."""
_BIN_RADII = 0.02
_MIN_SHARE = 0.1
"""Smallest share that a surface must hold of the visible Gaussians around the object."""
_MIN_ABOVE = 0.9
"""Smallest share of the object's Gaussians that must lie on the surface's side."""
_MAX_SURFACES = 3
_FITTING_ROUNDS = 4
_MAX_TILT_DEGREES = 8.0
"""Largest angle between a surface as it was fitted and the direction that it was found with."""
_MAX_ALIKE = 0.9
"""Cosine of the angle between surfaces from which on they are one: of a cloth and its table, the cloth counts."""
_MIN_GAUSSIANS = 20


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
        """Two coordinates in the plane and the height above it of points (N, 3), in object radii."""
        return np.asarray((points - self.origin) @ self.axes.T / self.unit)

    def heights(self, points: FloatArray | Float64Array) -> Float64Array:
        """Heights of points (N, 3) above the plane, in object radii, (N,)."""
        return np.asarray((points - self.origin) @ self.axes[2] / self.unit)

    def points(self, coordinates: Float64Array) -> Float64Array:
        """Points of the scene with given coordinates (N, 3)."""
        return np.asarray(coordinates @ self.axes * self.unit + self.origin)


def find_surfaces(means: FloatArray, members: BoolArray, visible: FloatArray, bounds: Bounds) -> list[Surface]:
    """The flat surfaces that an object touches, the largest first: at most one horizontal one, and walls.

    Args:
        means: centres of the object's Gaussians and of those around it, (N, 3).
        members: which of them are the object, (N,).
        visible: blend weight of each in views from all around, (N,).
        bounds: the object's bounds; their third axis is up.
    """
    local = (means - bounds.centre) @ bounds.axes.T / bounds.radius
    around = ~members & (visible > 0) & (np.linalg.norm(local, axis=1) < _REACH_RADII)
    if around.sum() < _MIN_GAUSSIANS or not members.any():
        return []
    points, weights, object_points = local[around], visible[around].astype(np.float64), local[members]
    total, free = weights.sum(), np.ones(len(points), np.bool_)
    turns = 2 * np.pi * np.arange(_DIRECTIONS_AROUND) / _DIRECTIONS_AROUND
    walls = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(len(turns))])
    directions = np.concatenate([[[0.0, 0.0, 1.0]], walls])
    found: list[tuple[Float64Array, float]] = []
    while len(directions) and len(found) < _MAX_SURFACES:
        free_points, free_weights = points[free], weights[free]
        layers = [_layer(free_points @ n, free_weights, object_points @ n) for n in directions]
        held = [layer[1] if layer else 0.0 for layer in layers]
        best = int(np.argmax(held))
        layer = layers[best]
        if layer is None or held[best] < _MIN_SHARE * total:
            break
        normal, offset = _fitted(free_points, free_weights, directions[best], layer[0])
        if (object_points @ normal > offset - THICKNESS_RADII).mean() >= _MIN_ABOVE:
            found.append((normal, offset))
            free &= np.abs(points @ normal - offset) > 2 * THICKNESS_RADII
        directions = directions[directions @ normal < _MAX_ALIKE]
        if free.sum() < _MIN_GAUSSIANS:
            break
    return [_surface(normal, offset, bounds) for normal, offset in found]


def _layer(heights: Float64Array, weights: Float64Array, of_object: Float64Array) -> tuple[float, float] | None:
    """Height and weight of the densest layer where the object ends in one direction; None if there is none."""
    end = float(np.quantile(of_object, _END_QUANTILE))
    near = (heights > end - _BELOW_RADII) & (heights < end + _ABOVE_RADII)
    if near.sum() < _MIN_GAUSSIANS:
        return None
    return densest_layer(heights[near], weights[near], end - _BELOW_RADII, end + _ABOVE_RADII, _BIN_RADII)


def _fitted(
    points: Float64Array, weights: Float64Array, normal: Float64Array, offset: float
) -> tuple[Float64Array, float]:
    """Normal and offset of the plane through the points near a first guess, by weighted least squares."""
    first = normal
    for _ in range(_FITTING_ROUNDS):
        near = np.abs(points @ normal - offset) < THICKNESS_RADII
        if near.sum() < _MIN_GAUSSIANS:
            break
        plane = plane_through(points[near], weights[near], first, np.cos(np.radians(_MAX_TILT_DEGREES)))
        if plane is None:
            break
        normal, offset = plane
    return normal, offset


def _surface(normal: Float64Array, offset: float, bounds: Bounds) -> Surface:
    across = np.eye(3)[0] if abs(normal[0]) < _MAX_ALIKE else np.eye(3)[1]
    first = np.cross(across, normal)
    first /= np.linalg.norm(first)
    frame = np.stack([first, np.cross(normal, first), normal])
    return Surface(bounds.centre + offset * bounds.radius * normal @ bounds.axes, frame @ bounds.axes, bounds.radius)


def above_all(surfaces: Sequence[Surface], points: FloatArray | Float64Array, margin: float) -> BoolArray:
    """Which points (N, 3) lie higher than a margin, in object radii, above every surface, (N,)."""
    above = np.ones(len(points), np.bool_)
    for surface in surfaces:
        above &= surface.heights(points) > margin
    return above
