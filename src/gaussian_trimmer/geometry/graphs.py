"""Points and pixels and what is near them: nearest neighbours, connected pieces, and the minimum cut of a graph."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, IntArray
from gaussian_trimmer.parallel import compiled

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

_jit = compiled(nogil=True)
_WIDER = 4
"""Factor by which more neighbours are asked for where the last one ties with the next."""
_LEAF = 24
"""Points of a leaf of the tree: with SciPy's 10, searches in six dimensions take a third longer."""
_CELLS_ACROSS = 32
"""Cells of the interquartile range along an axis, by which points are sorted."""
_LARGEST_KEY = float(1 << 62)
_LARGEST_COST = 1e6
"""Integer that the largest cost of a cut is scaled to: sums of integers are exact in any order."""
_CONSTRAINT = np.iinfo(np.int32).max
"""Cost that no cut pays."""


def nearest(
    points: FloatArray | Float64Array,  # (N, D)
    queries: FloatArray | Float64Array,  # (Q, D)
    k: int,
    reach: float = np.inf,
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Return squared distances (Q, k) and indices (Q, k) of the k nearest points of each query, nearest first.

    Equally near points are ordered by index. Where fewer than k points are closer than `reach`, the last columns hold
    infinity and the index -1.

    >>> points = np.float32([[0.0, 0.0], [3.0, 4.0]])
    >>> nearest(points, points[:1], 2)[0].tolist()
    [[0.0, 25.0]]
    >>> nearest(points, points[:1], 2, reach=4.0)[0].tolist()
    [[0.0, inf]]
    """
    from scipy.spatial import cKDTree  # takes longer to import than most commands that search nothing

    points, queries = np.asarray(points, np.float64), np.asarray(queries, np.float64)
    squared, indices = np.full((len(queries), k), np.inf, np.float32), np.full((len(queries), k), -1, np.int32)
    if not len(points) or not len(queries):
        return squared, indices
    numbers, order = _by_cells(points), _by_cells(queries)
    tree, queries = cKDTree(points[numbers], leafsize=_LEAF), queries[order]
    numbers = np.append(numbers, -1)
    distances, found = _ask(tree, numbers, queries, k + 1, reach)
    tied = np.flatnonzero((distances[:, k - 1] == distances[:, k]) & np.isfinite(distances[:, k]))
    if len(tied):  # Which of them are among the k hangs on the tree.
        wider = _ask(tree, numbers, queries[tied], _WIDER * (k + 1), reach)
        distances[tied, :k], found[tied, :k] = (values[:, :k] for values in wider)
    squared[order], indices[order] = np.square(distances[:, :k]), found[:, :k]
    return squared, indices


def _by_cells(points: Float64Array) -> IntArray:
    """Return an order in which points (N, D) are near those before them: searches find more in the cache, (N,)."""
    low, high = np.quantile(points[:: 1 + len(points) // 1000, :3], [0.25, 0.75], axis=0)
    sizes = np.maximum((high - low) / _CELLS_ACROSS, 1e-300)
    with np.errstate(over="ignore"):  # a plane has no thickness, but may have an outlier
        cells = np.floor((points[:, :3] - low) / sizes)
    return np.lexsort(np.clip(cells, -1000, 1000).astype(np.int16).T)


def _ask(
    tree: cKDTree, numbers: IntArray, queries: Float64Array, k: int, reach: float
) -> tuple[Float64Array, IntArray]:
    """Return distances (Q, k) of the nearest and their numbers (Q, k), in the order of both."""
    columns, threads = [*range(1, k + 1)], numba.get_num_threads()
    found: tuple[Any, Any] = tree.query(queries, columns, distance_upper_bound=reach, workers=threads)
    distances, indices = found[0], numbers[found[1]]
    rows = np.flatnonzero((distances[:, 1:] == distances[:, :-1]).any(axis=1))
    order = np.lexsort((indices[rows], distances[rows]))
    distances[rows] = np.take_along_axis(distances[rows], order, axis=1)
    indices[rows] = np.take_along_axis(indices[rows], order, axis=1)
    return distances, indices


def distance_to_outside(mask: BoolArray, beyond: bool = True) -> Float64Array:
    """Return the distance of every pixel to the nearest one outside a mask (H, W) in pixels, (H, W); zero outside.

    OpenCV's last bits depend on the processor and, with one thread, on the call; the squares are whole numbers, and
    the same always.

    Args:
        mask: the pixels inside.
        beyond: whether the mask goes on beyond the picture; otherwise the picture's frame is outside.

    >>> distance_to_outside(np.ones((3, 5), bool), beyond=False)[1].tolist()
    [1.0, 2.0, 2.0, 2.0, 1.0]
    """
    import cv2  # late: most of what looks for neighbours needs none of it

    framed = mask if beyond else np.pad(mask, 1)
    distance = cv2.distanceTransform(framed.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    exact = np.sqrt(np.rint(np.square(distance, dtype=np.float64)))
    return exact if beyond else exact[1:-1, 1:-1]


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


def min_cut(unaries: NDArray[np.floating], edges: IntArray, weights: NDArray[np.floating]) -> BoolArray:
    """Return the nodes of a graph that are object in the labelling of least cost, (N,), exactly, by the maximum flow.

    The cost is the sum of positive unary terms over background nodes, of the absolute values of negative ones over
    object nodes, and of the weights of edges between object and background. Nodes that nothing draws to the object are
    background.

    Args:
        unaries: unary terms, (N,); infinite ones are constraints.
        edges: both nodes of each edge, (E, 2); the same pair may occur several times.
        weights: the edges' weights, at least zero, (E,).

    >>> line = np.array([[0, 1], [1, 2], [2, 3]])
    >>> min_cut(np.array([np.inf, 0, 0, -np.inf]), line, np.array([1.0, 0.5, 1.0])).tolist()
    [True, True, False, False]
    """
    from scipy.sparse import coo_array, csr_array  # take longer to import than a command to start
    from scipy.sparse.csgraph import breadth_first_order, maximum_flow

    nodes, source, sink = np.arange(len(unaries)), len(unaries), len(unaries) + 1
    largest = max(np.max(weights, initial=0), np.abs(unaries[np.isfinite(unaries)]).max(initial=0), 1e-300)
    of_edges = np.round(np.asarray(weights, np.float64) * (_LARGEST_COST / largest))
    terminals = np.clip(np.round(unaries * (_LARGEST_COST / largest)), -_CONSTRAINT, _CONSTRAINT)
    drawn, held = terminals > 0, terminals < 0
    tails = np.concatenate([edges[:, 0], edges[:, 1], np.full(np.count_nonzero(drawn), source), nodes[held]])
    heads = np.concatenate([edges[:, 1], edges[:, 0], nodes[drawn], np.full(np.count_nonzero(held), sink)])
    arcs = np.concatenate([of_edges, of_edges, terminals[drawn], -terminals[held]]).astype(np.int32)
    places = np.stack([tails, heads]).astype(np.int32)  # SciPy takes no larger indices
    capacities = csr_array(coo_array((arcs, (places[0], places[1])), shape=(len(nodes) + 2,) * 2))
    left = capacities - maximum_flow(capacities, source, sink).flow
    left.eliminate_zeros()
    found = np.zeros(len(nodes) + 2, np.bool_)
    found[breadth_first_order(left, source, return_predecessors=False)] = True
    return found[: len(nodes)]
