"""The rules of a comparison: threshold, occlusion, fidelity."""

from dataclasses import replace

import numpy as np
from scenes import gaussian

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.evaluation.ground_truth import TestView, Truth
from gaussian_trimmer.evaluation.scoring import HIGHEST_PSNR, Cut, Judge
from gaussian_trimmer.gaussians import concatenate

CAMERA = Camera(np.eye(4), np.array([[40.0, 0, 20], [0, 40, 20], [0, 0, 1]]), 40, 40, "a.png")
NEAR = gaussian((0, 0, 1), 0.15, opacity=0.98, colour=(0, 0, 1))
FAR = gaussian((0, 0, 3), 0.9, opacity=0.8, colour=(1, 0, 0))


def judge(**rules):
    return Judge(**rules)


def view(coverage, image=None):
    truth = Truth(coverage, np.ones(coverage.shape, np.bool_))
    return TestView(CAMERA, image, truth, truth)


def test_what_stands_before_an_object_hides_it_in_its_scene_only():
    shown = judge().show(Cut(FAR, NEAR), CAMERA)
    assert shown.alpha[20, 20] > 0.7 and shown.share[20, 20] < 0.1
    whole = view((shown.alpha > 0.5).astype(np.float32))
    scores = judge().score(shown, whole)
    assert scores["iou"] == 100 and scores["iou_in_scene"] < 90 and scores["accuracy_in_scene"] < 100
    visible = Truth((shown.share > 0.5).astype(np.float32), whole.alone.counted)
    assert judge().score(shown, replace(whole, in_scene=visible))["iou_in_scene"] == 100
    unknown = judge().score(judge().show(Cut(FAR, None), CAMERA), whole)
    assert unknown == {name: score for name, score in scores.items() if not name.endswith("in_scene")}


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
