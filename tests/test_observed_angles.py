"""From where training cameras saw an object: one camera, cameras above it, and cameras that look elsewhere."""

import numpy as np
import pytest
from toy import CENTRE, UP, ball_on_floor

from gaussian_trimmer.cameras import Camera, intrinsics, look_at, up_frame
from gaussian_trimmer.geometry.bounds import robust_bounds
from gaussian_trimmer.views.virtual_cameras import cameras_that_see, plan_cameras

SCENE, TRUTH = ball_on_floor(n_floaters=0)
BALL = SCENE.select(TRUTH)
BOUNDS = robust_bounds(BALL, up_frame(UP))


def camera(position, target=CENTRE, up=UP):
    """A training camera of 64 x 64 pixels and 0.9 radians."""
    pose = look_at(np.asarray(position, float), np.asarray(target, float), np.asarray(up, float))
    return Camera(pose, intrinsics(0.9, 64, 64), 64, 64)


def yaws_and_pitches(cameras):
    local = (np.array([camera.centre for camera in cameras]) - BOUNDS.centre) @ BOUNDS.axes.T
    yaws = np.degrees(np.arctan2(local[:, 1], local[:, 0]))
    return yaws, np.degrees(np.arcsin(local[:, 2] / np.linalg.norm(local, axis=1)))


def smallest_turn(cameras):
    """Degrees between the two of all views whose directions are nearest to each other."""
    forward = np.array([camera.forward for camera in cameras])
    cosines = forward @ forward.T - 2 * np.eye(len(forward))
    return np.degrees(np.arccos(cosines.max()))


@pytest.mark.parametrize("position", [(5, 0, 2), (-3, 4, 3), (0, -6, 1)])
def test_views_spread_to_both_sides_of_a_single_training_camera(position):
    seen_from = camera(position)
    planned, _ = plan_cameras(BALL, UP, training_cameras=[seen_from])
    assert smallest_turn(planned) > 2
    yaws, pitches = yaws_and_pitches(planned)
    (yaw,), (pitch,) = yaws_and_pitches([seen_from])
    turned = (yaws - yaw + 180) % 360 - 180
    np.testing.assert_allclose(turned, [-8, -4, 0, 4, 8], atol=1e-6)
    np.testing.assert_allclose(pitches, pitch, atol=0.5)


def test_training_cameras_at_one_place_count_as_one():
    planned, _ = plan_cameras(BALL, UP, training_cameras=[camera((5, 0, 2))] * 3)
    assert smallest_turn(planned) > 2


@pytest.mark.parametrize("offsets", [[(0, 0)], [(0.1, 0), (0, 0.1), (-0.1, -0.1)]])
@pytest.mark.parametrize("side", [1, -1])
def test_cameras_straight_above_or_below_give_views_all_around_their_axis(offsets, side):
    seen_from = [camera(CENTRE + np.array([x, y, 6 * side]), up=(1, 0, 0)) for x, y in offsets]
    planned, _ = plan_cameras(BALL, UP, training_cameras=seen_from)
    yaws, pitches = yaws_and_pitches(planned)
    np.testing.assert_allclose(np.diff(np.sort(yaws)), 72, atol=1e-6)
    np.testing.assert_allclose(pitches, 80 * side, atol=1e-6)
    assert smallest_turn(planned) > 5


def test_a_camera_straight_above_does_not_say_from_which_side_the_others_looked():
    facing = [camera(CENTRE + np.array([6, y, 1])) for y in (-2, -1, 0, 1, 2)]
    above = camera(CENTRE + np.array([-0.1, 0, 6]), up=(1, 0, 0))  # its yaw is opposite to those of the others
    with_it, without = (plan_cameras(BALL, UP, training_cameras=[*facing, *more])[0] for more in ([above], []))
    np.testing.assert_allclose(yaws_and_pitches(with_it)[0], yaws_and_pitches(without)[0], atol=1e-6)


def test_cameras_see_what_lies_before_them_and_within_their_picture():
    towards, away = camera((6, 0, 2)), camera((6, 0, 2), target=(12, 0, 3))
    aside, corner = camera((6, 0, 2), target=(0, 6, 1)), camera((6, 0, 2), target=(0, 2.9, 1))
    assert cameras_that_see([towards, away, aside, corner], BOUNDS) == [towards, corner]


def test_cameras_that_look_elsewhere_say_nothing_of_where_the_object_was_seen_from():
    facing = [camera(CENTRE + np.array([6, y, 1])) for y in (-2, -1, 0, 1, 2)]
    elsewhere = [camera(4 * np.array([np.cos(a), np.sin(a), 0]), 20 * np.array([np.cos(a), np.sin(a), 0.1]))
                 for a in np.radians(range(0, 360, 30))]  # fmt: skip
    both, alone = (plan_cameras(BALL, UP, training_cameras=cameras)[0] for cameras in (facing + elsewhere, facing))
    np.testing.assert_allclose([c.centre for c in both], [c.centre for c in alone])
    blind, free = (plan_cameras(BALL, UP, training_cameras=cameras)[0] for cameras in (elsewhere, ()))
    np.testing.assert_allclose([c.centre for c in blind], [c.centre for c in free])
