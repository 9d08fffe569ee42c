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
    parents = np.arange(count)
    for pair in range(len(pairs)):
        a, b = _root(parents, pairs[pair, 0]), _root(parents, pairs[pair, 1])
        parents[max(a, b)] = min(a, b)
    return _numbered(parents)


@_jit
def _root(parents, node):  # type: ignore[no-untyped-def]
    """Return the first node of a node's component, which the others lead to, and shorten the way there."""
    while parents[node] != node:
        parents[node] = parents[parents[node]]
        node = parents[node]
    return node


@_jit
def _numbered(parents):  # type: ignore[no-untyped-def]
    """Turn what leads to the first node of each component (V,) into the components' numbers, in order, (V,)."""
    found = 0
    for node in range(len(parents)):  # parents come before
        if parents[node] == node:
            parents[node] = found
            found += 1
        else:
            parents[node] = parents[parents[node]]
    return parents


def connected_voxels(points: Float64Array, size: float) -> IntArray:
    """Return the number of the 26-connected component of occupied voxels that each point (N, 3) lies in, (N,)."""
    voxels, members = _occupied(points, size)
    return np.asarray(_connected_cells(voxels, 1, voxels, np.arange(len(voxels) + 1), np.inf)[members])


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
    return np.asarray(_connected_cells(cells, 2, ordered, starts, reach * reach)[members])


def _occupied(points: Float64Array, size: float) -> tuple[Float64Array, IntArray]:
    """Return the cells (V, 3), in order, that points (N, 3) lie in, and the index of the cell of each point, (N,)."""
    cells = np.floor(points / size)
    low = cells.min(axis=0, initial=np.inf)
    shape = cells.max(axis=0, initial=-np.inf) - low + 1
    if len(cells) and shape.prod() < _LARGEST_KEY:  # several times faster than rows
        keys = np.ravel_multi_index(tuple((cells - low).astype(np.int64).T), tuple(shape.astype(np.int64)))
        _, first, members = np.unique(keys, return_index=True, return_inverse=True)
        return cells[first], members.reshape(-1)
    found, members = np.unique(cells, axis=0, return_inverse=True)
    return found, members.reshape(-1)


@_jit
def _connected_cells(cells, reach, points, starts, limit):  # type: ignore[no-untyped-def]
    """Return the number of the component of each cell (V, 3), in the order of their first cells, (V,).

    Cells are connected if they are at most `reach` steps apart along each axis and two of their points come within a
    squared distance. The cells are in order, and the points (N, 3) of cell i lie from `starts[i]` to `starts[i + 1]`.
    """
    parents = np.arange(len(cells))
    for steps in range(1, reach + 1):  # the nearer cells first: what they connect is not compared again
        for dx in range(steps + 1):
            for dy in range(-steps if dx else 0, steps + 1):
                first = 0
                for cell in range(len(cells)):
                    x, y, z = cells[cell, 0] + dx, cells[cell, 1] + dy, cells[cell, 2]
                    while first < len(cells) and _is_before(cells[first], x, y, z - steps):
                        first += 1
                    other = first if dx or dy else cell + 1
                    while other < len(cells) and _is_within(cells[other], x, y, z + steps):
                        a, b = _root(parents, cell), _root(parents, other)
                        if a != b and _come_near(points, starts, cell, other, limit):
                            parents[max(a, b)] = min(a, b)
                        other += 1
    return _numbered(parents)


@_jit
def _is_before(cell, x, y, z):  # type: ignore[no-untyped-def]
    """Tell whether a cell comes before another one in order."""
    return cell[0] < x or (cell[0] == x and (cell[1] < y or (cell[1] == y and cell[2] < z)))


@_jit
def _is_within(cell, x, y, z):  # type: ignore[no-untyped-def]
    """Tell whether a cell lies in the column (x, y), no higher than z."""
    return cell[0] == x and cell[1] == y and cell[2] <= z


@_jit
def _come_near(points, starts, a, b, limit):  # type: ignore[no-untyped-def]
    """Tell whether a point of one cell comes within a squared distance of a point of another one."""
    for i in range(starts[a], starts[a + 1]):
        for j in range(starts[b], starts[b + 1]):
            dx, dy, dz = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1], points[i, 2] - points[j, 2]
            if dx * dx + dy * dy + dz * dz <= limit:
                return True
    return False
