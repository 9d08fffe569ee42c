"""Small views of the place where an object stands."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.planning.camera_rings import NEAR_RADII, Lens, framing_distance, ring
from gaussian_trimmer.planning.virtual_cameras import PlanConfig

_PITCHES_DEGREES = (12.0, 40.0, 70.0)
_VIEWS_A_PITCH = 5


def views_of_place(bounds: Bounds, size: int) -> list[Camera]:
    """Small views from all sides at three heights, those of each between those of the others.

    They go around the whole circle even where the object was seen from one side only: with views of that side alone,
    hidden Gaussians behind the object pass for parts of it (docs/decisions/filled-background.md).

    Args:
        bounds: the object's bounds, which the views frame; their third axis is up.
        size: width and height of the views in pixels.
    """
    fov, cameras = float(np.radians(PlanConfig.fov_degrees)), []
    lens = Lens(size, fov, NEAR_RADII * bounds.radius)
    for i, pitch in enumerate(np.radians(_PITCHES_DEGREES)):
        yaws = 2 * np.pi * (np.arange(_VIEWS_A_PITCH) + i / len(_PITCHES_DEGREES)) / _VIEWS_A_PITCH
        distance = framing_distance(bounds, yaws, pitch, fov, PlanConfig.fill)
        cameras += ring(bounds.centre, bounds.axes, distance, yaws, pitch, lens)
    return cameras
