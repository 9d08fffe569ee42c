"""Virtual Camera Planning (VCP): cameras on a circle around the object, all facing its centre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.connectivity import connected_voxels
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians

_NEAR = 0.01
"""Near plane of planned cameras in object radii, so that neither tiny nor huge units cut anything off."""
_FULL_CIRCLE_GAP = np.radians(100)
_VOXELS_ACROSS = 16
_DOMINANT_SHARE = 0.5
_SECOND_SHARE = 0.25
_BOUND_PERCENTILES = (1.0, 99.0)


@dataclass(frozen=True)
class PlanConfig:
    """Where the virtual cameras stand."""

    views: int = 5
    """Number of virtual views, n in the paper."""
    framing: Literal["fit", "paper"] = "fit"
    """`fit`: the object fills the frame; `paper`: distance by eq. 2 from the plain centroid, eq. 1."""
    size: int = 512
    """Width and height of the virtual views in pixels."""
    fov_degrees: float = 60.0
    """Field of view."""
    pitch_degrees: float | None = None
    """Angle above the horizon; not given: 30, moved into the span of the training cameras where there are any."""
    yaw_range_degrees: tuple[float, float] | None = None
    """First and last yaw; not given: the full circle, or the span of the training cameras."""
    fill: float = 0.75
    """Share of the frame that the object's robust bounds fill (`fit`)."""
    lambda_1: float = 20.0
    """Distance per horizontal extent (`paper`, eq. 2)."""
    lambda_2: float = 6.0
    """Distance per vertical extent (`paper`, eq. 2)."""


@dataclass(frozen=True, eq=False)
class Bounds:
    """Box of an object in the frame of the up vector."""

    centre: Float64Array
    """Centre of the box in the world, (3,)."""
    axes: Float64Array
    """Rows: two horizontal axes and up, in the world, (3, 3)."""
    half_extents: Float64Array
    """Half of length, width and height, (3,)."""

    @property
    def radius(self) -> float:
        """Half of the box's diagonal."""
        return float(np.linalg.norm(self.half_extents))

    def corners(self) -> Float64Array:
        """The eight corners in the world, (8, 3)."""
        signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), -1).reshape(8, 3)
        return np.asarray(self.centre + (signs * self.half_extents) @ self.axes)


def plan_cameras(
    target: Gaussians, up: Float64Array, config: PlanConfig = PlanConfig(), seen_from: Sequence[Camera] = ()
) -> tuple[list[Camera], Bounds]:
    """Cameras around the coarse object, ordered by yaw, and the bounds that they frame.

    Args:
        target: the coarse object.
        up: the scene's up vector, (3,), of any length.
        config: framing, number of views and angles.
        seen_from: training cameras, if known; they limit yaw and pitch to what was really observed.

    Raises:
        InputError: a setting is out of its range, or the up vector is zero.
    """
    _check(config)
    axes = up_frame(up)
    bounds = plain_bounds(target, axes) if config.framing == "paper" else robust_bounds(target, axes)
    yaws, pitch = _angles(bounds, config, seen_from)
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


def up_frame(up: Float64Array) -> Float64Array:
    """Two horizontal axes and the unit up vector as rows of a right-handed (3, 3) matrix.

    Raises:
        InputError: the vector is zero or not finite.
    """
    up = np.asarray(up, np.float64)
    length = np.linalg.norm(up)
    if not (np.isfinite(length) and length > 0):
        raise InputError(f"The up vector {up.tolist()} has no direction; give three numbers that are not all zero.")
    up = up / length
    first = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first), up])


def plain_bounds(target: Gaussians, axes: Float64Array) -> Bounds:
    """The box that holds every centre, as in the paper."""
    local = target.means.astype(np.float64) @ axes.T
    low, high = local.min(0), local.max(0)
    return Bounds((low + high) / 2 @ axes, axes, np.maximum((high - low) / 2, 1e-9))


def robust_bounds(target: Gaussians, axes: Float64Array) -> Bounds:
    """The box of the object's dominant cluster: far floaters of a bad selection do not move it.

    Centres are weighted by opacity. The box spans percentiles 1 to 99 of those in the dominant clusters, and is nowhere
    thinner than a typical Gaussian of them is wide.
    """
    rows = dominant_cluster(target)
    local = target.means[rows].astype(np.float64) @ axes.T
    weights = target.opacities[rows].astype(np.float64)
    low, high = (
        np.array([_weighted_percentile(local[:, k], weights, q) for k in range(3)]) for q in _BOUND_PERCENTILES
    )
    floor = max(1e-3 * float((high - low).max()), float(np.exp(np.median(target.log_scales[rows]))))
    return Bounds((low + high) / 2 @ axes, axes, np.maximum((high - low) / 2, floor))


def dominant_cluster(target: Gaussians) -> BoolArray:
    """Which Gaussians belong to the heaviest cluster of connected voxels, or to one of a quarter of its weight, (N,).

    The voxels are a sixteenth of the weighted interdecile range wide, so the result does not depend on units; they grow
    until the heaviest cluster holds half of the weight, since a few sparse Gaussians are one object as well.
    """
    means = target.means.astype(np.float64)
    weights = target.opacities.astype(np.float64)
    deciles = [[_weighted_percentile(means[:, k], weights, q) for k in range(3)] for q in (10, 90)]
    size = float((np.array(deciles[1]) - deciles[0]).max()) / _VOXELS_ACROSS
    if size <= 0:
        return np.ones(len(means), np.bool_)
    while True:
        cluster = connected_voxels(means - np.median(means, axis=0), size)
        shares = np.bincount(cluster, weights) / weights.sum()
        if shares.max() >= _DOMINANT_SHARE:
            return np.asarray(shares[cluster] >= _SECOND_SHARE * shares.max())
        size *= 1.5


def _angles(bounds: Bounds, config: PlanConfig, seen_from: Sequence[Camera]) -> tuple[Float64Array, float]:
    """Yaws (V,) and the pitch, in radians."""
    pitch, first, span = np.radians(30.0), 0.0, 2 * np.pi
    if seen_from:
        local = (np.array([camera.centre for camera in seen_from]) - bounds.centre) @ bounds.axes.T
        camera_yaws = np.sort(np.arctan2(local[:, 1], local[:, 0]))
        camera_pitches = np.arctan2(local[:, 2], np.linalg.norm(local[:, :2], axis=1))
        pitch = float(np.clip(pitch, *np.percentile(camera_pitches, [25, 75])))
        gaps = np.diff(np.append(camera_yaws, camera_yaws[0] + 2 * np.pi))
        widest = int(np.argmax(gaps))
        if gaps[widest] > _FULL_CIRCLE_GAP:
            first, span = camera_yaws[(widest + 1) % len(gaps)], 2 * np.pi - gaps[widest]
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


def _weighted_percentile(values: Float64Array, weights: Float64Array, percent: float) -> float:
    order = np.argsort(values)
    cumulative = np.cumsum(weights[order])
    return float(values[order][min(np.searchsorted(cumulative, percent / 100 * cumulative[-1]), len(values) - 1)])
