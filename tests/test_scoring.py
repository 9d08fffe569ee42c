"""Objects that trims and other tools left, as scenes cut in two, and the rules by which these are compared."""

import numpy as np
import pytest
import toy
from scenes import gaussian

from gaussian_trimmer import formats
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.ground_truth import TestView
from gaussian_trimmer.evaluation.metrics import HIGHEST_PSNR, ious_of, shared_pixels
from gaussian_trimmer.evaluation.scoring import Cut, Judge, draw, read_result
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.output.saving import save
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.trimming.trim import trim, trim_objects

CAMERA = Camera(np.eye(4), np.array([[40.0, 0, 20], [0, 40, 20], [0, 0, 1]]), 40, 40, "a.png")
NEAR = gaussian((0, 0, 1), 0.15, opacity=0.98, colour=(0, 0, 1))
FAR = gaussian((0, 0, 3), 0.9, opacity=0.8, colour=(1, 0, 0))


def view(coverage, image=None, visible=None):
    return TestView(CAMERA, image, coverage, np.ones(coverage.shape, np.bool_), visible)


def score(cut, view, scene=None, **rules):
    return Judge(**rules).score_views(cut, [view], scene)[0]


def test_what_stands_before_an_object_hides_it_in_its_scene_only():
    cut = Cut(FAR, gaussian((0, 0, 1), 0.07, opacity=0.98))
    _, alpha, share = draw(cut, CAMERA)
    assert alpha[20, 20] > 0.7 and share[20, 20] < 0.1
    whole, visible = ((part > 0.5).astype(np.float32) for part in (alpha, share))
    scores = score(cut, view(whole))
    assert scores["iou"] == 100 and scores["iou_in_scene"] < 90 and scores["accuracy_in_scene"] < 100
    assert score(cut, view(whole, visible=visible))["iou_in_scene"] == 100
    unknown = score(Cut(FAR, None), view(whole))
    assert unknown == {name: value for name, value in scores.items() if not name.endswith("in_scene")}


def test_the_threshold_is_that_of_the_rendering_only():
    alpha = draw(Cut(FAR, None), CAMERA)[1]
    truth = view((alpha > 0.3).astype(np.float32))
    assert score(Cut(FAR, None), truth, threshold=0.3)["iou"] == 100
    assert score(Cut(FAR, None), truth, threshold=0.6)["iou"] < 80
    coarse = view(np.float32(0.4) * (alpha > 0.3))
    hidden = score(Cut(FAR, None), coarse, threshold=0.3)  # ground truth counts above one half
    assert list(hidden) == ["accuracy"] and hidden["accuracy"] < 100


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


@pytest.fixture(scope="module")
def ball():
    scene, truth = toy.ball_on_floor()
    return scene, truth, toy.dilated(scene, truth)


@pytest.fixture(scope="module")
def trimmed(ball):
    scene, _, rough = ball
    with toy.one_thread():
        return trim(scene, rough, config=toy.small_config())


def rows(gaussians):
    return {tuple(mean) for mean in gaussians.means.tolist()}


def test_a_folder_of_a_trim_holds_what_was_selected_before(ball, trimmed, tmp_path):
    scene, _, rough = ball
    found = read_result(save(trimmed, tmp_path / "t"), scene)
    np.testing.assert_array_equal(found.before, rough)
    np.testing.assert_array_equal(found.selection, trimmed.object_mask)
    assert rows(found.object) == rows(trimmed.object)
    assert rows(found.background) == rows(trimmed.background)
    assert not found.unknown


def test_labels_of_another_scene_are_refused(ball, trimmed, tmp_path):
    scene, _, _ = ball
    folder = save(trimmed, tmp_path / "t")
    with pytest.raises(InputError, match="made for another scene"):
        read_result(folder, scene.select(slice(0, 100)))
    np.savez(folder / "labels.npz", label=np.zeros(3))
    with pytest.raises(InputError, match="lacks some of its arrays"):
        read_result(folder, scene)
    (folder / "labels.npz").unlink()
    with pytest.raises(InputError, match="did not write the folder"):
        read_result(folder, scene)


def test_an_object_of_another_tool_is_found_in_the_scene(ball, tmp_path):
    scene, truth, _ = ball
    formats.write(scene.select(truth), tmp_path / "object.ply")
    found = read_result(tmp_path / "object.ply", scene)
    np.testing.assert_array_equal(found.selection, truth)
    assert rows(found.background) == rows(scene.select(~truth)) and found.before is None


def test_an_object_that_is_not_in_the_scene_has_no_background(ball, tmp_path):
    scene, truth, _ = ball
    other = scene.select(truth).replace(means=scene.means[::-1][truth] * 3, sh_dc=scene.sh_dc[truth] + 5)
    formats.write(other, tmp_path / "object.ply")
    found = read_result(tmp_path / "object.ply", scene)
    assert found.background is None and found.selection is None
    assert "match no row" in found.unknown
    assert len(found.object) == truth.sum()


def test_one_of_several_objects_is_read_from_their_folder(tmp_path):
    scene, truth = toy.ball_on_floor()
    left = truth & (scene.means[:, 0] < 0)
    result = trim_objects(scene, {3: left, 7: truth & ~left}, up=toy.UP, config=toy.small_config())
    save(result, tmp_path / "out")
    stored = read_result(tmp_path / "out", scene, SelectionOptions(object_id=(7,)))
    own = next(part for part in result.objects if part.id == 7)
    assert len(stored.object) == len(own.gaussians)
    assert len(stored.background) == len(formats.read(tmp_path / "out" / "background.ply")) + sum(
        len(part.gaussians) for part in result.objects if part.id != 7
    )
    with pytest.raises(InputError, match=r"3 \(.*7 \("):
        read_result(tmp_path / "out", scene)
