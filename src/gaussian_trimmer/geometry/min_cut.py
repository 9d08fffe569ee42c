"""The minimum cut of a graph: the labels of its nodes, object or background, that cost least.

It is found exactly, as the maximum flow, by the algorithm of Boykov and Kolmogorov, "An Experimental Comparison of
Min-Cut/Max-Flow Algorithms for Energy Minimization in Vision" (PAMI 2004): search trees grow from both terminals, flow
is pushed where they touch, and branches that lose their root are adopted by others or set free.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, IntArray
from gaussian_trimmer.geometry.compiling import CACHE

_LARGEST_COST = 1e6
"""Integer that the largest cost is scaled to: sums of integers are exact in any order."""
_FREE, _ROOT, _ORPHAN = -1, -2, -3
_jit = numba.njit(cache=CACHE, nogil=True)


def min_cut(unaries: NDArray[np.floating], edges: IntArray, weights: NDArray[np.floating]) -> BoolArray:
    """Return the nodes of a graph that are object in the labelling of least cost, (N,).

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
    weights = np.asarray(weights, np.float64)
    finite = np.abs(unaries[np.isfinite(unaries)])
    scale = _LARGEST_COST / max(float(weights.max(initial=0)), float(finite.max(initial=0)), 1e-300)
    capacities = np.round(weights * scale).astype(np.int64)
    constraint = int(capacities.sum()) + round(float(finite.sum()) * scale) + 1
    terminals = np.round(np.nan_to_num(unaries * scale, posinf=constraint, neginf=-constraint)).astype(np.int64)
    return np.asarray(_cut(terminals, *_arcs(len(unaries), np.asarray(edges, np.int64), capacities)))


def _arcs(n: int, edges: IntArray, capacities: IntArray) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Both directions of every edge, sorted by the node that they leave.

    Returns where each node's arcs begin (N + 1,), and of each arc (2 E,) the node that it reaches, the place of its
    reverse and its capacity.
    """
    tails, heads = np.concatenate([edges[:, 0], edges[:, 1]]), np.concatenate([edges[:, 1], edges[:, 0]])
    order = np.argsort(tails, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    reverse = np.concatenate([place[len(edges) :], place[: len(edges)]])[order]
    starts = np.concatenate([[0], np.cumsum(np.bincount(tails, minlength=n))])
    return starts, heads[order], reverse, np.concatenate([capacities, capacities])[order]


@_jit
def _cut(terminals, starts, heads, reverse, capacity):  # type: ignore[no-untyped-def]
    """Push flow until the search trees no longer touch; the object's tree then holds the object.

    `terminals` (N,), positive for arcs from the object's terminal and negative for arcs to the background's, and
    `capacity` (A,) are changed: they hold what can still flow.
    """
    n = len(terminals)
    parent = np.full(n, _FREE)  # The arc to the parent.
    second = np.zeros(n, np.bool_)  # Which nodes are in the background's tree.
    queue, waiting, first, count = np.empty(n, np.int64), np.zeros(n, np.bool_), 0, 0
    stamp, distance, time = np.zeros(n, np.int64), np.zeros(n, np.int64), 0
    orphans = np.empty(n, np.int64)
    for i in range(n):
        if terminals[i] != 0:
            parent[i], second[i], distance[i] = _ROOT, terminals[i] < 0, 1
            queue[(first + count) % n], waiting[i] = i, True
            count += 1
    while count > 0:
        i = queue[first]
        if parent[i] == _FREE:
            first, count, waiting[i] = (first + 1) % n, count - 1, False
            continue
        bridge = -1
        for arc in range(starts[i], starts[i + 1]):
            j = heads[arc]
            if (capacity[reverse[arc]] if second[i] else capacity[arc]) <= 0:
                continue
            if parent[j] == _FREE:
                parent[j], second[j] = reverse[arc], second[i]
                stamp[j], distance[j] = stamp[i], distance[i] + 1
                if not waiting[j]:
                    queue[(first + count) % n], waiting[j] = j, True
                    count += 1
            elif second[j] != second[i]:
                bridge = reverse[arc] if second[i] else arc
                break
            elif stamp[j] <= stamp[i] and distance[j] > distance[i] + 1 and parent[j] != _ROOT:
                parent[j], stamp[j], distance[j] = reverse[arc], stamp[i], distance[i] + 1
        if bridge < 0:
            first, count, waiting[i] = (first + 1) % n, count - 1, False
            continue
        time += 1
        n_orphans = _push(bridge, parent, terminals, heads, reverse, capacity, orphans)
        while n_orphans > 0:
            n_orphans -= 1
            node = orphans[n_orphans]
            best, nearest = _FREE, np.int64(1 << 60)
            for arc in range(starts[node], starts[node + 1]):
                j = heads[arc]
                if second[j] != second[node] or parent[j] in (_FREE, _ORPHAN):
                    continue
                if (capacity[arc] if second[node] else capacity[reverse[arc]]) <= 0:
                    continue
                steps = _steps_to_root(j, time, parent, stamp, distance, heads)
                if 0 <= steps < nearest:
                    best, nearest = arc, steps
            if best >= 0:
                parent[node], stamp[node], distance[node] = best, time, nearest + 1
                continue
            parent[node] = _FREE
            for arc in range(starts[node], starts[node + 1]):
                j = heads[arc]
                if parent[j] == _FREE or second[j] != second[node]:
                    continue
                if (capacity[arc] if second[node] else capacity[reverse[arc]]) > 0 and not waiting[j]:
                    queue[(first + count) % n], waiting[j] = j, True
                    count += 1
                if parent[j] >= 0 and heads[parent[j]] == node:
                    parent[j] = _ORPHAN
                    orphans[n_orphans] = j
                    n_orphans += 1
    side = np.zeros(n, np.bool_)
    for i in range(n):
        side[i] = parent[i] != _FREE and not second[i]
    return side


@_jit
def _push(bridge, parent, terminals, heads, reverse, capacity, orphans):  # type: ignore[no-untyped-def]
    """Push what can flow over a bridge between the trees; the number of nodes that are cut off and become orphans."""
    flow = capacity[bridge]
    a, b = heads[reverse[bridge]], heads[bridge]
    i = a
    while parent[i] != _ROOT:
        flow = min(flow, capacity[reverse[parent[i]]])
        i = heads[parent[i]]
    flow = min(flow, terminals[i])
    i = b
    while parent[i] != _ROOT:
        flow = min(flow, capacity[parent[i]])
        i = heads[parent[i]]
    flow = min(flow, -terminals[i])

    capacity[bridge] -= flow
    capacity[reverse[bridge]] += flow
    n_orphans, i = 0, a
    while parent[i] != _ROOT:
        arc = parent[i]
        capacity[arc] += flow
        capacity[reverse[arc]] -= flow
        if capacity[reverse[arc]] == 0:
            parent[i] = _ORPHAN
            orphans[n_orphans] = i
            n_orphans += 1
        i = heads[arc]
    terminals[i] -= flow
    if terminals[i] == 0:
        parent[i] = _ORPHAN
        orphans[n_orphans] = i
        n_orphans += 1
    i = b
    while parent[i] != _ROOT:
        arc = parent[i]
        capacity[arc] -= flow
        capacity[reverse[arc]] += flow
        if capacity[arc] == 0:
            parent[i] = _ORPHAN
            orphans[n_orphans] = i
            n_orphans += 1
        i = heads[arc]
    terminals[i] += flow
    if terminals[i] == 0:
        parent[i] = _ORPHAN
        orphans[n_orphans] = i
        n_orphans += 1
    return n_orphans


@_jit
def _steps_to_root(node, time, parent, stamp, distance, heads):  # type: ignore[no-untyped-def]
    """Steps from a node to its tree's root, -1 if it hangs on an orphan; the way is marked with them."""
    steps, i = 0, node
    while True:
        if stamp[i] == time:
            steps += distance[i]
            break
        if parent[i] == _ROOT:
            stamp[i], distance[i] = time, 1
            steps += 1
            break
        if parent[i] == _ORPHAN or parent[i] == _FREE:
            return -1
        steps += 1
        i = heads[parent[i]]
    left, i = steps, node
    while stamp[i] != time:
        stamp[i], distance[i] = time, left
        left -= 1
        i = heads[parent[i]]
    return steps
