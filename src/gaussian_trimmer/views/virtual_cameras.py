"""Virtual Camera Planning (VCP): cameras on a circle around the object, all facing its centre."""

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
from gaussian_trimmer.views.observed_angles import cameras_that_see, observed_angles

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
    axes = up_frame(up)
    bounds = plain_bounds(target, axes) if config.framing == "literal" else robust_bounds(target, axes)
    check_size(bounds.radius)
    yaws, pitch = _angles(bounds, config, cameras_that_see(training_cameras, bounds))
    fov = float(np.radians(config.fov_degrees))
    centre = bounds.centre if config.framing == "fit" else target.means.astype(np.float64).mean(0)
    distance = framing_distance(bounds, yaws, pitch, fov, config.fill, centre)
    if config.framing == "literal":
        length, width, height = 2 * bounds.half_extents
        distance = max(config.lambda_1 * max(length, width), config.lambda_2 * height)
    return ring(centre, axes, distance, yaws, pitch, Lens(config.size, fov, NEAR_RADII * bounds.radius)), bounds


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
