"""Boxes of objects in the frame of the up vector."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import up_frame
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, IntArray, ellipsoid_points
from gaussian_trimmer.geometry.graphs import connected_bodies, nearest

_VOXELS_ACROSS = 16
_DOMINANT_SHARE = 0.5
_SECOND_SHARE = 0.25
_GAP_VOXELS = 4
"""Largest gap to a cluster that is part of the object all the same, in voxels: between a crown and its sparse trunk."""
BOUND_PERCENTILES = (1.0, 99.0)
"""Percentiles of an object's points along an axis that are taken for its ends, so that floaters do not count."""
_REACH_DEVIATIONS = 1.5
"""Standard deviations out to which a Gaussian reaches; two whose reaches meet are connected."""


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

    def squared_distances(self, points: FloatArray) -> FloatArray:
        """Return squared distances of points (N, 3) from the centre, (N,)."""
        offset = points - self.centre.astype(np.float32)
        return np.asarray(np.einsum("ni,ni->n", offset, offset))

    def corners(self) -> Float64Array:
        """Return the eight corners in the world, (8, 3)."""
        signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), -1).reshape(8, 3)
        return np.asarray(self.centre + (signs * self.half_extents) @ self.axes)


def own_frame(target: Gaussians, up: Float64Array) -> Float64Array:
    """Return a frame as of `up_frame` that turns with the object: its first axis is the one it is longest along.

    Of the axis's two directions it is the one in which the object's mass has the longer tail.
    """
    axes = up_frame(up)
    weights = target.opacities.astype(np.float64)
    local = target.means.astype(np.float64) @ axes[:2].T
    local -= np.average(local, axis=0, weights=weights)
    long = np.linalg.eigh((local.T * weights) @ local)[1][:, 1]
    long *= np.sign(weights @ (local @ long) ** 3) or 1.0
    first = long @ axes[:2]
    return np.stack([first, np.cross(axes[2], first), axes[2]])


def plain_bounds(target: Gaussians, axes: Float64Array) -> Bounds:
    """Return the box that holds every centre, as in the paper."""
    local = target.means.astype(np.float64) @ axes.T
    low, high = local.min(0), local.max(0)
    return Bounds((low + high) / 2 @ axes, axes, np.maximum((high - low) / 2, 1e-9))


def robust_bounds(target: Gaussians, axes: Float64Array) -> Bounds:
    """Return the box of the object's dominant cluster: far floaters of a bad selection do not move it.

    Gaussians are weighted by opacity. The box spans percentiles 1 to 99 of the centres of those in the dominant
    clusters, or of points on their ellipsoids where these are large, and is nowhere thinner than a typical one is wide.
    """
    points, size = _standing_points(target)
    rows = _dominant_cluster(target, points, size)
    local = (points[rows].reshape(-1, 3) @ axes.T).reshape(-1, *points.shape[1:])
    weights = target.opacities[rows].astype(np.float64)
    low, high = _percentiles(local, weights, BOUND_PERCENTILES)
    floor = max(1e-3 * float((high - low).max()), float(np.exp(np.median(target.log_scales[rows]))))
    return Bounds((low + high) / 2 @ axes, axes, np.maximum((high - low) / 2, floor))


def dominant_cluster(target: Gaussians) -> BoolArray:
    """Return the Gaussians of the heaviest cluster of connected voxels, and of others of a quarter of its weight, (N,).

    The voxels are a sixteenth of the weighted interdecile range wide, so the result does not depend on units; they grow
    until the heaviest cluster holds half of the weight, since a few sparse Gaussians are one object as well. Clusters
    of large Gaussians touch although their centres lie far apart: those that touch the heaviest, or are within
    four voxels of it, count as well, step by step.
    """
    return _dominant_cluster(target, *_standing_points(target))


def _standing_points(target: Gaussians) -> tuple[Float64Array, float]:
    """Return world points that stand for each Gaussian, (N, P, 3), and the width of the voxels that connect them.

    That is its centre. Where a typical Gaussian is wider than a voxel, the centres tell little of where the object is,
    and each stands for points on its ellipsoid as well; none reaches farther than the median one does.
    """
    centres = target.means.astype(np.float64)[:, None]
    size = _voxel_size(target, centres)
    width = float(np.median(target.largest_log_scales))
    if size >= np.exp(width):
        return centres, size
    points = ellipsoid_points(target.replace(log_scales=np.minimum(target.log_scales, np.float32(width))))
    return points, _voxel_size(target, points)


def _dominant_cluster(target: Gaussians, points: Float64Array, size: float) -> BoolArray:
    if size <= 0:
        return np.ones(len(target), np.bool_)
    weights, gap = target.opacities.astype(np.float64), _GAP_VOXELS * size
    middle = np.median(points[:, 0], axis=0)
    while True:
        cluster = connected_bodies(points - middle, size)
        shares = np.bincount(cluster, weights) / weights.sum()
        if shares.max() >= _DOMINANT_SHARE:
            dominant = np.asarray(shares[cluster] >= _SECOND_SHARE * shares.max())
            return _with_touching_clusters(target, dominant, cluster, gap)
        size *= 1.5


def _voxel_size(target: Gaussians, points: Float64Array) -> float:
    """Return a sixteenth of the largest weighted interdecile range along an axis of points (N, P, 3)."""
    low, high = _percentiles(points, target.opacities.astype(np.float64), (10, 90))
    return float((high - low).max()) / _VOXELS_ACROSS


def touching(target: Gaussians, group: BoolArray, gap: float = 0.0) -> BoolArray:
    """Return Gaussians outside a group that touch it: their reach and that of the group's nearest member meet, (N,).

    A Gaussian reaches 1.5 of its largest standard deviations far, but no farther than the group's median one does: a
    huge Gaussian of the background would touch everything.

    Args:
        target: N Gaussians.
        group: the members of the group, (N,); at least one.
        gap: distance within which Gaussians touch whatever their reach.
    """
    widths: FloatArray = np.exp(np.minimum(target.largest_log_scales, target.log_scales[group].max(axis=1).max()))
    reach = np.float32(_REACH_DEVIATIONS) * np.minimum(widths, np.median(widths[group]))
    members, others = np.flatnonzero(group), np.flatnonzero(~group)
    squared, near = nearest(target.means[members], target.means[others], 1)
    touches = np.zeros(len(target), np.bool_)
    touches[others] = np.sqrt(squared[:, 0]) < np.maximum(reach[others] + reach[members[near[:, 0]]], np.float32(gap))
    return touches


def _with_touching_clusters(target: Gaussians, dominant: BoolArray, cluster: IntArray, gap: float) -> BoolArray:
    """Return the dominant clusters and, step by step, each cluster that touches them or is within a gap, (N,)."""
    while not dominant.all():
        found = np.isin(cluster, cluster[touching(target, dominant, gap)])
        if not found.any():
            break
        dominant = dominant | found
    return dominant


def _percentiles(points: Float64Array, weights: Float64Array, percents: tuple[float, ...]) -> list[Float64Array]:
    """Return, for each of the percentages, the weighted percentiles (3,) of points (N, P, 3) of weights (N,)."""
    flat, repeated = points.reshape(-1, 3), np.repeat(weights, points.shape[1])
    found = np.empty((len(percents), 3))
    for axis in range(3):
        order = np.argsort(flat[:, axis])
        cumulative = np.cumsum(repeated[order])
        places = np.searchsorted(cumulative, np.divide(percents, 100) * cumulative[-1])
        found[:, axis] = flat[order, axis][np.minimum(places, len(flat) - 1)]
    return list(found)
