"""Connected components of points: by neighbouring occupied voxels, or by their distances."""

from __future__ import annotations

import numba
import numpy as np

from gaussian_trimmer.gaussians import Float64Array, IntArray
from gaussian_trimmer.geometry.compiling import CACHE

_jit = numba.njit(cache=CACHE, nogil=True)
_LARGEST_KEY = float(1 << 62)


def connected_pairs(count: int, pairs: IntArray) -> IntArray:
    """Return the number of the component that each of so many nodes lies in, (count,).

    Args:
        count: number of nodes.
        pairs: edges between them, (P, 2).

    >>> connected_pairs(5, np.array([[4, 2], [2, 1]])).tolist()
    [0, 1, 1, 2, 1]
    """
    return np.asarray(_components(count, np.ascontiguousarray(pairs, np.int64)))


@_jit
def _components(count, pairs):  # type: ignore[no-untyped-def]
    """Return the number of each node's component, in the order of their first nodes, (count,)."""
    parents = np.arange(count)  # the first node of a component is its root, which others lead to
    for pair in range(len(pairs)):
        a, b = pairs[pair, 0], pairs[pair, 1]
        while parents[a] != a:
            parents[a] = parents[parents[a]]
            a = parents[a]
        while parents[b] != b:
            parents[b] = parents[parents[b]]
            b = parents[b]
        parents[max(a, b)] = min(a, b)
    found = 0
    for node in range(count):  # parents come before
        if parents[node] == node:
            parents[node] = found
            found += 1
        else:
            parents[node] = parents[parents[node]]
    return parents


def connected_voxels(points: Float64Array, size: float) -> IntArray:
    """Return the number of the 26-connected component of occupied voxels that each point (N, 3) lies in, (N,)."""
    voxels, members = _occupied(points, size)
    return connected_pairs(len(voxels), _neighbouring(voxels, 1))[members]


def connected_bodies(points: Float64Array, size: float) -> IntArray:
    """Return the number of the cluster of each body that P points (N, P, 3) stand for, (N,).

    The points of a body are connected, and so are bodies with points in the same voxel or in neighbouring ones.
    """
    n, per_body = points.shape[:2]
    voxels = connected_voxels(points.reshape(-1, 3), size).reshape(n, per_body)
    if per_body == 1:
        return voxels[:, 0]
    first, others = np.repeat(voxels[:, 0], per_body - 1), voxels[:, 1:].reshape(-1)
    return connected_pairs(int(voxels.max(initial=-1)) + 1, np.column_stack([first, others]))[voxels[:, 0]]


def connected_points(points: Float64Array, reach: float) -> IntArray:
    """Return the number of the piece that each point (N, 3) lies in, (N,): steps within a piece are at most `reach`.

    Exact, wherever the points lie. They are sorted into cells so small that those of one cell are within reach of each
    other; between cells at most two apart the distances decide.
    """
    points = points - points.min(axis=0, initial=np.inf)
    cells, members = _occupied(points, reach / np.sqrt(3))
    ordered, starts = points[np.argsort(members, kind="stable")], np.append(0, np.cumsum(np.bincount(members)))
    pieces = np.arange(len(cells))
    for steps in (1, 2):  # Cells that the first step connected are not compared again.
        pairs = _neighbouring(cells, steps)
        pairs = pairs[pieces[pairs[:, 0]] != pieces[pairs[:, 1]]]
        joined = pieces[pairs[_within_reach(pairs, ordered, starts, reach * reach)]]
        pieces = connected_pairs(len(cells), joined)[pieces]
    return pieces[members]


def _occupied(points: Float64Array, size: float) -> tuple[Float64Array, IntArray]:
    """Return the cells (V, 3) of some size that points (N, 3) lie in, and the index of the cell of each point, (N,)."""
    cells = np.floor(points / size)
    low = cells.min(axis=0, initial=np.inf)
    shape = cells.max(axis=0, initial=-np.inf) - low + 1
    if len(cells) and shape.prod() < _LARGEST_KEY:  # several times faster than rows
        keys = np.ravel_multi_index(tuple((cells - low).astype(np.int64).T), tuple(shape.astype(np.int64)))
        _, first, members = np.unique(keys, return_index=True, return_inverse=True)
        return cells[first], members.reshape(-1)
    found, members = np.unique(cells, axis=0, return_inverse=True)
    return found, members.reshape(-1)


def _neighbouring(cells: Float64Array, steps: int) -> IntArray:
    """Return pairs (P, 2) of the cells (V, 3) that are at most so many steps apart along each axis."""
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(cells).query_pairs(steps, p=np.inf, output_type="ndarray"))


@_jit
def _within_reach(pairs, points, starts, limit):  # type: ignore[no-untyped-def]
    """Find the pairs (P, 2) of cells of which two points come within a squared distance, (P,).

    The points (N, 3) of cell i lie from `starts[i]` to `starts[i + 1]`.
    """
    found = np.zeros(len(pairs), np.bool_)
    for pair in range(len(pairs)):
        a, b = pairs[pair]
        for i in range(starts[a], starts[a + 1]):
            for j in range(starts[b], starts[b + 1]):
                dx, dy, dz = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1], points[i, 2] - points[j, 2]
                if dx * dx + dy * dy + dz * dz <= limit:
                    found[pair] = True
                    break
            if found[pair]:
                break
    return found
