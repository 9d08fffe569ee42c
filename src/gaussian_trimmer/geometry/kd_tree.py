"""The k nearest of a set of points in any number of dimensions: a k-d tree, compiled and parallel over queries."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import FloatArray, IntArray
from gaussian_trimmer.geometry.compiling import CACHE
from gaussian_trimmer.parallel import parallel_for

_POINTS_IN_A_LEAF = 16
_jit = numba.njit(cache=CACHE, fastmath={"contract", "reassoc", "nsz"}, nogil=True)


def nearest(
    points: FloatArray, queries: FloatArray, k: int, reach: float = np.inf
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Squared distances (Q, k) and indices (Q, k) of the k nearest points (N, D) of each query (Q, D), nearest first.

    Where fewer than k points are closer than `reach`, the last columns hold infinity and the index -1.

    >>> points = np.float32([[0.0, 0.0], [3.0, 4.0]])
    >>> nearest(points, points[:1], 2)[0].tolist()
    [[0.0, 25.0]]
    >>> nearest(points, points[:1], 2, reach=4.0)[0].tolist()
    [[0.0, inf]]
    """
    points = np.ascontiguousarray(points, np.float32)
    order, axes, splits, edges = _build(np.require(points, requirements="W"))
    queries = np.require(queries, np.float32, ("C", "W"))
    leaves, numbers = _leaves(points, order, edges)
    squared = np.full((len(queries), k), np.float32(reach * reach))
    found = np.full((len(queries), k), -1, np.int32)
    parallel_for(
        lambda first, last: _search(
            leaves, numbers, axes, splits, queries[first:last], squared[first:last], found[first:last]
        ),
        len(queries),
    )
    return squared, found


def _build(points: FloatArray) -> tuple[NDArray[np.int32], NDArray[np.int32], FloatArray, IntArray]:
    """Order the points so that every node is a contiguous range, halved at the median of its widest axis.

    Nodes are numbered as in a heap, level after level; ranges follow from the halving, so only axis and split of a
    node are stored, and where the leaves' ranges begin and end.
    """
    n = len(points)
    order = np.arange(n, dtype=np.int32)
    n_leaves = 1
    while _POINTS_IN_A_LEAF * n_leaves < n:
        n_leaves *= 2
    axes, splits = np.zeros(n_leaves, np.int32), np.zeros(n_leaves, np.float32)
    edges = np.array([0, n])
    while len(edges) <= n_leaves:
        level = len(edges) - 1
        halves = np.empty(2 * level + 1, np.int64)
        halves[::2], halves[1::2] = edges, (edges[:-1] + edges[1:]) // 2
        _halve(points, order, halves, axes[level:], splits[level:])
        edges = halves
    return order, axes, splits, edges


@_jit
def _halve(points, order, halves, axes, splits):  # type: ignore[no-untyped-def]
    """Order each node of a level so that its median along its widest axis, which is noted, stands in the middle."""
    for i in range(len(halves) // 2):
        start, middle, end = halves[2 * i], halves[2 * i + 1], halves[2 * i + 2]
        widest, width = 0, np.float32(-1)
        for axis in range(points.shape[1]):
            low, high = points[order[start], axis], points[order[start], axis]
            for j in range(start + 1, end):
                value = points[order[j], axis]
                low, high = min(low, value), max(high, value)
            if high - low > width:
                widest, width = axis, high - low
        axes[i] = widest
        _select(points, order, axes[i], start, end, middle)
        splits[i] = points[order[middle], widest]


def _leaves(points: FloatArray, order: NDArray[np.int32], edges: IntArray) -> tuple[FloatArray, NDArray[np.int32]]:
    """Coordinates of the points of the T leaves, (T, D, _POINTS_IN_A_LEAF), and their numbers, (T, _POINTS_IN_A_LEAF).

    Distances of a leaf then take a few vector instructions for each axis. Where a leaf has fewer points, coordinates
    are infinite and numbers -1. The leaves' ranges of `order` lie between the `edges` (T + 1,).
    """
    slots = edges[:-1, None] + np.arange(_POINTS_IN_A_LEAF)
    filled = slots < edges[1:, None]
    numbers = np.full(slots.shape, -1, np.int32)
    numbers[filled] = order[slots[filled]]
    leaves = np.full((*slots.shape, points.shape[1]), np.inf, np.float32)
    leaves[filled] = points[numbers[filled]]
    return np.ascontiguousarray(leaves.transpose(0, 2, 1)), numbers


@_jit
def _select(points, order, axis, start, end, middle):  # type: ignore[no-untyped-def]
    """Quickselect: afterwards everything before `middle` is at most, everything after it at least its value."""
    low, high = start, end - 1
    while low < high:
        pivot = points[order[(low + high) // 2], axis]
        i, j = low, high
        while i <= j:
            while points[order[i], axis] < pivot:
                i += 1
            while points[order[j], axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@_jit
def _search(leaves, numbers, axes, splits, queries, squared, found):  # type: ignore[no-untyped-def]
    """Depth-first search below the squared distances (Q, k) as they are given, with a stack of the branches not taken.

    Writes squared distances and indices. A branch keeps how far its box lies from the query along each axis, so that
    its distance adds up over the axes.
    """
    n_nodes, dims, _ = leaves.shape
    k = squared.shape[1]
    stack = np.empty(64, np.int64)
    bounds = np.empty(64, np.float32)
    gaps = np.empty((64, dims), np.float32)
    offset = np.empty(dims, np.float32)
    distances = np.empty(_POINTS_IN_A_LEAF, np.float32)
    for q in range(len(queries)):
        query, best, ids = queries[q], squared[q], found[q]
        for axis in range(dims):
            gaps[0, axis] = 0
        stack[0], bounds[0], top = 1, np.float32(0), 1
        while top > 0:
            top -= 1
            node, bound = stack[top], bounds[top]
            if bound >= best[k - 1]:
                continue
            for axis in range(dims):  # Copying whole rows takes two seconds longer to compile.
                offset[axis] = gaps[top, axis]
            while node < n_nodes:
                axis = axes[node]
                gap = query[axis] - splits[node]
                far = 2 * node + (1 if gap < 0 else 0)
                far_bound = bound - offset[axis] * offset[axis] + gap * gap
                if far_bound < best[k - 1]:
                    stack[top], bounds[top] = far, far_bound
                    for other in range(dims):
                        gaps[top, other] = offset[other]
                    gaps[top, axis] = gap
                    top += 1
                node = 2 * node + (0 if gap < 0 else 1)
            for i in range(_POINTS_IN_A_LEAF):
                distances[i] = 0
            for axis in range(dims):
                coordinates, position = leaves[node - n_nodes, axis], query[axis]
                for i in range(_POINTS_IN_A_LEAF):
                    step = coordinates[i] - position
                    distances[i] += step * step
            for i in range(_POINTS_IN_A_LEAF):
                distance = distances[i]
                if distance < best[k - 1]:
                    slot = k - 1
                    while slot > 0 and best[slot - 1] > distance:
                        best[slot], ids[slot] = best[slot - 1], ids[slot - 1]
                        slot -= 1
                    best[slot], ids[slot] = distance, numbers[node - n_nodes, i]
        for slot in range(k):
            if ids[slot] < 0:
                best[slot] = np.inf
