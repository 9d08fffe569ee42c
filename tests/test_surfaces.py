"""The flat surfaces that an object touches: floor, wall, the corner of both; no other thing is taken for one."""

import numpy as np
import pytest
import toy

from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.removal.surfaces import find_surfaces

RNG = np.random.default_rng(0)
BALL = RNG.normal(size=(800, 3))
BALL = BALL / np.linalg.norm(BALL, axis=1, keepdims=True) + np.array([0, 0, 1.0])
"""A unit ball on z = 0, beside x = -1."""
FLOOR = np.column_stack([RNG.uniform(-3, 3, (3000, 2)), np.zeros(3000)])
WALL = np.column_stack([np.full(3000, -1.0), RNG.uniform(-3, 3, 3000), RNG.uniform(0, 4, 3000)])
CLOUD = RNG.uniform(-3, 3, (3000, 3))
BOUNDS = Bounds(np.array([0.0, 0.0, 1.0]), np.eye(3), np.ones(3))


def seen_from_all_around(means):
    """Blend weights as if eight views saw everything, and where these look from."""
    turns = 2 * np.pi * np.arange(8) / 8 + 0.1
    eyes = np.column_stack([6 * np.cos(turns), 6 * np.sin(turns), np.full(8, 4.0)])
    return np.ones((8, len(means)), np.float32), eyes


def surfaces_of(*around):
    means = np.concatenate([BALL, *around]).astype(np.float32)
    members = np.arange(len(means)) < len(BALL)
    return find_surfaces(means, members, *seen_from_all_around(means), BOUNDS)


@pytest.mark.parametrize("turn", [0.0, 0.3, 2.0])
def test_floor_and_wall_are_found_whichever_way_the_wall_faces(turn):
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    found = surfaces_of(FLOOR[FLOOR[:, 0] > -1] @ rotation.T, WALL @ rotation.T)
    assert len(found) == 2
    normals = {round(abs(surface.axes[2, 2]), 1): surface for surface in found}
    np.testing.assert_allclose(normals[1.0].axes[2], [0, 0, 1], atol=0.02)
    np.testing.assert_allclose(normals[0.0].axes[2], rotation[:, 0], atol=0.02)
    for surface in found:
        assert np.linalg.det(surface.axes) == pytest.approx(1)
        assert surface.heights(BOUNDS.centre[None])[0] > 0.5
        points = RNG.normal(size=(5, 3))
        np.testing.assert_allclose(surface.points(surface.coordinates(points)), points, atol=1e-9)


def test_the_order_of_gaussians_does_not_matter():
    (first,), (second,) = surfaces_of(FLOOR), surfaces_of(FLOOR[::-1])
    np.testing.assert_allclose(first.axes, second.axes, atol=1e-6)
    np.testing.assert_allclose(first.origin, second.origin, atol=1e-6)


def test_what_hangs_behind_a_wall_does_not_move_it():
    """A picture on a wall, and behind both a haze that only views from behind see."""
    picture = np.column_stack([RNG.uniform(-1.0, -0.97, 400), RNG.uniform((-0.5, 0.5), (0.5, 1.5), (400, 2))])
    its_haze = np.column_stack([RNG.uniform(-1.4, -1.02, 300), RNG.uniform((-0.5, 0.5), (0.5, 1.5), (300, 2))])
    haze = np.column_stack([RNG.uniform(-1.8, -1.02, 4000), RNG.uniform(-2, 2, 4000), RNG.uniform(0, 3, 4000)])
    means = np.concatenate([picture, its_haze, WALL, haze]).astype(np.float32)
    visible, eyes = seen_from_all_around(means)
    hidden = np.repeat([False, True, False, True], [400, 300, len(WALL), len(haze)])
    visible[np.ix_(eyes[:, 0] > -1, hidden)] = 0
    visible[np.ix_(eyes[:, 0] < -1, ~hidden)] = 0
    bounds = Bounds(np.array([-1.0, 0.0, 1.0]), np.eye(3), np.full(3, 0.6))
    (wall,) = find_surfaces(means, np.arange(len(means)) < 700, visible, eyes, bounds)
    np.testing.assert_allclose(wall.axes[2], [1, 0, 0], atol=0.02)
    assert wall.origin[0] == pytest.approx(-1, abs=0.02)


def test_nothing_flat_nothing_found():
    assert surfaces_of(CLOUD) == []
    assert surfaces_of(FLOOR - np.array([0, 0, 2.0])) == []  # far below
    assert surfaces_of(np.zeros((0, 3))) == []


def test_what_lies_before_the_object_is_no_support():
    lid = FLOOR + np.array([0, 0, 1.0])  # through its middle
    assert all(surface.axes[2, 2] < 0.9 for surface in surfaces_of(lid))


def test_the_toy_floor_is_found():
    scene, truth = toy.ball_on_floor()
    bounds = Bounds(scene.means[truth].mean(axis=0).astype(np.float64), np.eye(3), np.ones(3))
    (floor,) = find_surfaces(scene.means, truth, *seen_from_all_around(scene.means), bounds)
    assert floor.axes[2, 2] > 0.99
