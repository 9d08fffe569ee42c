"""The object alone: what sticks out of it once the scene no longer hides it, and what no view can tell."""

from dataclasses import replace

import numpy as np
import pytest
import toy

from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.geometry.planes import Plane
from gaussian_trimmer.rendering import blend_values, blend_weights, render
from gaussian_trimmer.trimming.alpha_targets import OutlineViews
from gaussian_trimmer.trimming.config import EvidenceConfig
from gaussian_trimmer.trimming.evidence import prune
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.views.view import TOUCHING_RADII

SCENE, TRUTH = toy.ball_on_floor(n_ball=1500)
DARK = (0.05, 0.02, 0.02)
RADIUS = float(np.linalg.norm(np.ptp(SCENE.means[TRUTH], axis=0)) / 2)
CAMERAS = [toy.camera_at(toy.CENTRE + offset, size=64) for offset in ([4, 1, 2], [-3, 3, 1], [0.5, -4, 3])]
FLOOR = Plane(toy.UP, -0.1)


def with_smear(depth):
    """Three tall dark Gaussians below the ball, at the end of the scene, and a selection that holds them."""
    smear = toy.gaussians([[0, 0, -depth], [0.2, 0.1, -depth], [-0.2, 0, -depth]], (0.1, 0.1, 0.2), DARK)
    return concatenate([SCENE, smear]), np.append(TRUTH, np.ones(3, np.bool_))


def in_place(scene, members, masks=None, min_share=0.7, ground=None):
    return consistent(scene, members, OutlineViews(CAMERAS, masks, RADIUS, ground), min_share)


def consistent(scene, members, views, min_share):
    return prune(scene, members, members, views, min_share)


def trimmed(scene, selection, **evidence):
    return trim(scene, selection, config=replace(toy.small_config(), evidence=EvidenceConfig(**evidence))).object_mask


def test_a_smear_below_the_floor_is_not_part_of_the_object():
    scene, selection = with_smear(0.1)
    found = trimmed(scene, selection)
    assert not found[-3:].any()
    assert toy.jaccard(found[:-3], TRUTH) > 0.95
    assert trimmed(scene, selection, min_in_place=0.0)[-3:].all()


def test_what_lies_in_the_ball_stays():
    assert trimmed(*with_smear(-0.6))[-3:].all()


def test_the_ball_stays_but_for_its_foot_and_nothing_joins():
    kept = in_place(SCENE, TRUTH)
    assert not (kept & ~TRUTH).any()
    assert kept[TRUTH & (SCENE.means[:, 2] > 0.3)].all()


@pytest.mark.parametrize(("distance", "stays"), [(0.1, False), (2.5, True)])
def test_what_is_hidden_from_near_by_sticks_out_and_from_afar_no_view_can_tell(distance, stays):
    """A plate beside the ball and a screen that hides it, looked at from one side."""
    plate = toy.gaussians([[0, 2.2, 1]], (0.02, 0.1, 0.1), DARK)
    y, z = (axis.ravel() for axis in np.meshgrid(np.linspace(1, 3.4, 25), np.linspace(-0.2, 2.2, 25)))
    screen = toy.gaussians(np.column_stack([np.full_like(y, distance), y, z]), (0.01, 0.15, 0.15), (0.9, 0.9, 0.9))
    scene = concatenate([SCENE, plate, screen])
    members = np.concatenate([TRUTH, [True], np.zeros(len(y), np.bool_)])
    views = OutlineViews([toy.camera_at((12, 2.2, 1), (0, 2.2, 1), size=96)], None, RADIUS)
    assert consistent(scene, members, views, 0.7)[len(SCENE)] == stays


def test_what_the_ground_hides_sticks_out_however_deep():
    plate = toy.gaussians([[0, 0, -2]], (2.0, 2.0, 0.02), DARK)
    scene, members = concatenate([SCENE, plate]), np.append(TRUTH, True)
    kept, on_the_floor = in_place(scene, members), in_place(scene, members, ground=FLOOR)
    assert kept[-1] and not on_the_floor[-1]
    assert on_the_floor[:-1].sum() > 0.9 * kept[:-1].sum()


def test_known_masks_take_the_place_of_what_the_scene_shows():
    nowhere = [np.zeros((64, 64), np.float32) for _ in CAMERAS]
    shown = in_place(SCENE, TRUTH) & ~in_place(SCENE, TRUTH, nowhere)
    everywhere = in_place(*with_smear(0.4), [np.ones((64, 64), np.float32) for _ in CAMERAS])
    assert shown.sum() > 0.5 * TRUTH.sum()
    assert everywhere[-3:].all()


def test_the_shares_are_those_of_the_reference():
    """Every threshold gives the Gaussians whose share, drawn by the reference, reaches it."""
    scene, members = with_smear(0.1)
    near = members | (np.linalg.norm(scene.means - toy.CENTRE, axis=1) < 2.2)
    scene, members = scene.select(near), members[near]
    sums = 0
    for camera in CAMERAS:
        alone, whole = render(scene.select(members), camera), render(scene, camera)
        share = blend_values(scene, camera, members[:, None].astype(np.float32))[..., 0]
        nearer = (whole.depth > 0) & (whole.depth < alone.depth - TOUCHING_RADII * RADIUS)
        placed = share >= 0.5 * alone.alpha
        labels = np.where(nearer & ~placed, 2, placed).astype(np.uint8)
        sums = sums + blend_weights(scene.select(members), camera, labels, 2)
    shares = np.divide(sums[:, 1], sums.sum(axis=1), out=np.ones(len(sums)), where=sums.sum(axis=1) > 0)
    for least in (0.3, 0.7, 0.9):
        clear = np.abs(shares - least) > 0.02
        np.testing.assert_array_equal(in_place(scene, members, None, least)[members][clear], (shares >= least)[clear])
        assert np.count_nonzero(shares[clear] < least) > 0


@pytest.mark.parametrize(("opacity_logit", "joins"), [(4, True), (-4, False)])
def test_what_joins_is_seen_as_the_object(opacity_logit, joins):
    """A ball beside the first, dense or so faint that the floor is seen through it, which labels took along."""
    beside = SCENE.select(TRUTH).replace(means=SCENE.means[TRUTH] + np.float32([2.1, 0, 0]))
    beside = beside.replace(opacity_logits=np.full(len(beside), opacity_logit, np.float32))
    scene, joining = concatenate([SCENE, beside]), np.arange(len(SCENE) + len(beside)) >= len(SCENE)
    members = np.append(TRUTH, np.ones(len(beside), np.bool_))
    views = OutlineViews(CAMERAS, None, RADIUS)
    joined, selected = (prune(scene, members, of, views, 0.7)[joining] for of in (members & ~joining, members))
    shown = beside.means[:, 2] > 1
    assert (joined[shown].mean() > 0.9) == joins
    assert joined.sum() < 0.7 * selected.sum() or joins


def test_no_members_are_no_problem():
    none = np.zeros(len(SCENE), np.bool_)
    assert not in_place(SCENE, none).any()
