"""Nearest neighbours against distances of all pairs."""

import numpy as np
import pytest

from gaussian_trimmer.geometry.graphs import nearest


def all_pairs(points, queries):
    """Squared distances (Q, N) in float64."""
    return ((queries[:, None].astype(np.float64) - points[None]) ** 2).sum(-1)


def check(points, queries, k):
    squared, indices = nearest(points, queries, k)
    distances = all_pairs(points, queries)
    found = min(k, len(points))
    assert squared.shape == indices.shape == (len(queries), k)
    np.testing.assert_allclose(squared[:, :found], np.sort(distances, axis=1)[:, :found], rtol=1e-4, atol=1e-6)
    own = np.take_along_axis(distances, indices[:, :found].astype(np.int64), axis=1)
    np.testing.assert_allclose(own, squared[:, :found], rtol=1e-4, atol=1e-6)
    assert all(len(set(row[:found])) == found for row in indices.tolist())
    assert np.isinf(squared[:, found:]).all()
    assert (indices[:, found:] == -1).all()


@pytest.mark.parametrize("dims", range(1, 7))
@pytest.mark.parametrize("n", [1, 2, 15, 16, 17, 33, 500])  # around the size of a leaf
def test_random_points(dims, n):
    rng = np.random.default_rng(dims * 1000 + n)
    points = rng.normal(size=(n, dims)).astype(np.float32)
    queries = (1.5 * rng.normal(size=(60, dims))).astype(np.float32)
    check(points, queries, 1)
    check(points, queries, 7)


def test_points_are_their_own_nearest():
    points = np.random.default_rng(0).random((300, 3)).astype(np.float32)
    squared, indices = nearest(points, points, 2)
    assert indices[:, 0].tolist() == list(range(300))
    assert (squared[:, 0] == 0).all()
    assert (squared[:, 1] > 0).all()


def test_duplicates_are_found_as_often_as_they_occur():
    points = np.repeat(np.random.default_rng(1).random((20, 3)).astype(np.float32), 40, axis=0)
    check(points, points[::7], 40)
    assert (nearest(points, points[::7], 40)[0] == 0).all()


def test_all_points_equal():
    check(np.full((100, 2), 0.5, np.float32), np.array([[0.5, 0.5], [1, 0]], np.float32), 5)


@pytest.mark.parametrize("direction", [(1, 0, 0), (1, 1, 1)])
def test_points_on_a_line(direction):
    steps = np.random.default_rng(2).permutation(400).astype(np.float32)
    points = steps[:, None] * np.float32(direction)
    check(points, points[:50] + np.float32(0.3), 6)


def test_points_on_a_grid_with_many_equal_distances():
    points = np.stack(np.meshgrid(*[np.arange(7.0)] * 3), -1).reshape(-1, 3).astype(np.float32)
    check(points, points, 9)


@pytest.mark.parametrize("k", [1, 4, 9])
def test_ties_are_ordered_by_index(k):
    points = np.stack(np.meshgrid(*[np.arange(7.0)] * 3), -1).reshape(-1, 3)
    points = points[np.random.default_rng(5).permutation(len(points))]
    queries = points[::3] + np.array([0.5, 0, 0])
    order = np.argsort(all_pairs(points, queries), axis=1, kind="stable")[:, :k]
    np.testing.assert_array_equal(nearest(points, queries, k)[1], order)


def test_the_order_of_points_and_queries_does_not_matter():
    rng = np.random.default_rng(6)
    points, queries = rng.normal(size=(5000, 3)), rng.normal(size=(700, 3))
    squared, indices = nearest(points, queries, 5)
    rows, asked = rng.permutation(5000), rng.permutation(700)
    again, permuted = nearest(points[rows], queries[asked], 5)
    np.testing.assert_array_equal(again, squared[asked])
    np.testing.assert_array_equal(rows[permuted], indices[asked])


@pytest.mark.parametrize("n", [0, 1, 3])
def test_fewer_points_than_asked_for(n):
    points = np.arange(3.0 * n).reshape(n, 3).astype(np.float32)
    check(points, np.zeros((4, 3), np.float32), 5)


@pytest.mark.parametrize("reach", [0.0, 0.2, 0.7, 5.0])
def test_nothing_beyond_reach(reach):
    rng = np.random.default_rng(4)
    points, queries = rng.normal(size=(400, 3)).astype(np.float32), rng.normal(size=(90, 3)).astype(np.float32)
    squared, indices = nearest(points, queries, 5, reach)
    everything, those = nearest(points, queries, 5)
    near = np.sqrt(everything) < reach
    assert near.any() == (reach > 0)
    np.testing.assert_array_equal(squared, np.where(near, everything, np.inf))
    np.testing.assert_array_equal(indices, np.where(near, those, -1))


def test_no_queries():
    squared, indices = nearest(np.zeros((5, 3), np.float32), np.zeros((0, 3), np.float32), 2)
    assert squared.shape == indices.shape == (0, 2)


def test_other_types_and_strides_are_accepted():
    points = np.random.default_rng(3).random((3, 80)).T
    squared, indices = nearest(points, points[::2], 3)
    expected = nearest(points.copy(), points[::2].copy(), 3)
    np.testing.assert_array_equal(squared, expected[0])
    np.testing.assert_array_equal(indices, expected[1])
