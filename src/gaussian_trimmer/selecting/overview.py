"""Views to click in, for scenes without cameras: from all around the part with most detail, and of all of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.geometry.bounds import up_frame
from gaussian_trimmer.planning.virtual_cameras import PlanConfig, plan_cameras
from gaussian_trimmer.selecting.marks import Viewpoint
from gaussian_trimmer.settings import Range, Vector

_MIDDLE_SHARE = 0.25
"""Share of the Gaussians nearest to the middle that the views frame."""
_WHOLE_SHARE = 0.95
"""Share of the Gaussians whose distance tells whether a capture is compact."""
_COMPACT = 3.2
"""A capture is compact, as of a single object, if it has the latter share within this many radii of the former."""
_REACH = 3.0
"""Gaussians farther from the middle than this many radii of what is framed are left out: walls would hide the rest."""
_ENDS = (0.005, 0.995)
"""Quantiles of the centres along each axis between which the whole capture lies."""
_ROUNDS = 5
_SIZE, _FOV_DEGREES = 640, 60.0
_PITCH_DEGREES = 30.0
_MIDDLE_FILL, _WHOLE_FILL = 0.6, 0.9
_TARGET_DISTANCE = 3.0
"""Distance of the views around a given point, in radii of the part with most detail."""
_NEAR = 0.01


@dataclass(frozen=True)
class OverviewConfig:
    """Where the views to click in stand, for scenes without cameras."""

    pitch: Annotated[float, Range(-89, 89)] = _PITCH_DEGREES
    """Degrees above the horizon from which the views look."""
    distance: Annotated[float, Range(0.01, 100)] = 1.0
    """Distance of the views from what they look at, relative to the usual one; 0.5 is twice as near."""
    target: Vector | None = None
    """Point X Y Z of the scene that the views look at, in place of its middle."""
    ring: Annotated[int, Range(1, 100)] = 8
    """Number of views around."""


@dataclass(frozen=True, eq=False)
class Overview:
    """Views around the middle of a scene and, where these do not show all of it, of the whole capture."""

    views: list[Viewpoint]
    whole: range
    """Numbers of those that frame the whole capture."""


def plan_overview(gaussians: Gaussians, up: Float64Array, config: OverviewConfig = OverviewConfig()) -> Overview:
    """Views on a circle around the middle of a scene, and after them as many of the whole capture.

    Training makes many small Gaussians where there is detail and few large ones elsewhere, so the middle is where the
    centres are densest, found by repeated medians of the nearest ones. A compact capture, as of a single object, is
    framed as a whole by the first views.

    Args:
        up: the scene's up vector, (3,).
        config: where the views stand.
    """
    middle_point = _middle(gaussians.means)
    distance = np.linalg.norm(gaussians.means - middle_point, axis=1)
    middle, whole = (float(radius) for radius in np.quantile(distance, [_MIDDLE_SHARE, _WHOLE_SHARE]))
    x, y, z = (float(value) for value in middle_point)
    if config.target is not None:
        return _around_target(config, middle, up)
    compact = whole < _COMPACT * middle
    framed = gaussians if compact else gaussians.select(distance <= np.float32(middle))
    cameras = _ring(framed, up, config, _WHOLE_FILL if compact else _MIDDLE_FILL)
    reach = _REACH * (whole if compact else middle) * max(1.0, config.distance)
    views = [Viewpoint(camera, (x, y, z), reach) for camera in cameras]
    if compact:
        return Overview(views, range(len(views)))
    all_of_it = [Viewpoint(camera) for camera in _ring_of_all(gaussians, up, config)]
    return Overview(views + all_of_it, range(len(views), 2 * len(views)))


def drawn_rows(means: FloatArray, view: Viewpoint) -> IntArray:
    """Rows of the Gaussians, with centres (N, 3), that are drawn in a view; the others may be in front of them."""
    if view.drawn_centre is None:
        return np.arange(len(means))
    distance = np.linalg.norm(means - np.array(view.drawn_centre, np.float32), axis=1)
    return np.flatnonzero(distance <= np.float32(view.drawn_radius))


def _ring(framed: Gaussians, up: Float64Array, config: OverviewConfig, fill: float) -> list[Camera]:
    plan = PlanConfig(
        views=config.ring, size=_SIZE, pitch_degrees=config.pitch, fill=fill, fov_degrees=_FOV_DEGREES
    )  # fmt: skip
    cameras, bounds = plan_cameras(framed, up, plan)
    if config.distance == 1:
        return cameras
    axes = up_frame(up)
    moved = [bounds.centre + config.distance * (camera.centre - bounds.centre) for camera in cameras]
    return [
        Camera(look_at(place, bounds.centre, axes[2]), camera.K, camera.width, camera.height, near=camera.near)
        for place, camera in zip(moved, cameras, strict=True)
    ]


def _ring_of_all(gaussians: Gaussians, up: Float64Array, config: OverviewConfig) -> list[Camera]:
    """Views of the box that holds nearly all centres, wherever they lie dense."""
    axes = up_frame(up)
    ends = np.quantile(gaussians.means.astype(np.float64) @ axes.T, _ENDS, axis=0)
    corners = np.stack(np.meshgrid(*ends.T), -1).reshape(-1, 3) @ axes
    centre = corners.mean(axis=0)
    radius = float(np.linalg.norm(corners - centre, axis=1).max())
    slope = _WHOLE_FILL * np.tan(np.radians(_FOV_DEGREES) / 2)
    outward = _directions(config, axes)
    distance = radius
    for way in outward:
        local = (corners - centre) @ look_at(way, np.zeros(3), axes[2])[:3, :3].T
        distance = max(distance, float((np.abs(local[:, :2]).max(axis=1) / slope - local[:, 2]).max()))
    K = intrinsics(float(np.radians(_FOV_DEGREES)), _SIZE, _SIZE)
    poses = [look_at(centre + config.distance * distance * way, centre, axes[2]) for way in outward]
    return [Camera(pose, K, _SIZE, _SIZE, near=_NEAR * radius) for pose in poses]


def _directions(config: OverviewConfig, axes: Float64Array) -> list[Float64Array]:
    """Unit vectors from what is looked at to the cameras, (3,) each."""
    pitch = np.radians(config.pitch)
    yaws = 2 * np.pi * np.arange(config.ring) / config.ring
    return [np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)]) @ axes for yaw in yaws]


def _around_target(config: OverviewConfig, radius: float, up: Float64Array) -> Overview:
    assert config.target is not None
    axes, centre = up_frame(up), np.array(config.target, np.float64)
    reach = _TARGET_DISTANCE * radius * config.distance
    K = intrinsics(float(np.radians(_FOV_DEGREES)), _SIZE, _SIZE)
    views = []
    for outward in _directions(config, axes):
        pose = look_at(centre + reach * outward, centre, axes[2])
        camera = Camera(pose, K, _SIZE, _SIZE, near=max(_NEAR * radius, 1e-6))
        # What is farther from the point than the camera stands behind walls as often as not.
        views.append(Viewpoint(camera, config.target, 0.95 * reach))
    return Overview(views, range(0))


def _middle(means: FloatArray) -> FloatArray:
    """Where the centres (N, 3) lie densest, (3,)."""
    middle = np.median(means, axis=0)
    for _ in range(_ROUNDS):
        distance = np.linalg.norm(means - middle, axis=1)
        middle = np.median(means[distance <= np.quantile(distance, _MIDDLE_SHARE)], axis=0)
    return np.asarray(middle, np.float32)
