"""Connected components of points: by neighbouring occupied voxels, or by their distances."""

from __future__ import annotations

import numba
import numpy as np

from gaussian_trimmer.gaussians import Float64Array, IntArray
from gaussian_trimmer.geometry.compiling import CACHE

_jit = numba.njit(cache=CACHE, nogil=True)

_CELLS_ACROSS = 1 << 21
"""Cells along an axis that a key has room for."""


def connected_voxels(points: Float64Array, size: float) -> IntArray:
    """Number of the 26-connected component of occupied voxels that each point (N, 3) lies in, (N,).

    Voxels are counted from the origin; points a million of them away and more are taken to lie in the last ones.
    """
    voxels, members = np.unique(_cell_keys(points, size), return_inverse=True)
    return np.asarray(_connect(voxels, 1, points, members, 0.0)[members.reshape(-1)])


def connected_bodies(points: Float64Array, size: float) -> IntArray:
    """Number of the cluster of each body that P points (N, P, 3) stand for, (N,).

    The points of a body are connected, and so are bodies with points in the same voxel or in neighbouring ones.
    """
    voxels = connected_voxels(points.reshape(-1, 3), size).reshape(points.shape[:2])
    if points.shape[1] > 1:
        voxels = _join_rows(np.unique(voxels, return_inverse=True)[1].reshape(voxels.shape))[:, None]
    return np.asarray(voxels[:, 0])


def connected_points(points: Float64Array, reach: float) -> IntArray:
    """Number of the piece that each point (N, 3) lies in, (N,): points no farther apart than `reach` are in one piece.

    Exact, wherever the points lie and whatever grid sorts them: those of one cell are within reach of each other, and
    between cells at most two apart the distances decide.

    Raises:
        ValueError: the points fill more than 699,049 cells along an axis, each 0.58 of the reach wide.
    """
    points = points - points.min(axis=0, initial=np.inf)
    keys = _compact_keys(points, reach / np.sqrt(3))
    order = np.argsort(keys)
    ordered = keys[order]
    starts = np.append(np.flatnonzero(np.diff(ordered, prepend=-1)), len(keys))
    pieces = _connect(ordered[starts[:-1]], 2, points[order], starts, reach * reach)
    result = np.empty(len(points), np.int64)
    result[order] = np.repeat(pieces, np.diff(starts))
    return result


def connected_pairs(count: int, pairs: IntArray) -> IntArray:
    """Number of the component that each of so many things lies in, (count,): the smallest of its members' numbers.

    Args:
        pairs: numbers of two things that belong together, (P, 2).

    >>> connected_pairs(5, np.array([[4, 2], [2, 1]])).tolist()
    [0, 1, 1, 3, 1]
    """
    parent = np.arange(count)
    _join_members(np.ascontiguousarray(pairs, np.int64).reshape(-1, 2), parent)
    return _roots(parent)


def _cell_keys(points: Float64Array, size: float) -> IntArray:
    """Number of the cubic cell that each point (N, 3) lies in, (N,): a step along an axis adds 1 << 42, 1 << 21 or 1.

    Cells are counted from two beyond the first, so that steps of two from any of them stay apart as well.
    """
    cells = np.floor(np.clip(points / size, -1e6, 1e6)).astype(np.int64) + 1_000_002
    return np.asarray((cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2])


def _compact_keys(points: Float64Array, size: float) -> IntArray:
    """As `_cell_keys`, of points (N, 3) above zero that may spread over any number of cells.

    Where they are more than a key has room for, empty stretches of the axes are shortened to as many cells as keep what
    lies beyond out of the reach of two steps.
    """
    cells = np.floor(points / size)
    if cells.max(initial=0) >= _CELLS_ACROSS - 4:
        for axis in range(3):
            values, places = np.unique(cells[:, axis], return_inverse=True)
            shortened = np.cumsum(np.minimum(np.diff(values, prepend=values[0]), 3))
            if shortened[-1] >= _CELLS_ACROSS - 4:
                raise ValueError(f"Points in {len(values)} different cells along an axis are too many to connect.")
            cells[:, axis] = shortened[places.reshape(-1)]
    cells = cells.astype(np.int64) + 2
    return np.asarray((cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2])


def _connect(cells: IntArray, reach: int, points: Float64Array, starts: IntArray, limit: float) -> IntArray:
    """Labels of the components of sorted cell keys (V,); a label is the smallest member's place.

    Cells no farther apart than a reach of one, along each axis, are connected; those within a reach of two only if
    their points (N, 3), which lie from `starts` on, come within a squared distance.
    """
    parent, firsts = np.arange(len(cells)), np.zeros((reach + 1, 2 * reach + 1), np.int64)
    _join_cells(cells, np.require(points, np.float64, ("C", "W")), starts, limit, parent, firsts)
    return _roots(parent)


def _join_rows(labels: IntArray) -> IntArray:
    """Labels (N,) of rows of labels (N, P): rows that share one, if only by way of others, get the same."""
    parent = np.arange(labels.max() + 1)
    _join_members(labels, parent)
    return np.asarray(_roots(parent)[labels[:, 0]])


def _roots(parent: IntArray) -> IntArray:
    """The root of every member of a union-find forest, (V,)."""
    while not np.array_equal(parent, above := parent[parent]):
        parent = above
    return parent


@_jit
def _join_cells(cells, points, starts, limit, parent, firsts):  # type: ignore[no-untyped-def]
    """Join the cells of `_connect` by union-find.

    Cells are gone through in order, so that the first cell of each row around them that is within reach only moves on:
    `firsts` (reach + 1, 2 reach + 1), zero before, keeps its place.
    """
    reach = firsts.shape[0] - 1
    for i in range(len(cells)):
        for dx in range(-reach, 1):
            for dy in range(-reach, reach + 1):
                beside = cells[i] + (dx << 42) + (dy << 21)
                j = firsts[dx + reach, dy + reach]
                while j < i and cells[j] < beside - reach:
                    j += 1
                firsts[dx + reach, dy + reach] = j
                while j < i and cells[j] <= beside + reach:
                    a, b = _root(parent, i), _root(parent, j)
                    if a != b and (
                        reach == 1 or _within(points, starts[i], starts[i + 1], starts[j], starts[j + 1], limit)
                    ):
                        parent[max(a, b)] = min(a, b)
                    j += 1


@_jit
def _join_members(labels, parent):  # type: ignore[no-untyped-def]
    """Join the labels of each row (N, P) by union-find."""
    for i in range(len(labels)):
        for k in range(1, labels.shape[1]):
            a, b = _root(parent, labels[i, 0]), _root(parent, labels[i, k])
            parent[max(a, b)] = min(a, b)


@_jit
def _root(parent, i):  # type: ignore[no-untyped-def]
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@_jit
def _within(points, start, end, other_start, other_end, limit):  # type: ignore[no-untyped-def]
    """Whether any of some points comes within a squared distance of any of the others."""
    for i in range(start, end):
        for j in range(other_start, other_end):
            dx, dy, dz = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1], points[i, 2] - points[j, 2]
            if dx * dx + dy * dy + dz * dz <= limit:
                return True
    return False
