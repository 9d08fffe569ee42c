"""Neighbours, pieces and cuts, against searches over all pairs and all labellings."""

import itertools

import numpy as np
import pytest
from toy import any_rotation

from gaussian_trimmer.geometry.graphs import connected_points, connected_voxels, min_cut, nearest


def random(n, dims=3, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (n, dims))


def grid(side, dims=3):
    return np.stack(np.meshgrid(*[np.arange(float(side))] * dims), -1).reshape(-1, dims)


def squared_distances(points, queries):
    """Of all pairs, (Q, N), in float64."""
    return ((queries[:, None].astype(np.float64) - points[None]) ** 2).sum(-1)


class TestNearest:
    @pytest.mark.parametrize("k", [1, 5, 40])
    @pytest.mark.parametrize(
        "points",
        [
            *(random(n, dims, dims) for dims in (1, 2, 3, 6) for n in (0, 1, 3, 16, 500)),
            np.repeat(random(20), 40, axis=0),
            np.full((100, 2), 0.5),
            np.random.default_rng(2).permutation(400)[:, None] * np.array([1.0, 1, 1]),
            grid(7)[np.random.default_rng(5).permutation(343)],
        ],
        ids=lambda value: str(getattr(value, "shape", value)),
    )
    def test_they_are_those_of_all_pairs_and_ties_are_ordered_by_index(self, points, k):
        queries = np.concatenate([points[::7], points[::5] + 0.5, 1.5 * random(20, points.shape[1], 1)])
        squared, indices = nearest(points, queries, k)
        distances, found = squared_distances(points, queries), min(k, len(points))
        order = np.argsort(distances, axis=1, kind="stable")[:, :found]
        np.testing.assert_allclose(squared[:, :found], np.take_along_axis(distances, order, axis=1), rtol=1e-4)
        own = np.take_along_axis(distances, indices[:, :found].astype(np.int64), axis=1)
        np.testing.assert_allclose(own, squared[:, :found], rtol=1e-4, atol=1e-6)
        assert all(len(set(row[:found])) == found for row in indices.tolist())
        assert np.isinf(squared[:, found:]).all() and (indices[:, found:] == -1).all()

    def test_ties_are_ordered_by_index(self):
        points = grid(7)[np.random.default_rng(5).permutation(343)]
        queries = points[::3] + np.array([0.5, 0, 0])
        order = np.argsort(squared_distances(points, queries), axis=1, kind="stable")
        for k in (1, 4, 9):
            np.testing.assert_array_equal(nearest(points, queries, k)[1], order[:, :k])

    def test_neither_order_nor_type_nor_strides_matter(self):
        points, queries = random(5000), random(700, seed=1)
        squared, indices = nearest(points, queries, 5)
        rows, asked = np.random.default_rng(6).permutation(5000), np.random.default_rng(7).permutation(700)
        again, permuted = nearest(np.asfortranarray(points[rows]), queries[asked], 5)
        np.testing.assert_array_equal(again, squared[asked])
        np.testing.assert_array_equal(rows[permuted], indices[asked])
        assert nearest(points.astype(np.float32), queries[:0], 2)[0].shape == (0, 2)

    @pytest.mark.parametrize("reach", [0.0, 0.05, 0.3, 5.0])
    def test_nothing_beyond_reach(self, reach):
        points, queries = random(400), random(90, seed=1)
        everything, those = nearest(points, queries, 5)
        near = np.sqrt(everything) < reach
        assert near.any() == (reach > 0)
        squared, indices = nearest(points, queries, 5, reach)
        np.testing.assert_array_equal(squared, np.where(near, everything, np.inf))
        np.testing.assert_array_equal(indices, np.where(near, those, -1))


def by_all_pairs(points, reach):
    """Labels by spreading the smallest index over all pairs within reach."""
    near, labels = squared_distances(points, points) <= reach**2, np.arange(len(points))
    while True:
        spread = np.where(near, labels[None], len(points)).min(axis=1)
        if (spread == labels).all():
            return labels
        labels = spread


def same_pieces(a, b):
    return len(set(zip(a.tolist(), b.tolist(), strict=True))) == len(np.unique(a)) == len(np.unique(b))


class TestPieces:
    @pytest.mark.parametrize("reach", [0.05, 0.15, 0.3, 3.0])
    @pytest.mark.parametrize("n", [1, 2, 300])
    def test_they_are_those_of_all_pairs_wherever_they_lie(self, n, reach):
        points = random(n, seed=n)
        expected = by_all_pairs(points, reach)
        assert same_pieces(connected_points(points, reach), expected)
        moved = points @ any_rotation(n).T + [40.0, -50, 3]
        assert same_pieces(connected_points(moved, reach), expected)

    @pytest.mark.parametrize(("gap", "pieces"), [(0.999, 1), (1.001, 2)])
    def test_a_row_of_points_falls_apart_where_a_step_is_too_long(self, gap, pieces):
        row = np.cumsum([0, 0.9, 0.9, gap, 0.9])[:, None] * np.array([[0.6, 0.0, 0.8]])
        assert len(np.unique(connected_points(row, 1.0))) == pieces

    @pytest.mark.parametrize("offset", [1e3, 5e5, -4e6, 1e9])
    def test_the_distance_from_the_origin_does_not_matter(self, offset):
        near, away = np.round(random(400) * 1024) / 1024, offset * np.array([1.0, -2.0, 0.5])  # no sum is rounded
        expected = connected_points(near, 0.25)
        assert 3 < len(np.unique(expected)) < 200
        assert same_pieces(connected_points(near + away, 0.25), expected)

    @pytest.mark.parametrize("away", [1e6, 1e12, 1e100])
    def test_what_lies_far_apart_is_not_one_piece(self, away):
        far = away * np.array([[1, 0, 0], [1, 0, 0], [1, 1, 0], [-1, 0, 0], [1.5, 0, 0]])
        points = np.concatenate([far[:3], 0.5 + random(200, seed=6) / 2, far[3:]])
        pieces = connected_points(points, 0.2)
        assert same_pieces(pieces, by_all_pairs(points, 0.2)) and pieces[0] == pieces[1]

    def test_steps_of_two_cells_stay_apart_where_the_axes_are_shortened(self):
        cells = np.array([0, 1, 3, 6, 10, 1e9, 1e9 + 2, 1e9 + 5])[:, None] * np.array([[1.0, 0, 0]])
        points = np.concatenate([cells / np.sqrt(3), cells[:, [1, 0, 2]] / np.sqrt(3)])
        assert same_pieces(connected_points(points, 1.0), by_all_pairs(points, 1.0))

    def test_voxels_touch_at_faces_edges_and_corners_and_through_others(self):
        middle = np.full((1, 3), 0.5)
        for step in grid(3) - 1:
            assert len(np.unique(connected_voxels(np.concatenate([middle, middle + step]), 1.0))) == 1
            if step.any():
                assert len(np.unique(connected_voxels(np.concatenate([middle, middle + 2 * step]), 1.0))) == 2
        chain = (np.arange(7) + 0.5)[:, None] * np.array([1, 1, 0])
        assert same_pieces(connected_voxels(chain, 1.0), np.zeros(7, int))
        assert same_pieces(connected_voxels(np.delete(chain, 3, axis=0), 1.0), np.array([0, 0, 0, 1, 1, 1]))

    def test_no_points(self):
        for find in (connected_points, connected_voxels):
            assert find(np.zeros((0, 3)), 1.0).shape == (0,)


def cost(labels, unaries, edges, weights):
    labels = np.asarray(labels, bool)
    apart = labels[edges[:, 0]] != labels[edges[:, 1]]
    return unaries[(unaries > 0) & ~labels].sum() - unaries[(unaries < 0) & labels].sum() + weights[apart].sum()


def edges_of_grid(side):
    numbers = np.arange(side * side).reshape(side, side)
    pairs = (numbers[1:], numbers[:-1]), (numbers[:, 1:], numbers[:, :-1])
    return np.concatenate([np.stack([a.ravel(), b.ravel()], 1) for a, b in pairs])


class TestMinCut:
    @pytest.mark.parametrize("seed", range(60))
    def test_no_labelling_costs_less(self, seed):
        """Against all labellings of small random graphs, in which some pairs occur several times."""
        rng = np.random.default_rng(seed)
        n = 8
        edges = rng.integers(0, n, (rng.integers(1, 25), 2))
        edges = edges[edges[:, 0] != edges[:, 1]]
        weights = rng.uniform(0, 1, len(edges))
        unaries = rng.normal(size=n) * (rng.uniform(size=n) < 0.7)
        least = min(cost(labels, unaries, edges, weights) for labels in itertools.product([False, True], repeat=n))
        assert cost(min_cut(unaries, edges, weights), unaries, edges, weights) == pytest.approx(least, abs=1e-4)

    def test_the_cut_runs_where_edges_are_weak(self):
        side = 40
        edges = edges_of_grid(side)
        columns = edges % side
        weights = np.where((columns.max(axis=1) == 13) & (columns.min(axis=1) == 12), 0.1, 1.0)
        assert not min_cut(np.zeros(side * side), edges, weights).any()
        strong = np.zeros((side, side))
        strong[:, 0], strong[:, -1] = np.inf, -np.inf
        labels = min_cut(strong.ravel(), edges, weights).reshape(side, side)
        np.testing.assert_array_equal(labels, np.broadcast_to(np.arange(side) < 13, (side, side)))

    def test_scale_and_order_do_not_matter(self):
        rng = np.random.default_rng(1)
        edges, unaries = edges_of_grid(12), rng.normal(size=144)
        weights = rng.uniform(0, 0.5, len(edges))
        labels = min_cut(unaries, edges, weights)
        for factor in (1e-9, 1e9):
            np.testing.assert_array_equal(labels, min_cut(factor * unaries, edges, factor * weights))
        order, nodes = rng.permutation(len(edges)), rng.permutation(144)
        np.testing.assert_array_equal(labels, min_cut(unaries, edges[order, ::-1], weights[order]))
        np.testing.assert_array_equal(labels[nodes], min_cut(unaries[nodes], np.argsort(nodes)[edges], weights))

    def test_graphs_without_edges_or_nodes(self):
        nothing = np.zeros((0, 2), np.int64)
        assert min_cut(np.array([1.0, -1.0, 0.0]), nothing, np.zeros(0)).tolist() == [True, False, False]
        assert len(min_cut(np.zeros(0), nothing, np.zeros(0))) == 0
