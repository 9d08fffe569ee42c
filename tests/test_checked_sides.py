"""What a trim says of the sides that it did not judge."""

from dataclasses import replace

import numpy as np
import pytest
import toy

from gaussian_trimmer.cameras import Camera, CameraSet, intrinsics, look_at
from gaussian_trimmer.output.report import checked_sides, describe, middle_degree, sentences, shrunk_side, why_unchecked
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.views.virtual_cameras import PlanConfig

SCENE, TRUTH = toy.ball_on_floor()


class Sides:
    """What is known of the sides of a trimmed ball, some of whose views are rejected."""

    def __init__(self, yaws=(0, 360), views=5, rejected=(), cameras=None):
        config = toy.small_config(plan=PlanConfig(size=64, views=views, yaw_range_degrees=yaws))
        result = trim(SCENE, TRUTH, config=config, cameras=cameras)
        (part,) = result.objects
        judged = tuple(replace(v, rejected="bad" if i in rejected else "") for i, v in enumerate(part.views))
        self.arrays = checked_sides(replace(part, views=judged), result.cameras)
        self.entry = describe(replace(result, objects=(replace(part, views=judged),)))["objects"][0]["checked"]
        self.middle = middle_degree(self.arrays[0])

    def verdict(self, yaw):
        return why_unchecked(yaw, *self.arrays)


def training_cameras(*yaws):
    places = [np.array([6 * np.cos(yaw), 6 * np.sin(yaw), 2.0]) for yaw in np.radians(yaws)]
    poses = [look_at(place, toy.CENTRE, toy.UP) for place in places]
    K = intrinsics(0.8, 64, 64)
    return CameraSet(tuple(Camera(pose, K, 64, 64) for pose in poses), None, (True,) * len(poses), False)


@pytest.mark.parametrize("views", [4, 5, 12])
def test_a_full_circle_of_accepted_views_is_seen_from_all_around(views):
    found = Sides(views=views)
    height = ", from 30 degrees above the horizon"
    part = f"checked over 288 of 360 degrees{height}; the other 72 were not checked"
    assert found.entry["sentence"] == (f"checked from all sides{height}" if views > 4 else part)


def test_views_over_an_arc_leave_the_far_side_unchecked():
    found = Sides(yaws=(20, 74))
    assert (
        found.entry["sentence"]
        == "checked over 54 of 360 degrees, from 30 degrees above the horizon; the far side was not checked"
    )
    assert np.flatnonzero(found.arrays[0])[[0, -1]].tolist() == [20, 73]
    assert found.middle == 47
    assert found.verdict(47) == ""
    assert found.verdict(227) == "no accepted view from here"


def test_rejected_views_judge_nothing():
    found = Sides(rejected=[2])
    assert found.entry["sentence"].startswith("checked over 288 of 360 degrees, from 30")
    assert found.verdict(144) == "no accepted view from here"
    nothing = Sides(rejected=range(5))
    assert nothing.entry["sentence"] == "no side was checked"


def test_directions_that_no_training_camera_saw_are_not_judged():
    found = Sides(cameras=training_cameras(10, 40, 70))
    assert found.entry["degrees"] == 60
    assert found.verdict(found.middle) == ""
    assert found.verdict(found.middle + 180) == "no photograph from here"


def test_the_side_is_named_from_which_much_of_a_selection_was_taken():
    part = trim(SCENE, TRUTH, config=toy.small_config()).objects[0]
    positions = SCENE.means[part.selected_rows]
    heights = positions @ part.bounds.axes[2]
    foot = heights < np.quantile(heights, 0.15)
    assert "at its foot" in shrunk_side(part, positions, foot)
    assert "at its top" in shrunk_side(part, positions, heights > np.quantile(heights, 0.85))
    assert shrunk_side(part, positions, np.zeros_like(foot)) is None
    assert shrunk_side(part, positions, heights < np.quantile(heights, 0.08)) is None  # crumbs
    assert shrunk_side(part, positions, foot & (np.arange(len(foot)) % 4 == 0)) is None
    assert shrunk_side(replace(part, refused="bad"), positions, foot) is None


def test_a_side_that_is_smaller_is_said_and_is_no_warning():
    scene, truth = toy.ball_on_floor()
    near = truth | ((np.linalg.norm(scene.means - toy.CENTRE, axis=1) < 1.6 * toy.RADIUS) & (scene.means[:, 2] < 0.1))
    report = describe(trim(scene, near, config=toy.small_config()))
    (entry,) = report["objects"]
    assert "at its foot" in entry["shrunk_side"] in sentences(report)[0]
    assert not entry["warnings"]
