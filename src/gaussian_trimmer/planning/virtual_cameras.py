"""Virtual Camera Planning (VCP): cameras on a circle around the object, all facing its centre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array, Gaussians
from gaussian_trimmer.geometry.bounds import Bounds, plain_bounds, robust_bounds, up_frame
from gaussian_trimmer.planning.observed_angles import cameras_that_see, observed_angles

_NEAR = 0.01
"""Near plane of planned cameras in object radii, so that it works in scenes of any unit."""


@dataclass(frozen=True)
class PlanConfig:
    """Where the virtual cameras stand."""

    views: int = 5
    """Number of virtual views, n in the paper."""
    framing: Literal["fit", "paper"] = "fit"
    """`fit`: the object fills the frame; `paper`: distance by eq. 3 from the plain centroid, eq. 2."""
    size: int = 512
    """Width and height of the virtual views in pixels."""
    fov_degrees: float = 60.0
    """Field of view of the virtual cameras."""
    pitch_degrees: float | None = None
    """Angle above the horizon. If it is not given: 30, moved into the range of the training cameras, if any."""
    yaw_range_degrees: tuple[float, float] | None = None
    """First and last yaw. If they are not given: the full circle, or the range of the training cameras."""
    fill: float = 0.75
    """Share of the frame's width or height that the object's robust bounds fill (`fit`)."""
    lambda_1: float = 20.0
    """Distance per horizontal extent (`paper`, eq. 3)."""
    lambda_2: float = 6.0
    """Distance per vertical extent (`paper`, eq. 3)."""


def plan_cameras(
    target: Gaussians, up: Float64Array, config: PlanConfig = PlanConfig(), training_cameras: Sequence[Camera] = ()
) -> tuple[list[Camera], Bounds]:
    """Cameras around the coarse object, ordered by yaw, and the bounds that they frame.

    Args:
        target: the coarse object.
        up: the scene's up vector, (3,), of any length.
        config: framing, number of views and angles.
        training_cameras: training cameras, if known; those that see the object limit yaw and pitch to the range that
            was observed.

    Raises:
        InputError: a setting is out of its range, or the up vector is zero.
    """
    _check(config)
    axes = up_frame(up)
    bounds = plain_bounds(target, axes) if config.framing == "paper" else robust_bounds(target, axes)
    yaws, pitch = _angles(bounds, config, cameras_that_see(training_cameras, bounds))
    directions = np.stack(
        [np.cos(yaws) * np.cos(pitch), np.sin(yaws) * np.cos(pitch), np.full_like(yaws, np.sin(pitch))], -1
    )
    outward = directions @ axes
    fov = np.radians(config.fov_degrees)
    centre, distance = bounds.centre, _fitting_distance(bounds, outward, axes[2], fov, config.fill)
    if config.framing == "paper":
        centre = target.means.astype(np.float64).mean(0)
        length, width, height = 2 * bounds.half_extents
        distance = max(config.lambda_1 * max(length, width), config.lambda_2 * height)
    K = intrinsics(fov, config.size, config.size)
    poses = [look_at(centre + distance * direction, centre, axes[2]) for direction in outward]
    return [Camera(pose, K, config.size, config.size, near=_NEAR * bounds.radius) for pose in poses], bounds


def _check(config: PlanConfig) -> None:
    if config.views < 1:
        raise InputError(f"The number of views is {config.views}; at least one is needed.")
    if config.framing not in ("fit", "paper"):
        raise InputError(f"Unknown framing '{config.framing}'; available: fit, paper.")
    if not 16 <= config.size <= 8192:
        raise InputError(f"The virtual views are {config.size} pixels wide; 16 to 8192 are possible.")
    if not 1 <= config.fov_degrees <= 150:
        raise InputError(f"The field of view is {config.fov_degrees} degrees; 1 to 150 are possible.")
    if not 0.05 <= config.fill <= 1:
        raise InputError(f"The object is to fill {config.fill} of the frame; 0.05 to 1 are possible.")
    if config.pitch_degrees is not None and not -89 <= config.pitch_degrees <= 89:
        raise InputError(f"The pitch is {config.pitch_degrees} degrees; -89 to 89 are possible.")


def _angles(bounds: Bounds, config: PlanConfig, training_cameras: Sequence[Camera]) -> tuple[Float64Array, float]:
    """Yaws (V,) and the pitch, in radians."""
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


def _fitting_distance(bounds: Bounds, outward: Float64Array, up: Float64Array, fov: float, fill: float) -> float:
    """The smallest distance at which the bounds' corners lie within the middle `fill` of every view.

    A corner x right or down of the axis and z behind the centre is inside at distance r where
    x <= fill tan(fov / 2) (r + z), which is solved for r.
    """
    distances = []
    for direction in outward:
        local = (bounds.corners() - bounds.centre) @ look_at(direction, np.zeros(3), up)[:3, :3].T
        distances.append(np.abs(local[:, :2]).max(axis=1) / (fill * np.tan(fov / 2)) - local[:, 2])
    return float(np.max(distances))
