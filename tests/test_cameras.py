"""Cameras: where points appear, where rays go, how cameras are placed."""

import numpy as np
import pytest
from scenes import CAMERA_POSITION, SCENE_CENTRE, front_camera

from gaussian_trimmer.cameras import Camera, intrinsics, look_at, unit_up
from gaussian_trimmer.errors import InputError

UP = np.array([0.0, 0.0, 1.0])


def placed(position, target=(0.0, 0.0, 0.0), up=UP, width=120, height=80):
    transform = look_at(np.array(position), np.array(target), np.array(up))
    return Camera(transform, intrinsics(np.radians(60), width, height), width, height)


POSITIONS = [(3.0, 0.0, 0.0), (0.0, -4.0, 1.0), (-2.0, 1.0, -2.0), (0.5, 0.5, 5.0)]


@pytest.mark.parametrize("position", POSITIONS)
def test_a_placed_camera_is_rigid_and_sees_its_target_in_the_middle_upright(position):
    target = np.array([0.3, -0.2, 0.1])
    camera = placed(position, target)
    np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(camera.rotation) == pytest.approx(1)
    np.testing.assert_allclose(camera.centre, position, atol=1e-12)
    np.testing.assert_allclose(camera.to_camera(camera.centre[None]), np.zeros((1, 3)), atol=1e-12)
    distance = np.linalg.norm(target - position)
    np.testing.assert_allclose(camera.forward, (target - position) / distance, atol=1e-12)
    right = np.cross(camera.forward, UP)
    pixels, depths = camera.project(target + np.stack([np.zeros(3), 0.1 * UP, 0.1 * right]))
    np.testing.assert_allclose(pixels[0], [60, 40], atol=1e-9)
    assert depths[0] == pytest.approx(distance)
    assert pixels[1, 1] < 40 and pixels[1, 0] == pytest.approx(60)
    assert pixels[2, 0] > 60 and pixels[2, 1] == pytest.approx(40)


def test_a_part_of_a_view_shows_the_same_from_its_own_corner():
    camera = placed(POSITIONS[0])
    part = camera.part(30, 10, 100, 60)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (5, 3))
    np.testing.assert_allclose(part.project(points)[0], camera.project(points)[0] - [30, 10], atol=1e-9)
    assert (part.width, part.height) == (70, 50)


def test_look_at_refuses_what_has_no_answer():
    with pytest.raises(ValueError, match="own position"):
        look_at(np.ones(3), np.ones(3), UP)
    with pytest.raises(ValueError, match="parallel"):
        look_at(np.array([0.0, 0, 5]), np.zeros(3), UP)


def test_projection_by_hand():
    K = np.array([[100, 0, 30], [0, 200, 20], [0, 0, 1.0]])
    points = np.array([[0.5, -0.1, 2.0], [0.0, 0.0, 1.0], [1, 1, -1], [1, 1, 0]])
    pixels, depths = Camera(np.eye(4), K, 60, 40).project(points)
    np.testing.assert_allclose(pixels, [[55, 10], [30, 20], [np.nan] * 2, [np.nan] * 2])
    np.testing.assert_allclose(depths, [2, 1, -1, 0])


def test_rays_pass_through_the_points_of_their_pixels():
    camera = front_camera()
    points = SCENE_CENTRE + np.random.default_rng(0).uniform(-1, 1, (50, 3))
    pixels, _ = camera.project(points)
    directions = camera.ray_directions(pixels)
    expected = (points - CAMERA_POSITION) / np.linalg.norm(points - CAMERA_POSITION, axis=1, keepdims=True)
    np.testing.assert_allclose(directions, expected, atol=1e-9)


@pytest.mark.parametrize(("width", "height"), [(100, 100), (120, 80), (80, 120)])
def test_intrinsics_span_the_longer_side(width, height):
    fov = np.radians(50)
    camera = Camera(np.eye(4), intrinsics(fov, width, height), width, height)
    middle = np.array([width / 2, height / 2])
    half = np.array([width / 2, 0]) if width >= height else np.array([0, height / 2])
    first, last = camera.ray_directions(np.stack([middle - half, middle + half]))
    assert np.arccos(first @ last) == pytest.approx(fov)
    assert camera.K[0, 0] == camera.K[1, 1]


@pytest.mark.parametrize("scale", [0.5, 0.37, 2.0])
def test_resized_sees_the_same(scale):
    camera = front_camera()
    resized = camera.resized(scale)
    assert (resized.width, resized.height) == (round(83 * scale), round(61 * scale))
    assert (camera.resized(1e-3).width, camera.resized(1e-3).height) == (1, 1)
    ratio = np.array([resized.width / camera.width, resized.height / camera.height])
    points = SCENE_CENTRE + np.random.default_rng(0).uniform(-1, 1, (20, 3))
    np.testing.assert_allclose(resized.project(points)[0], camera.project(points)[0] * ratio)


@pytest.mark.parametrize("scale", [1e-300, 1e-160, 1.0, 7.0, 1e160, 1e300])
def test_an_up_vector_of_any_length_is_brought_to_one(scale):
    up = unit_up(scale * np.array([1.0, -2.0, 2.0]))
    np.testing.assert_allclose(up, np.array([1, -2, 2]) / 3, rtol=1e-12)


@pytest.mark.parametrize(
    "vector", [(0, 0, 0), (0, 1), (1, np.nan, 0), (np.inf, 0, 0), "up", None, [[0, 0, 1]], [{}] * 3]
)
def test_what_has_no_direction_is_no_up_vector(vector):
    with pytest.raises(InputError, match=r"^The up vector.* must be three finite numbers that are not all zero\.$"):
        unit_up(vector)
    with pytest.raises(InputError, match=r"^'a.json': the up vector"):
        unit_up(vector, "'a.json': the up vector")
