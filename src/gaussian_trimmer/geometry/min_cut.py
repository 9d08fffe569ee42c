"""The minimum cut of a graph: the labels of its nodes, object or background, that cost least.

It is found exactly, from the maximum flow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, IntArray

_LARGEST_COST = 1e6
"""Integer that the largest cost is scaled to: sums of integers are exact in any order."""
_CONSTRAINT = np.iinfo(np.int32).max
"""Cost that no cut pays."""


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
