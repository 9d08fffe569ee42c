"""The rules of a comparison: threshold, occlusion, fidelity."""

import numpy as np
import pytest
from scenes import gaussian

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.ground_truth import TestView
from gaussian_trimmer.evaluation.scoring import HIGHEST_PSNR, Cut, Judge, mean_scores
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.rendering import get_renderer

CAMERA = Camera(np.eye(4), np.array([[40.0, 0, 20], [0, 40, 20], [0, 0, 1]]), 40, 40, "a.png")
NEAR = gaussian((0, 0, 1), 0.15, opacity=0.98, colour=(0, 0, 1))
FAR = gaussian((0, 0, 3), 0.9, opacity=0.8, colour=(1, 0, 0))


def judge(**rules):
    return Judge(get_renderer("reference"), **rules)


def view(coverage, image=None):
    everywhere = np.ones(coverage.shape, np.bool_)
    return TestView(CAMERA, image, coverage, everywhere, everywhere)


def test_an_occluded_object_is_hidden_in_the_scene_alone():
    cut = Cut(FAR, NEAR)
    alone, hidden = judge().show(cut, CAMERA), judge(occlusion="in-scene").show(cut, CAMERA)
    assert alone.alpha[20, 20] > 0.7 and hidden.alpha[20, 20] < 0.1
    np.testing.assert_array_equal(alone.rgb, hidden.rgb)  # pictures are of the object alone under both rules
    scores = judge(occlusion="in-scene").score(hidden, view((alone.alpha > 0.5).astype(np.float32)))
    assert scores["iou"] < 90


def test_occlusion_needs_the_rest_of_the_scene():
    with pytest.raises(InputError, match="not known"):
        judge(occlusion="in-scene").show(Cut(FAR, None), CAMERA)


def test_the_threshold_is_that_of_the_rendering_only():
    shown = judge().show(Cut(FAR, None), CAMERA)
    truth = view((shown.alpha > 0.3).astype(np.float32))
    assert judge(threshold=0.3).score(shown, truth)["iou"] == 100
    assert judge(threshold=0.6).score(shown, truth)["iou"] < 80
    coarse = view(np.float32(0.4) * (shown.alpha > 0.3))
    assert judge(threshold=0.3).score(shown, coarse)["iou"] == 0  # ground truth counts above one half


def test_without_a_picture_there_is_no_psnr():
    shown = judge().show(Cut(FAR, None), CAMERA)
    assert "psnr" not in judge().score(shown, view(shown.alpha))
    assert judge().score(shown, view(shown.alpha, np.zeros((40, 40, 3), np.float32)))["psnr"] < 60


def test_fidelity_of_all_parts_is_that_of_equal_pictures():
    whole = concatenate([FAR, NEAR])
    untouched = judge().show(Cut(whole, None), CAMERA).rgb
    assert judge().fidelity(Cut(FAR, NEAR), CAMERA, untouched) == {"fidelity": HIGHEST_PSNR}
    assert judge().fidelity(Cut(FAR, FAR.select(slice(0, 0))), CAMERA, untouched)["fidelity"] < 30
    assert judge().fidelity(Cut(FAR, None), CAMERA, untouched) == {}


def test_an_empty_object_shows_nothing():
    shown = judge().show(Cut(FAR.select(slice(0, 0)), None), CAMERA)
    assert not shown.alpha.any() and shown.rgb.shape == (40, 40, 3)
    assert judge().score(shown, view(np.ones((40, 40), np.float32)))["iou"] == 0


def test_rules_are_named():
    text = judge(threshold=0.1, occlusion="in-scene").describe()
    assert "alpha > 0.1" in text and "occlusion counts" in text and "renderer: reference" in text
    assert "no occlusion" in judge().describe()


def test_means_leave_out_what_a_view_lacks():
    assert mean_scores([]) == {}
    assert mean_scores([{"iou": 1.0}, {"iou": 2.0, "psnr": 30.0}]) == {"iou": 1.5, "psnr": 30.0}
