"""What hangs below the ball once it is alone: found from just above the floor, and nothing else with it."""

from dataclasses import replace

import numpy as np
import toy

from gaussian_trimmer.config import EvidenceConfig
from gaussian_trimmer.decomposition.underside import reaching_into_ground
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.geometry.support_plane import SupportPlane
from gaussian_trimmer.planning.virtual_cameras import plan_cameras, small_views_from
from gaussian_trimmer.trimming.trim import trim

SCENE, TRUTH = toy.ball_on_floor(n_ball=1500)
DARK = (0.05, 0.02, 0.02)


def with_smear(depth):
    """Three tall dark Gaussians below the ball, at the end of the scene, and a selection that holds them."""
    smear = toy.gaussians([[0, 0, -depth], [0.2, 0.1, -depth], [-0.2, 0, -depth]], (0.1, 0.1, 0.2), DARK)
    return concatenate([SCENE, smear]), np.append(TRUTH, np.ones(3, np.bool_))


def test_a_smear_below_the_floor_is_not_part_of_the_object():
    scene, selection = with_smear(0.4)
    found = trim(scene, selection, config=toy.small_config()).object_mask
    assert not found[-3:].any()
    assert toy.jaccard(found[:-3], TRUTH) > 0.98


def test_without_second_evidence_it_stays():
    scene, selection = with_smear(0.4)
    config = toy.small_config()
    found = trim(scene, selection, config=replace(config, evidence=EvidenceConfig(second_evidence=False))).object_mask
    assert found[-3:].all()


def test_what_lies_in_the_ball_stays():
    scene, selection = with_smear(-0.6)
    assert trim(scene, selection, config=toy.small_config()).object_mask[-3:].all()


def test_views_from_another_height_keep_yaw_distance_and_field_of_view():
    cameras, bounds = plan_cameras(SCENE.select(TRUTH), toy.UP)
    low = small_views_from(cameras, bounds, 8.0, 64)
    for camera, lower in zip(cameras, low, strict=True):
        offset, lower_offset = camera.centre - bounds.centre, lower.centre - bounds.centre
        np.testing.assert_allclose(np.linalg.norm(lower_offset), np.linalg.norm(offset))
        np.testing.assert_allclose(lower_offset @ toy.UP, np.linalg.norm(offset) * np.sin(np.radians(8)), rtol=1e-6)
        across, lower_across = (o - (o @ toy.UP) * toy.UP for o in (offset, lower_offset))
        assert across @ lower_across > 0.999 * np.linalg.norm(across) * np.linalg.norm(lower_across)
        assert (lower.width, lower.height) == (64, 64)
        np.testing.assert_allclose(lower.K[0, 0] / 64, camera.K[0, 0] / camera.width)


def test_a_plane_that_cuts_through_the_object_is_not_the_ground():
    _, bounds = plan_cameras(SCENE.select(TRUTH), toy.UP)
    keep = TRUTH
    heights = ((SCENE.means[keep] - bounds.centre) @ bounds.axes[2]) / bounds.radius
    planes = [
        SupportPlane(np.quantile(heights, share), 0.01, np.ones(len(SCENE), bool), np.zeros(len(SCENE), bool))
        for share in (0.01, 0.5)
    ]
    few, none = (reaching_into_ground(SCENE, keep, bounds, plane) for plane in planes)
    assert 0 < few.sum() < 0.1 * keep.sum()
    assert not none.any()
