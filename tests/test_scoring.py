"""The rules of a comparison: threshold, occlusion, fidelity, and what several objects share."""

import numpy as np
import pytest
from scenes import gaussian

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.evaluation.ground_truth import TestView
from gaussian_trimmer.evaluation.metrics import HIGHEST_PSNR, ious_of, shared_pixels
from gaussian_trimmer.evaluation.scoring import Cut, Judge, draw
from gaussian_trimmer.gaussians import concatenate

CAMERA = Camera(np.eye(4), np.array([[40.0, 0, 20], [0, 40, 20], [0, 0, 1]]), 40, 40, "a.png")
NEAR = gaussian((0, 0, 1), 0.15, opacity=0.98, colour=(0, 0, 1))
FAR = gaussian((0, 0, 3), 0.9, opacity=0.8, colour=(1, 0, 0))


def view(coverage, image=None, visible=None):
    return TestView(CAMERA, image, coverage, np.ones(coverage.shape, np.bool_), visible)


def score(cut, view, scene=None, **rules):
    return Judge(**rules).score_views(cut, [view], scene)[0]


def test_what_stands_before_an_object_hides_it_in_its_scene_only():
    _, alpha, share = draw(Cut(FAR, NEAR), CAMERA)
    assert alpha[20, 20] > 0.7 and share[20, 20] < 0.1
    whole, visible = ((part > 0.5).astype(np.float32) for part in (alpha, share))
    scores = score(Cut(FAR, NEAR), view(whole))
    assert scores["iou"] == 100 and scores["iou_in_scene"] < 90 and scores["accuracy_in_scene"] < 100
    assert score(Cut(FAR, NEAR), view(whole, visible=visible))["iou_in_scene"] == 100
    unknown = score(Cut(FAR, None), view(whole))
    assert unknown == {name: value for name, value in scores.items() if not name.endswith("in_scene")}


def test_the_threshold_is_that_of_the_rendering_only():
    alpha = draw(Cut(FAR, None), CAMERA)[1]
    truth = view((alpha > 0.3).astype(np.float32))
    assert score(Cut(FAR, None), truth, threshold=0.3)["iou"] == 100
    assert score(Cut(FAR, None), truth, threshold=0.6)["iou"] < 80
    coarse = view(np.float32(0.4) * (alpha > 0.3))
    assert score(Cut(FAR, None), coarse, threshold=0.3)["iou"] == 0  # ground truth counts above one half


def test_without_a_picture_there_is_no_psnr():
    alpha = draw(Cut(FAR, None), CAMERA)[1]
    assert "psnr" not in score(Cut(FAR, None), view(alpha))
    assert score(Cut(FAR, None), view(alpha, np.zeros((40, 40, 3), np.float32)))["psnr"] < 60


def test_a_rendering_of_another_size_is_brought_to_the_masks():
    large = view(np.full((80, 80), 1, np.float32))
    blank = np.zeros((40, 40, 3), np.float32)
    assert Judge().score(blank, blank[..., 0] + 1, None, large)["iou"] == 100


def test_fidelity_of_all_parts_is_that_of_equal_pictures():
    whole, truth = concatenate([FAR, NEAR]), view(np.zeros((40, 40), np.float32))
    assert score(Cut(FAR, NEAR), truth, whole)["fidelity"] == HIGHEST_PSNR
    assert score(Cut(FAR, FAR.select(slice(0, 0))), truth, whole)["fidelity"] < 30
    assert "fidelity" not in score(Cut(FAR, None), truth, whole)


def test_objects_share_the_pixels_of_which_they_show_most():
    wide, rows = gaussian((0, 0, 3), 1.5, opacity=0.98), np.eye(2, dtype=bool)
    scene = concatenate([wide, NEAR])
    near, far = ((draw(Cut(a, b), CAMERA)[2] > 0.5).astype(np.float32) for a, b in ((NEAR, wide), (wide, NEAR)))
    shared = shared_pixels(scene, [rows[1], rows[0]], [(CAMERA, [far, near])] * 2)
    assert shared.shape == (3, 3) and shared.sum() == 2 * 40 * 40
    assert shared[1].tolist() == [0, 0, 2 * far.sum()] and shared[2].tolist() == [0, 2 * near.sum(), 0]
    assert ious_of(shared).tolist() == [[0, 1], [1, 0]]
    assert shared_pixels(scene, [], [(CAMERA, [far])]).tolist() == [[1600 - far.sum()], [far.sum()]]
    # The first has 90 of its 100 pixels, the second none; the second that was found lies on nothing.
    assert ious_of(np.array([[500, 0, 20], [10, 90, 0], [40, 0, 0]])) == pytest.approx(np.array([[0.9, 0], [0, 0]]))
