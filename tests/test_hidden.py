"""What stands in the object's place once the object is gone: found, and neither the object nor the scene changes."""

from dataclasses import replace

import numpy as np
import pytest
import toy

from gaussian_trimmer.evaluation.scoring import read_result
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.output.report import describe
from gaussian_trimmer.output.saving import save
from gaussian_trimmer.rendering import render
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.views.virtual_cameras import PlanConfig, plan_cameras

SCENE, TRUTH = toy.ball_on_floor(n_ball=1500)
CONFIG = toy.small_config()
DARK, GREEN = (0.05, 0.02, 0.02), (0.1, 0.8, 0.2)


def with_more(means, scales, colour):
    """Scene and true labels with Gaussians of the background added at the end."""
    more = toy.gaussians(means, scales, colour)
    return concatenate([SCENE, more]), np.append(TRUTH, np.zeros(len(more), np.bool_))


def added(result):
    """What became of the added Gaussians: numbers of those in the object, in the background, and in neither."""
    rows = np.arange(len(SCENE), len(result.scene))
    places = (result.objects[0].source_index, result.background_source, result.discarded)
    return tuple(int(np.isin(rows, where).sum()) for where in places)


def psnr(result):
    """The least PSNR of object and background against the scene, from all around."""
    cameras, _ = plan_cameras(result.scene.select(TRUTH_OF[len(result.scene)]), toy.UP, PlanConfig(size=96, fill=0.4))
    both = concatenate([result.object, result.background])
    errors = [np.mean((render(result.scene, camera).rgb - render(both, camera).rgb) ** 2) for camera in cameras]
    return -10 * np.log10(max(*errors, 1e-12))


INSIDE = with_more([[0, 0, 1.0], [0.2, 0.1, 1.1], [-0.2, 0, 0.8]], 0.15, DARK)
BELOW = with_more([[0, 0, -0.02], [0.1, 0.1, -0.02], [-0.1, 0, -0.02]], (0.1, 0.1, 0.02), GREEN)
BESIDE = with_more([[2.2, 0, 0.4], [2.3, 0, 0.5], [2.2, 0.1, 0.6]], 0.15, DARK)
TRUTH_OF = {len(scene): truth for scene, truth in (INSIDE, BELOW, BESIDE)}


def test_what_the_object_hides_inside_it_leaves_the_background():
    scene, truth = INSIDE
    assert added(trim(scene, truth, config=replace(CONFIG, background="exact")))[1] == 3
    result = trim(scene, truth, config=CONFIG)
    joined, left, dropped = added(result)
    assert left == 0
    assert joined + dropped == 3
    assert psnr(result) > 45


def test_foreign_colours_under_the_object_leave_the_background_and_the_ground_stays():
    scene, truth = BELOW
    exact, clean = (trim(scene, truth, config=replace(CONFIG, background=mode)) for mode in ("exact", "clean"))
    _, left, _ = added(exact)
    assert left > 0
    assert added(clean)[1:] == (0, left)
    assert psnr(clean) > 45
    ground = ~truth & (np.abs(scene.means[:, 2] + 0.05) < 0.01) & (np.arange(len(scene)) < len(SCENE))
    assert not ground[clean.discarded].any()
    np.testing.assert_array_equal(clean.object_mask & ground, exact.object_mask & ground)


def test_what_stands_beside_the_object_stays():
    scene, truth = BESIDE
    assert added(trim(scene, truth, config=CONFIG)) == (0, 3, 0)


@pytest.mark.parametrize("mode", ["exact", "clean"])
def test_every_row_is_in_the_object_in_the_background_or_discarded(mode, tmp_path):
    scene, truth = BELOW
    result = trim(scene, truth, config=replace(CONFIG, background=mode))
    rows = np.concatenate([result.objects[0].source_index, result.background_source, result.discarded])
    np.testing.assert_array_equal(np.sort(rows), np.arange(len(scene)))
    report = describe(result)
    counts = report["counts"] | report["objects"][0]["counts"]
    assert counts["discarded"] + counts["hidden"] == len(result.discarded)
    assert (len(result.discarded) > 0) == (mode == "clean")
    assert len(result.background) == len(scene) - len(result.object) - len(result.discarded)
    assert (np.diff(result.discarded) > 0).all()
    stored = read_result(save(result, tmp_path / "t"), scene)
    np.testing.assert_array_equal(stored.selection, result.object_mask)
    np.testing.assert_array_equal(stored.before, truth)
    np.testing.assert_array_equal(np.load(tmp_path / "t" / "labels.npz")["discarded"], result.discarded)


@pytest.mark.parametrize("scene_and_truth", [INSIDE, BELOW, BESIDE], ids=["inside", "below", "beside"])
def test_the_scene_without_it_never_changes_the_object(scene_and_truth):
    """Whatever is made of the scene without it, the object and every label are the same, byte for byte."""
    scene, truth = scene_and_truth
    exact, *others = (
        trim(scene, toy.eroded(scene, truth), config=replace(CONFIG, background=mode))
        for mode in ("exact", "clean", "filled")
    )
    assert np.count_nonzero(exact.object_mask & truth) > 0
    for other in others:
        np.testing.assert_array_equal(other.labels, exact.labels)
        for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"):
            np.testing.assert_array_equal(getattr(other.object, name), getattr(exact.object, name), err_msg=name)


def test_a_trim_that_is_refused_leaves_the_background_as_it_is():
    scene, truth = INSIDE
    result = toy.trim_by(toy.empty, scene, truth, config=CONFIG)
    assert result.objects[0].refused
    assert len(result.discarded) == 0
    toy.check_parts(result, truth)
