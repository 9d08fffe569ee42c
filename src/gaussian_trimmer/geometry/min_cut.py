"""The cheapest way to divide a graph in two: minimum cut by maximum flow.

Some nodes are drawn to one side, some to the other, and edges pull their ends to the same side. The division that
resists least is found exactly, by the algorithm of Boykov and Kolmogorov, "An Experimental Comparison of Min-Cut/
Max-Flow Algorithms for Energy Minimization in Vision" (PAMI 2004): search trees grow from both ends, flow is pushed
where they touch, and branches that lose their root are adopted or set free.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.compiling import CACHE
from gaussian_trimmer.gaussians import BoolArray, IntArray

_STEPS = 1e6
"""Whole numbers that the largest weight is counted in: sums of flow are then exact, in whatever order they are made."""
_FREE, _ROOT, _ORPHAN = -1, -2, -3
_jit = numba.njit(cache=CACHE, nogil=True)


def min_cut(pulls: NDArray[np.floating], pairs: IntArray, weights: NDArray[np.floating]) -> BoolArray:
    """Which nodes are on the first side of the cheapest division, (N,).

    Cheapest is the division with the least sum of |pull| over nodes on the side that they are not drawn to, plus the
    weights of edges whose ends are on different sides. What nothing draws to the first side is not on it.

    Args:
        pulls: how much each node is drawn to the first side, or, below zero, to the second, (N,); infinite values
            put it there.
        pairs: the ends of each edge, (E, 2).
        weights: what it costs to part them, (E,), at least zero; the same edge may be given several times.

    >>> line = np.array([[0, 1], [1, 2], [2, 3]])
    >>> min_cut(np.array([np.inf, 0, 0, -np.inf]), line, np.array([1.0, 0.5, 1.0])).tolist()
    [True, True, False, False]
    """
    n, weights = len(pulls), np.asarray(weights, np.float64)
    finite = np.abs(pulls[np.isfinite(pulls)])
    largest = max(float(weights.max(initial=0)), float(finite.max(initial=0)), 1e-300)
    arcs = np.round(weights * (_STEPS / largest)).astype(np.int64)
    limit = int(arcs.sum()) + round(float(finite.sum()) * (_STEPS / largest)) + 1
    ends = np.round(np.nan_to_num(pulls * (_STEPS / largest), posinf=limit, neginf=-limit)).astype(np.int64)
    starts, heads, reverse, capacity = _arcs(n, np.asarray(pairs, np.int64), arcs)
    return np.asarray(_cut(ends, starts, heads, reverse, capacity))


def _arcs(n: int, pairs: IntArray, capacity: IntArray) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Both directions of every edge, sorted by the node that they leave: where each node's begin (N + 1,), the node
    that each reaches, the place of its opposite, and its capacity, (2 E,) each."""
    tails, heads = np.concatenate([pairs[:, 0], pairs[:, 1]]), np.concatenate([pairs[:, 1], pairs[:, 0]])
    order = np.argsort(tails, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    opposite = np.concatenate([place[len(pairs) :], place[: len(pairs)]])[order]
    starts = np.concatenate([[0], np.cumsum(np.bincount(tails, minlength=n))])
    return starts, heads[order], opposite, np.concatenate([capacity, capacity])[order]


@_jit
def _cut(pulls, starts, heads, reverse, capacity):  # type: ignore[no-untyped-def]
    """Push flow until the search trees no longer touch; the first tree is then the first side.

    `pulls` (N,) and `capacity` (A,) are used up: they hold what can still flow.
    """
    n = len(pulls)
    parent = np.full(n, _FREE)  # The arc that leads to the parent.
    second = np.zeros(n, np.bool_)  # Which of the two trees a node is in.
    queue, waiting, first, count = np.empty(n, np.int64), np.zeros(n, np.bool_), 0, 0
    stamp, distance, time = np.zeros(n, np.int64), np.zeros(n, np.int64), 0
    orphans = np.empty(n, np.int64)
    for i in range(n):
        if pulls[i] != 0:
            parent[i], second[i], distance[i] = _ROOT, pulls[i] < 0, 1
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
        n_orphans = _push(bridge, parent, pulls, heads, reverse, capacity, orphans)
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
def _push(bridge, parent, pulls, heads, reverse, capacity, orphans):  # type: ignore[no-untyped-def]
    """Push what can flow over a bridge from first to second tree; cut-off nodes become orphans. Their number."""
    flow = capacity[bridge]
    a, b = heads[reverse[bridge]], heads[bridge]
    i = a
    while parent[i] != _ROOT:
        flow = min(flow, capacity[reverse[parent[i]]])
        i = heads[parent[i]]
    flow = min(flow, pulls[i])
    i = b
    while parent[i] != _ROOT:
        flow = min(flow, capacity[parent[i]])
        i = heads[parent[i]]
    flow = min(flow, -pulls[i])

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
    pulls[i] -= flow
    if pulls[i] == 0:
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
    pulls[i] += flow
    if pulls[i] == 0:
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
