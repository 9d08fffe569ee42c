"""Tests of the minimum cut of a graph."""

import itertools

import numpy as np
import pytest

from gaussian_trimmer.geometry.graphs import min_cut


def cost(labels, unaries, edges, weights):
    labels = np.asarray(labels, bool)
    apart = labels[edges[:, 0]] != labels[edges[:, 1]]
    return unaries[(unaries > 0) & ~labels].sum() - unaries[(unaries < 0) & labels].sum() + weights[apart].sum()


@pytest.mark.parametrize("seed", range(60))
def test_no_labelling_costs_less(seed):
    """Against all labellings of small random graphs, in which some pairs occur several times."""
    rng = np.random.default_rng(seed)
    n = 8
    edges = rng.integers(0, n, (rng.integers(1, 25), 2))
    edges = edges[edges[:, 0] != edges[:, 1]]
    weights = rng.uniform(0, 1, len(edges))
    unaries = rng.normal(size=n) * (rng.uniform(size=n) < 0.7)
    least = min(cost(labels, unaries, edges, weights) for labels in itertools.product([False, True], repeat=n))
    assert cost(min_cut(unaries, edges, weights), unaries, edges, weights) == pytest.approx(least, abs=1e-4)


def grid(side):
    numbers = np.arange(side * side).reshape(side, side)
    pairs = [
        np.stack([a.ravel(), b.ravel()], 1) for a, b in ((numbers[1:], numbers[:-1]), (numbers[:, 1:], numbers[:, :-1]))
    ]
    return np.concatenate(pairs)


def test_the_cut_runs_where_edges_are_weak():
    side = 40
    edges = grid(side)
    columns = edges % side
    weights = np.where((columns.max(axis=1) == 13) & (columns.min(axis=1) == 12), 0.1, 1.0)
    assert not min_cut(np.zeros(side * side), edges, weights).any()
    strong = np.zeros(side * side)
    strong[np.arange(side) * side], strong[np.arange(side) * side + side - 1] = np.inf, -np.inf
    labels = min_cut(strong, edges, weights).reshape(side, side)
    np.testing.assert_array_equal(labels, np.broadcast_to(np.arange(side) < 13, (side, side)))


def test_scale_and_order_do_not_matter():
    rng = np.random.default_rng(1)
    edges, unaries = grid(12), rng.normal(size=144)
    weights = rng.uniform(0, 0.5, len(edges))
    labels = min_cut(unaries, edges, weights)
    np.testing.assert_array_equal(labels, min_cut(1e-9 * unaries, edges, 1e-9 * weights))
    np.testing.assert_array_equal(labels, min_cut(1e9 * unaries, edges, 1e9 * weights))
    order = rng.permutation(len(edges))
    np.testing.assert_array_equal(labels, min_cut(unaries, edges[order, ::-1], weights[order]))
    nodes = rng.permutation(144)
    place = np.argsort(nodes)
    np.testing.assert_array_equal(labels[nodes], min_cut(unaries[nodes], place[edges], weights))


def test_graphs_without_edges_or_nodes():
    nothing = np.zeros((0, 2), np.int64)
    assert min_cut(np.array([1.0, -1.0, 0.0]), nothing, np.zeros(0)).tolist() == [True, False, False]
    assert len(min_cut(np.zeros(0), nothing, np.zeros(0))) == 0
