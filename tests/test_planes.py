"""Planes: distances with a sign, the densest layer, and fits that are the same wherever and however a plane lies."""

import numpy as np
import pytest
from toy import any_rotation

from gaussian_trimmer.geometry.planes import (
    Plane,
    densest_layer,
    find_plane,
    fit_plane,
    floor_and_wall_directions,
    inlier_shares,
    random_planes,
)

RNG = np.random.default_rng(0)
SHEET = np.column_stack([RNG.uniform(-1, 1, (500, 2)), RNG.normal(0, 0.005, 500)])
CLOUD = RNG.uniform(-1, 1, (500, 3))
BOTH, ONES = np.concatenate([SHEET, CLOUD]), np.ones(1000)


def test_distances_are_positive_on_the_side_of_the_normal():
    plane = Plane(np.array([0.0, 0.6, 0.8]), 2.0)
    np.testing.assert_allclose(plane.signed_distance(np.array([[5.0, 1.2, 1.6], [0, 0, 0], [0, 6, 8]])), [0, -2, 8])


def test_the_densest_layer_is_three_bins_of_most_weight():
    heights = np.array([0.05, 0.5, 0.52, 0.61, 3.0])
    assert densest_layer(heights, np.array([1.0, 1, 1, 1, 2.5]), 0.1, 0.0) == (pytest.approx(0.5433, abs=1e-4), 3)
    assert densest_layer(heights, np.array([1.0, 1, 1, 1, 3.5]), 0.1) == (3.0, 3.5)
    assert densest_layer(np.zeros(0), np.zeros(0), 0.1) is densest_layer(heights, np.zeros(5), 0.1) is None


@pytest.mark.parametrize("seed", range(3))
def test_a_fit_turns_moves_and_grows_with_the_points(seed):
    rotation, shift, scale = any_rotation(seed), np.array([3.0, -20, 7]), 50.0
    moved = scale * BOTH @ rotation.T + shift
    guess = Plane(rotation @ np.array([0.02, 0, 1.0]) / np.hypot(0.02, 1), float(rotation[:, 2] @ shift))
    found = fit_plane(guess, moved, ONES, 0.05 * scale)
    straight = fit_plane(Plane(np.array([0.02, 0, 1.0]) / np.hypot(0.02, 1), 0.0), BOTH, ONES, 0.05)
    np.testing.assert_allclose(found.normal, rotation @ straight.normal, atol=1e-3)
    np.testing.assert_allclose(found.signed_distance(moved), scale * straight.signed_distance(BOTH), atol=1e-2 * scale)
    assert abs(straight.normal[2]) > 0.999


def test_a_fit_that_tilts_too_far_is_not_taken():
    guess = Plane(np.array([np.sin(0.3), 0, np.cos(0.3)]), 0.0)
    assert fit_plane(guess, SHEET, ONES[:500], 0.5, np.cos(0.1)) is guess


@pytest.mark.parametrize("turn", [0.0, 0.4, 2.0])
def test_a_wall_is_found_between_the_directions(turn):
    normal = np.array([np.cos(turn), np.sin(turn), 0])
    along = np.column_stack([SHEET[:, 0] * -normal[1], SHEET[:, 0] * normal[0], SHEET[:, 1]])
    wall = along + (2 + SHEET[:, 2:]) * normal
    points, order = np.concatenate([wall, CLOUD]), RNG.permutation(1000)
    for some in (points, points[order]):
        plane, guess, held = find_plane(some, floor_and_wall_directions(), lambda d: ONES, 0.02, 0.05)
        side = np.sign(plane.normal @ normal)  # Opposite directions hold as much.
        np.testing.assert_allclose(side * plane.normal, normal, atol=0.01)
        assert side * plane.offset == pytest.approx(2, abs=0.01)
        assert side * guess.normal @ normal > np.cos(np.pi / 48) - 1e-9
        assert len(held) == 49


def test_random_planes_find_a_sheet_that_lies_anywhere():
    points = BOTH @ any_rotation(5).T
    normals, offsets = random_planes(points, 200, 1e-4, np.random.default_rng(0))
    shares = inlier_shares(normals, offsets, points, 0.03)
    assert abs(normals[shares.argmax()] @ any_rotation(5)[:, 2]) > 0.99
    assert len(random_planes(np.ones((9, 3)), 50, 1e-4, np.random.default_rng(0))[0]) == 0
