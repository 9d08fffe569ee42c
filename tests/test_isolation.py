"""The object alone: what sticks out of it once the scene no longer hides it, and what no view can tell."""

from dataclasses import replace

import numpy as np
import pytest
import toy

from gaussian_trimmer.config import EvidenceConfig
from gaussian_trimmer.decomposition.isolation import find_in_place
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.rendering.reference import ReferenceRenderer
from gaussian_trimmer.trimming.trim import trim

SCENE, TRUTH = toy.ball_on_floor(n_ball=1500)
DARK = (0.05, 0.02, 0.02)
RADIUS = float(np.linalg.norm(np.ptp(SCENE.means[TRUTH], axis=0)) / 2)
CAMERAS = [toy.camera_at(toy.CENTRE + offset, size=64) for offset in ([4, 1, 2], [-3, 3, 1], [0.5, -4, 3])]


def with_smear(depth):
    """Three tall dark Gaussians below the ball, at the end of the scene, and a selection that holds them."""
    smear = toy.gaussians([[0, 0, -depth], [0.2, 0.1, -depth], [-0.2, 0, -depth]], (0.1, 0.1, 0.2), DARK)
    return concatenate([SCENE, smear]), np.append(TRUTH, np.ones(3, np.bool_))


def in_place(scene, members, masks=None, min_share=0.7):
    return find_in_place(scene, members, CAMERAS, masks, RADIUS, min_share)


def trimmed(scene, selection, **evidence):
    return trim(scene, selection, config=replace(toy.small_config(), evidence=EvidenceConfig(**evidence))).object_mask


def test_a_smear_below_the_floor_is_not_part_of_the_object():
    scene, selection = with_smear(0.4)
    found = trimmed(scene, selection)
    assert not found[-3:].any()
    assert toy.jaccard(found[:-3], TRUTH) > 0.98
    assert trimmed(scene, selection, min_in_place=0.0)[-3:].all()


def test_what_lies_in_the_ball_stays():
    assert trimmed(*with_smear(-0.6))[-3:].all()


def test_the_ball_itself_stays_and_nothing_joins():
    kept = in_place(SCENE, TRUTH)
    assert not (kept & ~TRUTH).any()
    assert (kept & TRUTH).sum() > 0.99 * TRUTH.sum()


@pytest.mark.parametrize(("distance", "stays"), [(0.02, False), (1.5, True)])
def test_what_is_hidden_from_near_by_sticks_out_and_from_afar_no_view_can_tell(distance, stays):
    """A plate beside the ball, and a screen in front of it, seen from one side."""
    plate = toy.gaussians([[0, 2.2, 1]], (0.02, 0.4, 0.4), DARK)
    side = np.stack(np.meshgrid(np.linspace(1, 3.4, 13), np.linspace(-0.2, 2.2, 13)), -1).reshape(-1, 2)
    screen = toy.gaussians(np.column_stack([np.full(len(side), distance), side]), (0.01, 0.15, 0.15), (0.9, 0.9, 0.9))
    scene = concatenate([SCENE, plate, screen])
    members = np.concatenate([TRUTH, [True], np.zeros(len(side), np.bool_)])
    camera = toy.camera_at((8, 0, 1), size=96)
    kept = find_in_place(scene, members, [camera], None, RADIUS, 0.7)
    assert kept[len(SCENE)] == stays


def test_known_masks_take_the_place_of_what_the_scene_shows():
    nowhere = [np.zeros((64, 64), np.float32) for _ in CAMERAS]
    shown = in_place(SCENE, TRUTH) & ~in_place(SCENE, TRUTH, nowhere)
    everywhere = in_place(*with_smear(0.4), [np.ones((64, 64), np.float32) for _ in CAMERAS])
    assert shown.sum() > 0.5 * TRUTH.sum()
    assert everywhere[-3:].all()


def test_the_shares_are_those_of_the_reference_renderer():
    """Every threshold gives the Gaussians whose share, by the readable renderer, reaches it."""
    scene, members = with_smear(0.1)
    near = members | (np.linalg.norm(scene.means - toy.CENTRE, axis=1) < 2.2)
    scene, members = scene.select(near), members[near]
    renderer, sums = ReferenceRenderer(), 0
    for camera in CAMERAS:
        alone, whole = renderer.render(scene.select(members), camera), renderer.render(scene, camera)
        share = renderer.blend_values(scene, camera, members[:, None].astype(np.float32))[..., 0]
        nearer = (whole.depth > 0) & (whole.depth < alone.depth - 0.1 * RADIUS) & (alone.alpha > 0.02)
        labels = np.where(nearer & (share < 0.25 * alone.alpha), 2, share >= 0.5 * alone.alpha).astype(np.uint8)
        sums = sums + renderer.blend_weights(scene.select(members), camera, labels, 2)
    shares = np.divide(sums[:, 1], sums.sum(axis=1), out=np.ones(len(sums)), where=sums.sum(axis=1) > 0)
    for least in (0.3, 0.7, 0.9):
        clear = np.abs(shares - least) > 0.02
        np.testing.assert_array_equal(in_place(scene, members, None, least)[members][clear], (shares >= least)[clear])
        assert np.count_nonzero(shares[clear] < least) > 0


def test_no_members_are_no_problem():
    none = np.zeros(len(SCENE), np.bool_)
    assert not in_place(SCENE, none).any()
