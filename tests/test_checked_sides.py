"""What a trim says of the sides that it did not judge."""

from dataclasses import replace

import numpy as np
import pytest
import toy

from gaussian_trimmer.cameras import Camera, CameraSet, intrinsics, look_at
from gaussian_trimmer.output.checked_sides import checked_sides, shrunk_side
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.views.virtual_cameras import PlanConfig

SCENE, TRUTH = toy.ball_on_floor()


def sides(yaws=None, views=5, rejected=(), cameras=None):
    config = toy.small_config(plan=PlanConfig(size=64, views=views, yaw_range_degrees=yaws))
    result = trim(SCENE, TRUTH, config=config, cameras=cameras)
    judged = tuple(replace(v, rejected="bad" if i in rejected else "") for i, v in enumerate(result.views))
    return checked_sides(replace(result.only, views=judged), result.cameras)


def training_cameras(*yaws):
    places = [np.array([6 * np.cos(yaw), 6 * np.sin(yaw), 2.0]) for yaw in np.radians(yaws)]
    poses = [look_at(place, toy.CENTRE, toy.UP) for place in places]
    K = intrinsics(0.8, 64, 64)
    return CameraSet(tuple(Camera(pose, K, 64, 64) for pose in poses), None, (True,) * len(poses), False)


@pytest.mark.parametrize("views", [4, 5, 12])
def test_a_full_circle_of_accepted_views_is_seen_from_all_around(views):
    found = sides(views=views)
    height = ", from 30 degrees above the horizon"
    part = f"checked over 288 of 360 degrees{height}; the other 72 were not checked"
    assert found.sentence() == (f"checked from all sides{height}" if views > 4 else part)


def test_views_over_an_arc_leave_the_far_side_unchecked():
    found = sides(yaws=(20, 74))
    assert (
        found.sentence()
        == "checked over 54 of 360 degrees, from 30 degrees above the horizon; the far side was not checked"
    )
    assert found.as_json()["yaw_ranges_degrees"] == [[20, 74]]
    assert found.middle == 47
    assert found.verdict(47) == ""
    assert found.verdict(227) == "no accepted view from here"


def test_rejected_views_judge_nothing():
    found = sides(rejected=[2])
    assert found.sentence().startswith("checked over 288 of 360 degrees, from 30")
    assert found.verdict(144) == "no accepted view from here"
    nothing = sides(rejected=range(5))
    assert nothing.sentence() == "no side was checked"


def test_directions_that_no_training_camera_saw_are_not_judged():
    found = sides(yaws=(0, 360), cameras=training_cameras(10, 40, 70))
    assert found.degrees == 60
    assert found.verdict(found.middle) == ""
    assert found.verdict(found.middle + 180) == "no photograph from here"


def test_the_side_is_named_from_which_much_of_a_selection_was_taken():
    part = trim(SCENE, TRUTH, config=toy.small_config()).only
    positions = SCENE.means[part.selected_rows]
    heights = positions @ part.bounds.axes[2]
    foot = heights < np.quantile(heights, 0.15)
    assert "at its foot" in shrunk_side(part, positions, foot)
    assert "at its top" in shrunk_side(part, positions, heights > np.quantile(heights, 0.85))
    assert shrunk_side(part, positions, np.zeros_like(foot)) is None
    assert shrunk_side(part, positions, foot & (np.arange(len(foot)) % 4 == 0)) is None
    assert shrunk_side(replace(part, refused="bad"), positions, foot) is None


def test_what_is_said_of_a_side_is_a_warning_of_the_report():
    scene, truth = toy.ball_on_floor()
    near = truth | ((np.linalg.norm(scene.means - toy.CENTRE, axis=1) < 1.6 * toy.RADIUS) & (scene.means[:, 2] < 0.1))
    report = trim(scene, near, config=toy.small_config()).report
    assert "at its foot" in report["shrunk_side"]
    assert report["warnings"] == [f"{report['shrunk_side']}."]
