"""Boxes of objects in the frame of the up vector."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import unit_up
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.geometry.components import connected_voxels
from gaussian_trimmer.geometry.kd_tree import nearest

_VOXELS_ACROSS = 16
_DOMINANT_SHARE = 0.5
_SECOND_SHARE = 0.25
_BOUND_PERCENTILES = (1.0, 99.0)
_TOUCHING = 1.5
"""Standard deviations out to which a Gaussian reaches; two whose reaches meet hang together."""
_MIN_CLUSTER_SHARE = 0.03
"""Smallest share of the weight of a cluster that counts for the bounds because it touches the dominant ones."""


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


def up_frame(up: Float64Array) -> Float64Array:
    """Two horizontal axes and the unit up vector as rows of a right-handed (3, 3) matrix.

    Raises:
        InputError: the vector is zero or not finite.
    """
    up = unit_up(up)
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
    until the heaviest cluster holds half of the weight, since a few sparse Gaussians are one object as well. Clusters
    of large Gaussians touch although their centres lie far apart: those that touch the heaviest count as well.
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
            dominant = np.asarray(shares[cluster] >= _SECOND_SHARE * shares.max())
            return _with_touching_clusters(target, dominant, cluster, shares >= _MIN_CLUSTER_SHARE)
        size *= 1.5


def touching(target: Gaussians, group: BoolArray) -> BoolArray:
    """Gaussians outside a group that touch it: their reach and that of the group's nearest member meet, (N,).

    A Gaussian reaches 1.5 of its largest standard deviations far, but no farther than the group's median one does: a
    huge Gaussian of the background would touch everything.

    Args:
        target: N Gaussians.
        group: the members of the group, (N,); at least one.
    """
    widths: FloatArray = np.exp(np.minimum(target.log_scales.max(axis=1), target.log_scales[group].max(axis=1).max()))
    reach = np.float32(_TOUCHING) * np.minimum(widths, np.median(widths[group]))
    members, others = np.flatnonzero(group), np.flatnonzero(~group)
    squared, near = nearest(target.means[members], target.means[others], 1)
    touches = np.zeros(len(target), np.bool_)
    touches[others] = np.sqrt(squared[:, 0]) < reach[others] + reach[members[near[:, 0]]]
    return touches


def _with_touching_clusters(target: Gaussians, dominant: BoolArray, cluster: IntArray, counts: BoolArray) -> BoolArray:
    """The dominant clusters and, step by step, each cluster that counts and touches them, (N,)."""
    while not dominant.all():
        found = np.isin(cluster, cluster[touching(target, dominant)]) & counts[cluster]
        if not found.any():
            break
        dominant = dominant | found
    return dominant


def _weighted_percentile(values: Float64Array, weights: Float64Array, percent: float) -> float:
    order = np.argsort(values)
    cumulative = np.cumsum(weights[order])
    return float(values[order][min(np.searchsorted(cumulative, percent / 100 * cumulative[-1]), len(values) - 1)])
