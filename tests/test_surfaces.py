"""The flat surfaces that an object touches: floor, wall, the corner of both; no other thing is taken for one."""

import numpy as np
import pytest
import toy

from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.removal.surfaces import find_surfaces
from gaussian_trimmer.removal.views import RemovalViews
from gaussian_trimmer.views.small_views import views_of_place

RNG = np.random.default_rng(0)
BALL = RNG.normal(size=(800, 3))
BALL = BALL / np.linalg.norm(BALL, axis=1, keepdims=True) + np.array([0, 0, 1.0])
"""A unit ball on z = 0, beside x = -1."""
GRID = (np.arange(46) + 0.5) / 46
FLAT = np.stack(np.meshgrid(6 * GRID - 3, 6 * GRID - 3, indexing="ij"), -1).reshape(-1, 2)
FLOOR = np.column_stack([FLAT, np.full(len(FLAT), -0.02)])
WALL = np.column_stack([np.full(len(FLAT), -1.02), FLAT[:, 0], FLAT[:, 1] + 3])
CLOUD = RNG.uniform(-3, 3, (3000, 3))
BOUNDS = Bounds(np.array([0.0, 0.0, 1.0]), np.eye(3), np.ones(3))


def surfaces_of(*around, observing=()):
    scene = concatenate([toy.gaussians(part, (0.06,) * 3, toy.RED) for part in (BALL, *around)])
    members = np.arange(len(scene)) < len(BALL)
    above = views_of_place(BOUNDS, 96, above=True)
    views = views_of_place(BOUNDS, 96)
    return find_surfaces(RemovalViews(scene, members, members, BOUNDS, views, above, observing))


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
    haze = np.column_stack([RNG.uniform(-1.6, -1.1, 3000), RNG.uniform(-2, 2, 3000), RNG.uniform(0, 3, 3000)])
    (wall,) = surfaces_of(WALL, haze)
    np.testing.assert_allclose(wall.axes[2], [1, 0, 0], atol=0.02)
    assert wall.origin[0] == pytest.approx(-1.02, abs=0.02)


def test_a_wall_is_found_where_parts_of_the_object_lie_behind_it():
    """As those of a picture do that training has put there; most of what is seen of the object lies before it."""
    (wall,) = surfaces_of(WALL + np.array([0.1, 0, 0]))
    assert wall.axes[2, 0] > 0.99
    assert wall.origin[0] == pytest.approx(-0.92, abs=0.03)


def test_a_wall_faces_the_side_from_which_the_object_was_seen():
    """From behind a wall the object may show as well, as a picture does where training put no wall behind it."""
    before, behind = (
        [toy.camera_at(np.array([x, y, 1.5]), BOUNDS.centre) for y in (-1.0, 0.0, 1.0)] for x in (4.0, -4.0)
    )
    assert len(surfaces_of(WALL, observing=before)) == 1
    assert surfaces_of(WALL, observing=behind) == []


def test_the_flat_side_of_a_thing_beside_the_object_is_no_wall():
    """A board as high as the object, with nothing around it, is seen to end."""
    board = np.column_stack([np.full(len(FLAT), -1.02), FLAT[:, 0] / 9 + 1.2, FLAT[:, 1] / 3 + 1])
    (floor,) = surfaces_of(FLOOR, board)
    assert floor.axes[2, 2] > 0.99


def test_nothing_flat_nothing_found():
    assert surfaces_of(CLOUD) == []
    assert surfaces_of(FLOOR - np.array([0, 0, 2.0])) == []  # far below
    assert surfaces_of(np.zeros((0, 3))) == []
