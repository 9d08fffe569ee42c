"""Virtual Camera Planning (VCP): cameras on a circle around the object, all facing its centre.

Where training cameras are known, they stand within the span of yaws and pitches from which these saw the object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from gaussian_trimmer.cameras import Camera, up_frame
from gaussian_trimmer.gaussians import Float64Array, Gaussians
from gaussian_trimmer.geometry.bounds import Bounds, plain_bounds, robust_bounds
from gaussian_trimmer.geometry.limits import check_size
from gaussian_trimmer.settings import Range
from gaussian_trimmer.views.camera_rings import NEAR_RADII, Lens, framing_distance, ring

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


_Yaw = Annotated[float, Range(-720, 720)]
_Lambda = Annotated[float, Range(1e-3, 1e4)]


@dataclass(frozen=True)
class PlanConfig:
    """Where the virtual cameras stand."""

    views: Annotated[int, Range(1, 1000)] = 5
    """Number of virtual views, n in the paper."""
    framing: Literal["fit", "paper", "literal"] = "fit"
    """`fit`: the object fills the frame; `paper`: it does, around its plain centroid, eq. 2; `literal`: from the
    distance of eq. 3 as it is printed, at which it is some twenty pixels wide (docs/paper.md)."""
    size: Annotated[int, Range(16, 8192)] = 512
    """Width and height of the virtual views in pixels."""
    fov_degrees: Annotated[float, Range(1, 150)] = 60.0
    """Field of view of the virtual cameras."""
    pitch_degrees: Annotated[float, Range(-89, 89)] | None = None
    """Angle above the horizon. If it is not given: 30, moved into the range of the training cameras, if any."""
    yaw_range_degrees: tuple[_Yaw, _Yaw] | None = None
    """First and last yaw. If they are not given: the full circle, or the range of the training cameras."""
    fill: Annotated[float, Range(0.05, 1)] = 0.75
    """Share of the frame's width or height that the object's robust bounds fill (`fit`, `paper`)."""
    lambda_1: _Lambda = 20.0
    """Distance per horizontal extent (`literal`, eq. 3)."""
    lambda_2: _Lambda = 6.0
    """Distance per vertical extent (`literal`, eq. 3)."""

    @property
    def is_free(self) -> bool:
        """Whether the views may be chosen by what they show, since nothing is said of where they stand."""
        return self.framing == "fit" and self.pitch_degrees is None and self.yaw_range_degrees is None


def plan_cameras(
    target: Gaussians, up: Float64Array, config: PlanConfig = PlanConfig(), training_cameras: Sequence[Camera] = ()
) -> tuple[list[Camera], Bounds]:
    """Return cameras around the selected object, ordered by yaw, and the bounds that they frame.

    Args:
        target: the selected object.
        up: the scene's up vector, (3,), of any length.
        config: framing, number of views and angles.
        training_cameras: training cameras, if known; those that see the object limit yaw and pitch to the range that
            was observed.

    Raises:
        InputError: the up vector is zero, or the object is too small or too large.
    """
    bounds = framed_bounds(target, up, config)
    return cameras_around(target, bounds, config, cameras_that_see(training_cameras, bounds)), bounds


def framed_bounds(target: Gaussians, up: Float64Array, config: PlanConfig) -> Bounds:
    """Return the bounds that planned cameras frame."""
    axes = up_frame(up)
    bounds = plain_bounds(target, axes) if config.framing == "literal" else robust_bounds(target, axes)
    check_size(bounds.radius)
    return bounds


def cameras_around(target: Gaussians, bounds: Bounds, config: PlanConfig, seeing: Sequence[Camera]) -> list[Camera]:
    """Return planned cameras that frame some bounds, where the training cameras that see the object stood, if any."""
    yaws, pitch = _angles(bounds, config, seeing)
    fov = float(np.radians(config.fov_degrees))
    centre = bounds.centre if config.framing == "fit" else target.means.astype(np.float64).mean(0)
    distance = framing_distance(bounds, yaws, pitch, fov, config.fill, centre)
    if config.framing == "literal":
        length, width, height = 2 * bounds.half_extents
        distance = max(config.lambda_1 * max(length, width), config.lambda_2 * height)
    return ring(centre, bounds.axes, distance, yaws, pitch, Lens(config.size, fov, NEAR_RADII * bounds.radius))


def _angles(bounds: Bounds, config: PlanConfig, training_cameras: Sequence[Camera]) -> tuple[Float64Array, float]:
    """Return yaws (V,) and the pitch, in radians."""
    pitch, first, span = np.radians(30.0), 0.0, 2 * np.pi
    if training_cameras:
        first, span, pitch = observed_angles(training_cameras, bounds, pitch)
    if config.pitch_degrees is not None:
        pitch = float(np.radians(config.pitch_degrees))
    if config.yaw_range_degrees is not None:
        first, last = np.radians(config.yaw_range_degrees)
        span = last - first
    if span >= 2 * np.pi - 1e-6:
        return first + 2 * np.pi * np.arange(config.views) / config.views, pitch
    return first + span * (np.arange(config.views) + 0.5) / config.views, pitch
