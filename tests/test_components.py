"""Pieces: of voxels that touch, by hand, and of points within reach of each other, against a search over all pairs."""

import numpy as np
import pytest
from toy import any_rotation

from gaussian_trimmer.geometry.graphs import connected_points, connected_voxels


def by_all_pairs(points, reach):
    """Labels by spreading the smallest index over all pairs within reach."""
    near = np.linalg.norm(points[:, None] - points[None], axis=2) <= reach
    labels = np.arange(len(points))
    while True:
        spread = np.where(near, labels[None], len(points)).min(axis=1)
        if (spread == labels).all():
            return labels
        labels = spread


def same_pieces(a, b):
    return len(set(zip(a.tolist(), b.tolist(), strict=True))) == len(np.unique(a)) == len(np.unique(b))


@pytest.mark.parametrize("reach", [0.05, 0.15, 0.3, 3.0])
@pytest.mark.parametrize("n", [1, 2, 300])
def test_pieces_are_those_of_all_pairs(n, reach):
    points = np.random.default_rng(n).uniform(-1, 1, (n, 3))
    assert same_pieces(connected_points(points, reach), by_all_pairs(points, reach))


@pytest.mark.parametrize("seed", range(4))
def test_neither_place_nor_turn_matter(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (400, 3))
    moved = points @ any_rotation(seed).T + rng.uniform(-50, 50, 3)
    assert same_pieces(connected_points(points, 0.17), connected_points(moved, 0.17))


@pytest.mark.parametrize(("gap", "pieces"), [(0.999, 1), (1.001, 2)])
def test_a_row_of_points_falls_apart_where_a_step_is_too_long(gap, pieces):
    row = np.cumsum([0, 0.9, 0.9, gap, 0.9])[:, None] * np.array([[0.6, 0.0, 0.8]])
    assert len(np.unique(connected_points(row, 1.0))) == pieces


def test_voxels_touch_at_faces_edges_and_corners():
    middle = np.full((1, 3), 0.5)
    steps = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), -1).reshape(-1, 3)
    for step in steps:
        assert len(np.unique(connected_voxels(np.concatenate([middle, middle + step]), 1.0))) == 1
        if step.any():
            assert len(np.unique(connected_voxels(np.concatenate([middle, middle + 2 * step]), 1.0))) == 2


def test_voxels_hang_together_through_others():
    chain = np.stack([np.arange(7) + 0.5, np.arange(7) + 0.5, np.zeros(7)], axis=1)
    assert same_pieces(connected_voxels(chain, 1.0), np.zeros(7, int))
    assert same_pieces(connected_voxels(np.delete(chain, 3, axis=0), 1.0), np.array([0, 0, 0, 1, 1, 1]))


@pytest.mark.parametrize("offset", [1e3, 5e5, -4e6, 1e9])
def test_the_distance_from_the_origin_does_not_matter(offset):
    near = np.round(np.random.default_rng(5).uniform(-1, 1, (400, 3)) * 1024) / 1024  # so that no sum is rounded
    far = near + offset * np.array([1.0, -2.0, 0.5])
    assert np.array_equal(far - offset * np.array([1.0, -2.0, 0.5]), near)
    expected = connected_points(near, 0.25)
    assert 3 < len(np.unique(expected)) < 200
    assert same_pieces(connected_points(far, 0.25), expected)


@pytest.mark.parametrize("away", [1e6, 1e12, 1e100])
def test_what_lies_far_apart_is_not_one_piece(away):
    near = np.random.default_rng(6).uniform(0, 1, (200, 3))
    far = away * np.array([[1, 0, 0], [1, 0, 0], [1, 1, 0], [-1, 0, 0], [1.5, 0, 0]])
    points = np.concatenate([far[:3], near, far[3:]])
    pieces = connected_points(points, 0.2)
    assert same_pieces(pieces, by_all_pairs(points, 0.2))
    assert pieces[0] == pieces[1]
    assert len(np.unique(pieces[[1, 2, -2, -1]])) == 4


def test_steps_of_two_cells_stay_apart_where_the_axes_are_shortened():
    cells = np.array([0, 1, 3, 6, 10, 1e9, 1e9 + 2, 1e9 + 5])[:, None] * np.array([[1.0, 0, 0]])
    points = np.concatenate([cells / np.sqrt(3), cells[:, [1, 0, 2]] / np.sqrt(3)])
    assert same_pieces(connected_points(points, 1.0), by_all_pairs(points, 1.0))


def test_no_points():
    assert connected_points(np.zeros((0, 3)), 1.0).shape == (0,)
    assert connected_voxels(np.zeros((0, 3)), 1.0).shape == (0,)
