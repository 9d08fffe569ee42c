"""Cameras on circles around a point, all facing it: every planned view is made here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.geometry.bounds import Bounds

NEAR_RADII = 0.01
"""Distance of the near plane in object radii, so that planned cameras work in scenes of any unit."""


@dataclass(frozen=True)
class Lens:
    """Image size and field of view of square cameras."""

    size: int
    """Width and height in pixels."""
    fov_radians: float
    near: float
    """Distance of the near plane, in scene units."""


def ring(
    centre: Float64Array,
    axes: Float64Array,
    distance: float,
    yaws: Float64Array,
    pitches: Float64Array | float,
    lens: Lens,
) -> list[Camera]:
    """Return cameras at given angles and one distance from a point that they all face.

    Args:
        centre: the point, (3,).
        axes: two horizontal axes and up as rows, (3, 3).
        distance: in scene units.
        yaws: angles about up, in radians, (V,).
        pitches: angles above the horizon, in radians, (V,) or one for all.
        lens: of all cameras.
    """
    K = intrinsics(lens.fov_radians, lens.size, lens.size)
    poses = ring_poses(centre, axes, distance, yaws, pitches)
    return [Camera(pose, K, lens.size, lens.size, near=lens.near) for pose in poses]


def framing_ring(
    bounds: Bounds, yaws: Float64Array, pitches: Float64Array | float, size: int, fov_radians: float, fill: float
) -> list[Camera]:
    """Return cameras of a `ring` about bounds, which lie within the middle `fill` of every view, of `size` pixels."""
    distance = framing_distance(bounds, yaws, pitches, fov_radians, fill)
    lens = Lens(size, fov_radians, NEAR_RADII * bounds.radius)
    return ring(bounds.centre, bounds.axes, distance, yaws, pitches, lens)


def ring_poses(
    centre: Float64Array, axes: Float64Array, distance: float, yaws: Float64Array, pitches: Float64Array | float
) -> list[Float64Array]:
    """Return world-to-camera transforms (4, 4) of the cameras of a `ring`."""
    directions = ring_directions(axes, yaws, pitches)
    return [look_at(centre + distance * direction, centre, axes[2]) for direction in directions]


def ring_directions(axes: Float64Array, yaws: Float64Array, pitches: Float64Array | float) -> Float64Array:
    """Return unit vectors from the centre of a `ring` to its cameras, (V, 3)."""
    level = np.cos(pitches)
    local = [np.cos(yaws) * level, np.sin(yaws) * level, np.broadcast_to(np.sin(pitches), yaws.shape)]
    return np.stack(local, axis=-1) @ axes


def framing_distance(
    bounds: Bounds,
    yaws: Float64Array,
    pitches: Float64Array | float,
    fov_radians: float,
    fill: float,
    centre: Float64Array | None = None,
) -> float:
    """Return the smallest distance of a `ring` at which the bounds' corners lie within the middle `fill` of every view.

    The ring is about the bounds' centre, if no other point is given.

    A corner x right or down of the axis and z behind the centre is inside at distance r where
    x <= fill tan(fov / 2) (r + z), which is solved for r.
    """
    centre = bounds.centre if centre is None else centre
    corners, slope, distances = bounds.corners() - centre, fill * np.tan(fov_radians / 2), []
    for direction in ring_directions(bounds.axes, yaws, pitches):
        local = corners @ look_at(direction, np.zeros(3), bounds.axes[2])[:3, :3].T
        distances.append(np.abs(local[:, :2]).max(axis=1) / slope - local[:, 2])
    return float(np.max(distances))
