"""From where a ball was seen: free all around, with a wall on one side, among other things on a table."""

from dataclasses import replace

import numpy as np
import pytest
from toy import BLUE, CENTRE, UP, any_rotation, ball_on_floor, gaussians, moved

from gaussian_trimmer.cameras import up_frame
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.geometry.bounds import robust_bounds
from gaussian_trimmer.views.observed_side import limit_yaw_to_observed
from gaussian_trimmer.views.virtual_cameras import PlanConfig, plan_cameras

SCENE, TRUTH = ball_on_floor(n_floaters=0)
STEP = 22.5
"""Degrees between the middles of two sectors."""


def direction(yaw_degrees):
    """Horizontal unit vector at a yaw in the planner's frame, (3,)."""
    yaw = np.radians(yaw_degrees)
    return np.array([np.cos(yaw), np.sin(yaw), 0]) @ up_frame(UP)


def with_wall(yaw_degrees, distance=1.5, half=2.5, opacity=0.95):
    """The ball with an upright wall of Gaussians at that yaw, and which of them are the ball."""
    away = direction(yaw_degrees)
    across, upwards = (grid.reshape(-1, 1) for grid in np.meshgrid(*[np.linspace(-half, half, 40)] * 2))
    means = CENTRE + distance * away + across * np.cross(UP, away) + (upwards + 1.5) * UP
    wall = gaussians(means, (0.1,) * 3, BLUE, opacity)
    return concatenate([SCENE, wall]), np.append(TRUTH, np.zeros(len(wall), np.bool_))


def restricted(scene, selection, config=None, up=UP):
    bounds = robust_bounds(scene.select(selection), up_frame(up))
    return limit_yaw_to_observed(scene, selection, bounds, config or PlanConfig())


def test_an_object_free_all_around_leaves_the_plan_as_it_is():
    for config in (PlanConfig(), PlanConfig(views=3, size=64, fill=0.5)):
        assert restricted(SCENE, TRUTH, config) is config


def test_an_object_without_surroundings_leaves_the_plan_as_it_is():
    config = PlanConfig()
    assert restricted(SCENE.select(TRUTH), np.ones(np.count_nonzero(TRUTH), np.bool_), config) is config


@pytest.mark.parametrize("yaw", range(0, 360, 30))
def test_a_wall_behind_the_object_turns_the_views_away_from_it_at_a_low_pitch(yaw):
    plan = restricted(*with_wall(yaw))
    first, last = plan.yaw_range_degrees
    middle = (first + last) / 2
    assert abs((middle - yaw) % 360 - 180) <= STEP / 2  # opposite, as well as sectors can tell
    assert 0 < last - first <= 180
    assert plan.pitch_degrees == pytest.approx(10, abs=2)  # it is about as tall as it is wide


@pytest.mark.parametrize(
    "config", [PlanConfig(yaw_range_degrees=(0, 360)), PlanConfig(pitch_degrees=30), PlanConfig(framing="paper")]
)
def test_what_the_plan_states_itself_is_left_alone(config):
    assert restricted(*with_wall(0), config) is config


@pytest.mark.parametrize("change", [{"opacity": 0.02}, {"half": 0.15}])
def test_haze_and_posts_are_no_walls(change):
    config = PlanConfig()
    assert restricted(*with_wall(0, **change), config) is config


def test_a_turned_scene_is_seen_from_the_same_side():
    rotation = any_rotation(3)
    scene, truth = with_wall(0)
    turned = moved(scene, rotation)
    plan = restricted(turned, truth, up=rotation @ UP)
    cameras, bounds = plan_cameras(turned.select(truth), rotation @ UP, plan)
    outward = np.array([camera.centre for camera in cameras]) - bounds.centre
    assert (outward @ (rotation @ direction(0)) < 0).all()


def test_the_flatter_the_object_the_higher_the_views_from_its_free_side_stand():
    squeezed = np.array([1.0, 1.0, 0.3])
    scene, truth = with_wall(0)
    ball = scene.select(truth)
    flat = replace(
        ball, means=(CENTRE + (ball.means - CENTRE) @ up_frame(UP).T * squeezed @ up_frame(UP)).astype(np.float32)
    )
    others = scene.select(~truth)
    scene = concatenate([flat, others])
    plan = restricted(scene, np.arange(len(scene)) < len(flat))
    assert 20 < plan.pitch_degrees < 28
