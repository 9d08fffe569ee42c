"""The trimmer end to end on a ball that stands on a floor: what it mends, and the laws that its answers obey."""

import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import toy
from toy import (
    UP,
    any_rotation,
    ball_on_floor,
    camera_at,
    check_parts,
    dilated,
    eroded,
    gaussians,
    jaccard,
    moved,
    object_rows,
    small_config,
    with_floaters,
)

from gaussian_trimmer.cameras import Camera, CameraSet, intrinsics, look_at
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.geometry.split import SPLIT_RULES
from gaussian_trimmer.masks.sam import draw_masks
from gaussian_trimmer.output.report import describe
from gaussian_trimmer.rendering import blend_values
from gaussian_trimmer.trimming.config import PlanConfig, SplitConfig, TrimConfig, paper_config
from gaussian_trimmer.trimming.result import RowLabel
from gaussian_trimmer.trimming.trim import trim, trim_objects, views_to_segment
from gaussian_trimmer.views.virtual_cameras import plan_cameras

SCENE, TRUTH = ball_on_floor()
SPECKLED = TRUTH ^ ((np.random.default_rng(1).random(len(SCENE)) < 0.05) & dilated(SCENE, TRUTH, 1.0))
SELECTIONS = {
    "dilated": dilated(SCENE, TRUTH, 0.3),
    "eroded": eroded(SCENE, TRUTH, 0.1),
    "with floaters": with_floaters(SCENE, TRUTH),
    "speckled": SPECKLED,
}
WHOLE = SplitConfig("none")


pytestmark = pytest.mark.usefixtures("one_thread")


@cache
def trimmed(kind):
    return trim(SCENE, SELECTIONS[kind], config=small_config(split=WHOLE))


@pytest.mark.parametrize("kind", SELECTIONS)
def test_rough_selections_of_the_ball_are_mended(kind):
    result = trimmed(kind)
    assert result.objects[0].refused is None
    assert jaccard(object_rows(result), TRUTH) > max(0.96, jaccard(SELECTIONS[kind], TRUTH) + 0.01)


@pytest.mark.parametrize(("apart", "n_second"), [(2.5, 700), (2.5, 250), (5.0, 350), (8.0, 700)])
def test_both_pieces_of_a_selection_are_kept(apart, n_second):
    second = moved(SCENE.select(np.flatnonzero(TRUTH)[:n_second]), np.eye(3), 1.0, (apart, 0, 0))
    truth = np.append(TRUTH, np.ones(n_second, np.bool_))
    result = trim(concatenate([SCENE, second]), truth, config=small_config(split=WHOLE))
    assert (result.objects[0].refused, result.objects[0].floaters) == (None, 0)
    assert object_rows(result)[len(SCENE) :].mean() > 0.98
    assert jaccard(object_rows(result), truth) > 0.96


def test_floaters_are_counted_and_left_to_the_background():
    result = trimmed("with floaters")
    assert result.objects[0].floaters == np.count_nonzero(SELECTIONS["with floaters"] & ~TRUTH) > 0
    assert not object_rows(result)[SELECTIONS["with floaters"] & ~TRUTH].any()


@pytest.mark.parametrize("kind", SELECTIONS)
def test_without_splits_object_and_background_are_the_scene(kind):
    result = trimmed(kind)
    assert len(result.object) + len(result.background) + len(result.discarded) == len(SCENE)
    assert len(result.discarded) < 0.01 * len(SCENE)  # what the floor or the ball hides
    check_parts(result, SELECTIONS[kind])


@pytest.mark.parametrize("rule", SPLIT_RULES)
def test_split_gaussians_have_their_parts_on_both_sides(rule):
    config = small_config(split=SplitConfig(rule), plan=PlanConfig(size=160, pitch_degrees=30))
    result = toy.trim_by(toy.tight, SCENE, SPECKLED, config=config)
    assert result.count(RowLabel.SPLIT_INSIDE) > 0
    assert result.count(RowLabel.SPLIT_OUTSIDE) == (0 if rule == "sagd" else result.count(RowLabel.SPLIT_INSIDE))
    check_parts(result, SPECKLED)


def test_the_report_of_a_run():
    stages = []
    result = trim(SCENE, TRUTH, config=small_config(split=WHOLE), progress=stages.append)
    assert {"plan", "render", "correct", "prune"} <= set(stages) == set(result.seconds)
    assert not any(view.judged for view in result.objects[0].views)
    assert len(result.objects[0].views) == 5
    np.testing.assert_array_equal(result.objects[0].up.direction, UP)
    assert np.linalg.norm(result.objects[0].bounds.centre - [0, 0, 1]) < 0.1
    assert "background" not in vars(result)  # made when it is asked for
    assert result.background is result.background


def test_the_outline_is_fitted_only_to_masks_that_know_it_better_than_the_scene():
    cameras, _ = plan_cameras(SCENE.select(TRUTH), UP, PlanConfig(size=96))
    config = small_config(refine="fit")
    views, _ = views_to_segment(SCENE, TRUTH, config=config, view_cameras=cameras)
    masks = [(view.camera, toy.tight(view)) for view in views]
    own, of_pictures = (trim(SCENE, TRUTH, config=config, masks=masks, view_cameras=known) for known in (cameras, None))
    assert len(own.objects[0].fitted) and len(of_pictures.objects[0].fitted)
    assert own.object.opacity_logits.tolist() != of_pictures.object.opacity_logits.tolist()
    logits = [(camera, np.where(mask, 3.0, -3.0)) for camera, mask in masks]
    again = trim(SCENE, TRUTH, config=config, masks=logits)
    np.testing.assert_array_equal(again.object.opacity_logits, of_pictures.object.opacity_logits)


def test_masks_in_the_views_of_the_trim_itself_are_those_of_renderings():
    """Silhouettes that are handed back say what the labels say."""
    config = small_config(refine="fit")
    plain = trim(SCENE, SPECKLED, config=config)
    back = toy.trim_by(lambda view: view.silhouette, SCENE, SPECKLED, config=config)
    assert jaccard(back.object_mask, plain.object_mask) > 0.98


def test_the_scene_without_the_object_is_made_once_and_when_it_is_asked_for():
    stages = []
    result = trim(SCENE, SELECTIONS["dilated"], config=small_config(background="clean"), progress=stages.append)
    assert len(result.object)
    assert "remove" not in stages
    for shown in (result, replace(result, contested=1), pickle.loads(pickle.dumps(result))):
        assert 0 < len(shown.background) == len(shown.background_source) < len(SCENE)
    assert stages.count("remove") == 1
    assert "remove" in result.seconds


def test_masks_are_of_one_object():
    with pytest.raises(InputError, match="Masks are of one object, and 2 are to be trimmed"):
        trim_objects(SCENE, [TRUTH, ~TRUTH], masks=[])


def test_what_hides_the_object_in_given_views_speaks_against_nothing():
    """A fence far before the ball hides its lower part in every view, so the masks have only the upper one."""
    y, z = np.meshgrid(np.linspace(-4, 4, 60), np.linspace(-1, 0.6, 13))
    fence = gaussians(np.stack([np.full(y.size, 5.0), y.ravel(), z.ravel()], -1), 0.1, (0.2, 0.6, 0.2), 0.99)
    scene, truth = concatenate([SCENE, fence]), np.append(TRUTH, np.zeros(y.size, np.bool_))
    cameras = [camera_at((9, y, 1), size=128) for y in (-2, 0, 2)]

    shares = truth.astype(np.float32)[:, None]
    masks = [(camera, blend_values(scene, camera, shares)[..., 0] > 0.5) for camera in cameras]
    result = trim(scene, truth, config=small_config(split=WHOLE), masks=masks)
    assert result.objects[0].refused is None
    behind_it = truth & (scene.means[:, 2] > 0.2) & (scene.means[:, 2] < 0.9)
    assert object_rows(result)[behind_it].mean() > 0.95


@pytest.mark.parametrize("depth", [0.0, 0.3])
def test_looking_again_from_the_same_places_changes_nothing(depth):
    scene, truth = ball_on_floor(0, 1500)
    selection = eroded(scene, truth, depth)
    cameras, _ = plan_cameras(scene.select(selection), UP, PlanConfig(size=48))
    once, often = (trim(scene, selection, config=small_config(), view_cameras=cameras * n) for n in (1, 12))
    np.testing.assert_array_equal(often.object_mask, once.object_mask)


def test_permuting_the_scene_permutes_the_answer():
    order = np.random.default_rng(7).permutation(len(SCENE))
    result = trim(SCENE.select(order), SPECKLED[order], config=small_config(split=WHOLE))
    np.testing.assert_array_equal(object_rows(result), object_rows(trimmed("speckled"))[order])


@pytest.mark.parametrize(
    ("scale", "shift", "turn"), [(1, (50, -20, 5), 0), (1000, (0, 0, 0), 0), (0.01, (1, 1, 1), 3), (1e-4, (0, 0, 0), 0)]
)
def test_a_moved_scene_gives_the_same_object(scale, shift, turn):
    rotation = any_rotation(turn) if turn else np.eye(3)
    scene = moved(SCENE, rotation, scale, shift)
    result = trim(scene, SPECKLED, config=small_config(split=WHOLE, up=tuple(rotation @ UP)))
    # The yaws start elsewhere after a turn, and coordinates are rounded: a few Gaussians at the rim may differ.
    assert jaccard(object_rows(result), object_rows(trimmed("speckled"))) > 0.98


@pytest.mark.parametrize("n_unusable", [0, 3])
def test_an_object_without_its_scene_stays_whole(n_unusable):
    ball = SCENE.select(TRUTH)
    ball.opacity_logits[:n_unusable] = -np.inf
    result = trim(ball, np.ones(len(ball), np.bool_), config=small_config(split=WHOLE, refine="fit"))
    assert result.objects[0].refused is None
    assert len(result.object) > 0.98 * len(ball)
    assert len(result.object) + len(result.background) == len(ball) - n_unusable
    assert "nothing lies around" in result.objects[0].not_fitted and not len(result.objects[0].fitted)


@pytest.mark.parametrize("draw", [toy.empty, toy.opposite])
@pytest.mark.parametrize("kind", ["dilated", "with floaters"])
def test_masks_that_contradict_the_selection_leave_it_as_it_is(draw, kind):
    result = toy.trim_by(draw, SCENE, SELECTIONS[kind], config=small_config())
    assert "0 of 5 views" in result.objects[0].refused
    assert all(view.rejected for view in result.objects[0].views)
    np.testing.assert_array_equal(object_rows(result), SELECTIONS[kind])
    assert set(result.objects[0].label) == {RowLabel.KEPT}
    check_parts(result, SELECTIONS[kind])


def test_cameras_that_do_not_see_the_object_leave_it_as_it_is():
    away = Camera(look_at(np.array([0, -5.0, 1]), np.array([0, -9.0, 1]), UP), intrinsics(1.0, 64, 64), 64, 64)
    result = trim(SCENE, SPECKLED, config=small_config(), view_cameras=[away])
    assert "the object is hidden or missing" in result.objects[0].refused
    np.testing.assert_array_equal(object_rows(result), SPECKLED)


def test_given_views_replace_planned_ones():
    K = intrinsics(0.8, 120, 90)
    yaws = np.radians([10, 80, 150, 220, 290])
    positions = np.stack([5 * np.cos(yaws), 5 * np.sin(yaws), np.full(5, 3.5)], axis=1)
    views = [Camera(look_at(place, np.array([0, 0, 1.0]), UP), K, 120, 90) for place in positions]
    result = trim(SCENE, SPECKLED, config=small_config(split=WHOLE), view_cameras=views)
    assert [view.view.camera for view in result.objects[0].views] == views
    assert result.objects[0].views[0].mask.shape == (90, 120)
    assert jaccard(object_rows(result), TRUTH) > 0.97


def test_training_cameras_limit_where_the_trimmer_looks_from():
    K = intrinsics(0.8, 64, 64)
    positions = [np.array([x, -5.0, 2.0]) for x in (-0.6, 0, 0.6)] + [np.array([0, 5.0, 2.0])]
    cameras = tuple(Camera(look_at(place, np.array([0, 0, 1.0]), UP), K, 64, 64) for place in positions)
    known = CameraSet(cameras, None, (True, True, True, False), False)  # the one behind took no training image
    result = trim(SCENE, TRUTH, config=small_config(split=WHOLE), cameras=known)
    assert all(view.view.camera.centre[1] < -1 for view in result.objects[0].views)


def test_the_papers_choices_run():
    config = paper_config(small_config())
    assert (config.plan.framing, config.split.rule, config.up) == ("paper", "principal_axis", (0.0, 0.0, 1.0))
    selection = dilated(SCENE, TRUTH, 0.3)
    result = trim(SCENE, selection, config=paper_config(TrimConfig(up=(0.0, 0.0, 1.0))))
    assert result.count(RowLabel.ADDED) == 0
    check_parts(result, selection)


def test_grabcut_draws_masks_for_a_trim():
    config = small_config(split=WHOLE)
    result = trim(SCENE, SPECKLED, config=config, masks=draw_masks(SCENE, SPECKLED, paper=True, config=config))
    assert all(view.judged for view in result.objects[0].views)
    assert jaccard(object_rows(result), TRUTH) > 0.97


@pytest.mark.parametrize("count", [1, 4])
def test_objects_too_small_to_be_judged_are_left_as_they_are(count):
    tiny = np.zeros(len(SCENE), np.bool_)
    tiny[np.flatnonzero(TRUTH)[:count]] = True
    result = trim(SCENE, tiny, config=small_config())
    assert result.objects[0].refused
    np.testing.assert_array_equal(object_rows(result), tiny)


def test_a_fitted_outline_says_which_rows_are_no_longer_the_scenes():
    fitted = trim(SCENE, SELECTIONS["dilated"], config=small_config(refine="fit"))
    plain = trim(SCENE, SELECTIONS["dilated"], config=small_config())
    assert len(fitted.objects[0].fitted) and not len(plain.objects[0].fitted)
    assert describe(fitted)["objects"][0]["counts"]["fitted"] == len(fitted.objects[0].fitted)
    np.testing.assert_array_equal(fitted.object_mask, plain.object_mask)
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"):
        rows, theirs = getattr(fitted.object, name), getattr(SCENE, name)[fitted.objects[0].source_index]
        same = (rows == theirs).reshape(len(rows), int(np.prod(rows.shape[1:]))).all(axis=1)
        assert same[np.setdiff1d(np.arange(len(rows)), fitted.objects[0].fitted)].all()
        np.testing.assert_array_equal(getattr(fitted.background, name), getattr(plain.background, name))
    assert set(fitted.object.extras) == set(plain.object.extras)
    parts = np.flatnonzero(fitted.objects[0].label == RowLabel.SPLIT_INSIDE)
    assert set(parts) <= set(fitted.objects[0].fitted)
