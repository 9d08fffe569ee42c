"""Which views of a ball are chosen: free all around, before a wall, in a niche, in other units."""

import numpy as np
import pytest
from toy import BLUE, CENTRE, UP, any_rotation, ball_on_floor, gaussians, moved

from gaussian_trimmer import trim
from gaussian_trimmer.cameras import Camera, intrinsics, look_at, up_frame
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.geometry.bounds import robust_bounds
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.views.by_sight import choose_views

SCENE, TRUTH = ball_on_floor(n_floaters=0)
COUNT = 12


def direction(yaw_degrees):
    """Horizontal unit vector at a yaw in the planner's frame, (3,)."""
    yaw = np.radians(yaw_degrees)
    return np.array([np.cos(yaw), np.sin(yaw), 0]) @ up_frame(UP)


def with_walls(*yaws_degrees, distance=1.5, half=2.5, opacity=0.95):
    """The ball with upright walls of Gaussians at some yaws, and which Gaussians are the ball."""
    walls = []
    for yaw in yaws_degrees:
        away = direction(yaw)
        across, upwards = (grid.reshape(-1, 1) for grid in np.meshgrid(*[np.linspace(-half, half, 40)] * 2))
        means = CENTRE + distance * away + across * np.cross(UP, away) + (upwards + 1.5) * UP
        walls.append(gaussians(means, (0.1,) * 3, BLUE, opacity))
    return concatenate([SCENE, *walls]), np.append(TRUTH, np.zeros(sum(map(len, walls)), np.bool_))


def chosen(scene, selection, up=UP, count=COUNT):
    bounds = robust_bounds(scene.select(selection), up_frame(up))
    return choose_views(scene, np.flatnonzero(selection), np.flatnonzero(~selection), bounds, count)


def outwards(views, count=COUNT):
    places = np.array([camera.centre for camera in views.cameras(count, 32, 60.0, 0.75)]) - views.bounds.centre
    return places / np.linalg.norm(places, axis=1, keepdims=True)


def test_views_of_a_free_object_go_around_it():
    views = chosen(SCENE, TRUTH)
    yaws = np.sort(views.yaws[:5])
    assert np.diff(np.append(yaws, yaws[0] + 2 * np.pi)).max() < np.radians(150)
    assert views.free > 20


@pytest.mark.parametrize("yaw", [20, 110, 200, 290])
def test_no_view_stands_behind_a_wall(yaw):
    assert (outwards(chosen(*with_walls(yaw)), 5) @ direction(yaw) < 0.7).all()


def test_an_object_in_a_niche_is_seen_from_its_open_side():
    views = chosen(*with_walls(90, 180, 270))
    assert (outwards(views, 5) @ direction(0) > 0).all()
    assert views.free < chosen(SCENE, TRUTH).free


def test_an_object_in_a_niche_is_trimmed():
    scene, truth = with_walls(90, 180, 270)
    result = trim(scene, truth, up=UP, config=TrimConfig.of({"plan.size": 64}))
    assert result.objects[0].refused is None
    assert np.count_nonzero(result.object_mask & truth) > 0.95 * np.count_nonzero(truth)
    assert np.count_nonzero(result.object_mask & ~truth) < 0.02 * np.count_nonzero(truth)


def test_an_object_that_is_walled_in_is_trimmed_with_a_warning():
    scene, truth = with_walls(0, 90, 180, 270, distance=1.2, half=3)
    roof = gaussians(
        np.array([[x, y, 4.0] for x in np.linspace(-3, 3, 50) for y in np.linspace(-3, 3, 50)]), (0.1,) * 3, BLUE, 0.95
    )
    scene, truth = concatenate([scene, roof]), np.append(truth, np.zeros(len(roof), np.bool_))
    assert chosen(scene, truth).free < 3
    warnings = trim(scene, truth, up=UP, config=TrimConfig.of({"plan.size": 64})).objects[0].warnings
    assert any("directions that were tried show half of the object; the best is at" in text for text in warnings)


def test_haze_is_no_wall():
    assert chosen(*with_walls(0, opacity=0.02)).free > 20


@pytest.mark.parametrize(("scale", "shift"), [(100.0, (0, 0, 0)), (0.01, (3, -2, 1))])
def test_units_and_place_do_not_matter(scale, shift):
    scene, truth = with_walls(90)
    views, others = chosen(scene, truth), chosen(moved(scene, np.eye(3), scale, shift), truth)
    np.testing.assert_allclose(others.yaws, views.yaws)
    np.testing.assert_allclose(others.pitches, views.pitches)


def test_a_turned_scene_is_seen_from_the_same_side():
    rotation = any_rotation(3)
    scene, truth = with_walls(0)
    turned = chosen(moved(scene, rotation), truth, rotation @ UP)
    assert (outwards(turned, 5) @ (rotation @ direction(0)) < 0.7).all()


def test_more_views_begin_with_those_of_fewer():
    few, many = chosen(SCENE, TRUTH, count=5), chosen(SCENE, TRUTH)
    np.testing.assert_array_equal(many.yaws[:5], few.yaws)
    assert len(many.yaws) == COUNT


@pytest.mark.parametrize(("yaw", "comes_first"), [(0, True), (77, True), (180, False)])
def test_the_view_of_a_mark_is_taken_first_where_it_shows_the_object(yaw, comes_first):
    scene, truth = with_walls(180)
    camera = Camera(look_at(CENTRE + 9 * direction(yaw), CENTRE, UP), intrinsics(1.0, 64, 64), 64, 64)
    rows, rest = np.flatnonzero(truth), np.flatnonzero(~truth)
    views = choose_views(scene, rows, rest, robust_bounds(scene.select(rows), up_frame(UP)), COUNT, [camera])
    assert (abs(views.yaws[0] - np.radians(yaw)) < 0.02) == comes_first


@pytest.mark.parametrize("plan", [{"yaw_range_degrees": (0, 360)}, {"pitch_degrees": 30}, {"framing": "paper"}])
def test_what_the_plan_states_itself_is_left_alone(plan):
    config = TrimConfig.of({f"plan.{name}": value for name, value in plan.items()})
    assert not config.plan.is_free and TrimConfig().plan.is_free
