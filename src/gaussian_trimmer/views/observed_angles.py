"""From where the training cameras saw an object: which of them did, and the span of yaws and pitches they cover."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.geometry.bounds import Bounds

FULL_CIRCLE_GAP = np.radians(100)
"""Training cameras without a wider gap between their yaws stand all around the object."""
_MIN_SPAN = np.radians(20)
"""Smallest span of yaws: one camera, or several close together, saw nearly as much from a little to either side."""
MAX_PITCH = np.radians(80)
"""Largest pitch of planned views. The yaw of a steeper training camera says nothing, since it looks from above."""


def cameras_that_see(cameras: Sequence[Camera], bounds: Bounds) -> list[Camera]:
    """Return the cameras whose pictures may show the object, in their order.

    The centre of the object's bounds, or one of the eight points halfway to their corners, lies before the camera and
    within its picture. Whether something else stands before the object is not asked.
    """
    points = np.concatenate([bounds.centre[None], (bounds.corners() + bounds.centre) / 2])
    return [camera for camera in cameras if _shows_any(camera, points)]


def observed_angles(cameras: Sequence[Camera], bounds: Bounds, preferred_pitch: float) -> tuple[float, float, float]:
    """Return first yaw, span of yaws, and the pitch nearest to the preferred one that the cameras cover, in radians.

    Args:
        cameras: training cameras that see the object, at least one.
        bounds: the object's; yaws and pitches are those around its centre, in the frame of its axes.
        preferred_pitch: what to look from where the cameras looked from both above and below it, in radians.
    """
    offsets = (np.array([camera.centre for camera in cameras]) - bounds.centre) @ bounds.axes.T
    pitches = np.arctan2(offsets[:, 2], np.linalg.norm(offsets[:, :2], axis=1))
    pitch = float(np.clip(np.clip(preferred_pitch, *np.percentile(pitches, [25, 75])), -MAX_PITCH, MAX_PITCH))
    aside = offsets[np.abs(pitches) <= MAX_PITCH]
    if not len(aside):
        return 0.0, 2 * np.pi, pitch
    first, gap = widest_gap(np.arctan2(aside[:, 1], aside[:, 0]))
    if gap <= FULL_CIRCLE_GAP:
        return 0.0, 2 * np.pi, pitch
    span = float(2 * np.pi - gap)
    if span < _MIN_SPAN:
        first, span = first - (_MIN_SPAN - span) / 2, float(_MIN_SPAN)
    return first, span, pitch


def widest_gap(yaws: Float64Array) -> tuple[float, float]:
    """Return the yaw after the widest gap between some yaws (V,), and the width of this gap, in radians.

    >>> widest_gap(np.array([0.0, 1.0, 1.5]))
    (0.0, 4.783185307179586)
    """
    ordered = np.sort(yaws)
    gaps = np.diff(np.append(ordered, ordered[0] + 2 * np.pi))
    widest = int(np.argmax(gaps))
    return float(ordered[(widest + 1) % len(ordered)]), float(gaps[widest])


def _shows_any(camera: Camera, points: Float64Array) -> bool:
    """Return whether one of some points (P, 3) lies in the camera's picture."""
    return bool(camera.contains(camera.project(points)[0]).any())
