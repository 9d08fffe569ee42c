"""Small views of the place where an object stands."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.planning.camera_rings import NEAR_RADII, Lens, framing_distance, ring
from gaussian_trimmer.planning.virtual_cameras import PlanConfig

_RINGS = ((12.0, 4), (45.0, 4))
"""Pitches in degrees, and how many views have each."""
_RINGS_ABOVE = ((70.0, 5),)


def views_of_place(bounds: Bounds, size: int, above: bool = False) -> list[Camera]:
    """Small views from all sides at two heights, those of the upper one between those of the lower one.

    They go around the whole circle even where the object was seen from one side only: with views of that side alone,
    hidden Gaussians behind the object pass for parts of it (docs/decisions/filled-background.md).

    Args:
        bounds: the object's bounds, which the views frame; their third axis is up.
        size: width and height of the views in pixels.
        above: steep views in place of these, which see the ground before walls and in corners.
    """
    fov, cameras = float(np.radians(PlanConfig.fov_degrees)), []
    lens = Lens(size, fov, NEAR_RADII * bounds.radius)
    for i, (pitch, count) in enumerate(_RINGS_ABOVE if above else _RINGS):
        yaws = 2 * np.pi * (np.arange(count) + 0.5 * i) / count
        distance = framing_distance(bounds, yaws, np.radians(pitch), fov, PlanConfig.fill)
        cameras += ring(bounds.centre, bounds.axes, distance, yaws, np.radians(pitch), lens)
    return cameras
