"""Gaussians of one shape and colour at one place, as training leaves them where it clones or moves some, are one.

Neighbours, areas and counts tell how a surface lies only where no Gaussian has copies of itself for neighbours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import Gaussians, IntArray
from gaussian_trimmer.parallel import in_shares

_FACTOR = np.uint64(0x9E3779B97F4A7C15)
"""An odd number with bits of both kinds all over: hashes that it mixes are as good as different."""


class Distinct(NamedTuple):
    """M Gaussians that draw the same as the N of a scene, each for all copies of one."""

    gaussians: Gaussians
    """In the middle of the copies, as opaque as these are together; the scene itself if there are none."""
    rows: IntArray
    """Row of the first copy of each in the scene, (M,), ascending."""
    of: IntArray
    """Which of them each Gaussian of the scene is a copy of, (N,)."""


def distinct_gaussians(scene: Gaussians) -> Distinct:
    """Group copies: Gaussians of the same shape and colour, no farther from the middle of these than they are thick."""
    hashes = _hashes(scene)
    rows = _repeated(hashes)
    alike = _groups(hashes[rows])
    means = scene.means[rows].astype(np.float64)
    first, second, third = scene.log_scales[rows].T
    thin = np.exp(np.minimum(np.minimum(first, second), third))  # faster than row by row
    near = np.linalg.norm(means - _middles(means, alike)[alike], axis=1) <= thin
    rows, alike = rows[near], alike[near]
    first = np.arange(len(scene))
    first[rows] = rows[np.searchsorted(alike, alike)]
    is_first = first == np.arange(len(scene))
    kept, of = np.flatnonzero(is_first), (np.cumsum(is_first) - 1)[first]
    if len(kept) == len(scene):
        return Distinct(scene, kept, of)
    transmitted = -np.bincount(of, np.logaddexp(0, scene.opacity_logits.astype(np.float64)))  # logarithms
    copied = np.bincount(of) > 1
    logits = np.where(copied, np.log(np.maximum(np.expm1(-transmitted), 1e-30)), scene.opacity_logits[kept])
    means = np.where(copied[:, None], _middles(scene.means, of), scene.means[kept])
    distinct = scene.select(kept).replace(means=means.astype(np.float32), opacity_logits=logits.astype(np.float32))
    return Distinct(distinct, kept, of)


def _middles(means: NDArray[np.floating], of: IntArray) -> NDArray[np.float64]:
    """Return the means of points (N, 3) by the numbers of their groups (N,), (G, 3)."""
    return np.stack([np.bincount(of, column) for column in means.T], axis=1) / np.bincount(of)[:, None]


def _repeated(hashes: NDArray[np.uint64]) -> IntArray:
    """Return the rows whose hash (N,) another row has, too, those of each hash together and in order."""
    parts = (hashes >> np.uint64(32)).astype(np.uint32)  # sorts faster, and hardly any are the same by chance
    in_order = np.sort(parts)
    repeated = in_order[1:][in_order[1:] == in_order[:-1]]
    possible = np.zeros(1 << 24, np.bool_)
    possible[repeated >> 8] = True
    rows = np.flatnonzero(possible[parts >> 8]) if len(repeated) else np.zeros(0, np.int64)
    rows = rows[np.argsort(hashes[rows], kind="stable")]
    groups = _groups(hashes[rows])
    return rows[np.bincount(groups)[groups] > 1]


def _groups(in_order: NDArray[np.uint64]) -> IntArray:
    """Return the number of each run of equal values, from 0, (N,)."""
    return np.cumsum(in_order != np.append(in_order[:1], in_order[:-1]))


def _hashes(scene: Gaussians) -> NDArray[np.uint64]:
    """Return a number of the shape, rotation and colour of each Gaussian, the same for the same ones, (N,)."""

    def hashes(rows: slice) -> NDArray[np.uint64]:
        found = np.zeros(len(scene.means[rows]), np.uint64)
        for values in (scene.quaternions, scene.log_scales, scene.sh_dc):
            for column in np.ascontiguousarray(values[rows]).view(np.uint32).T:
                found = (found + column) * _FACTOR
        return found

    return np.concatenate(in_shares(hashes, len(scene)))
