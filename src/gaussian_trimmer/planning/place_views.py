"""Small views of the place where an object stands, from wherever it was seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.planning.camera_rings import NEAR_RADII, Lens, framing_distance, ring
from gaussian_trimmer.planning.outline_views import angles_around, observed_arc
from gaussian_trimmer.planning.virtual_cameras import PlanConfig

_PITCHES_DEGREES = (12.0, 45.0)
_PITCH_MARGIN_DEGREES = 10.0
"""How far above and below the planned views these may be where a part of the circle was not seen."""
_VIEWS_A_PITCH = 5
_SIZE_PIXELS = 256


def views_of_place(planned: Sequence[Camera], bounds: Bounds) -> list[Camera]:
    """Small views from two heights, over the part of the circle that the planned views look from.

    The views of the upper height stand in between those of the lower one.

    Args:
        planned: views that were planned for the object, at least one; a single one says nothing of the circle.
        bounds: the object's bounds, which the views frame; their third axis is up.
    """
    yaws, pitches = angles_around(planned, bounds)
    first, span = observed_arc(yaws) if len(yaws) > 1 else (0.0, 2 * np.pi)
    all_around = span >= 2 * np.pi
    heights, steps = np.radians(_PITCHES_DEGREES), np.arange(_VIEWS_A_PITCH)
    if not all_around:
        middle, margin = float(np.median(pitches)), np.radians(_PITCH_MARGIN_DEGREES)
        heights = np.clip(heights, middle - margin, middle + margin)
    fov, cameras = float(np.radians(PlanConfig.fov_degrees)), []
    lens = Lens(_SIZE_PIXELS, fov, NEAR_RADII * bounds.radius)
    for i, pitch in enumerate(heights):
        if all_around:
            places = 2 * np.pi * (steps + 0.5 * i) / _VIEWS_A_PITCH
        else:
            places = first + span * (steps + 0.25 + 0.5 * i) / _VIEWS_A_PITCH
        distance = framing_distance(bounds, places, pitch, fov, PlanConfig.fill)
        cameras += ring(bounds.centre, bounds.axes, distance, places, pitch, lens)
    return cameras
