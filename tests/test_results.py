"""Objects that trims and other tools left on disk, as scenes cut in two."""

import numpy as np
import pytest
import toy

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.scoring import cut_by, read_result
from gaussian_trimmer.output.saving import save
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.trimming.trim import trim, trim_objects


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


def test_a_selection_file_cuts_the_scene(ball, tmp_path):
    scene, _, rough = ball
    np.save(tmp_path / "rough.npy", rough)
    found = read_result(tmp_path / "rough.npy", scene)
    np.testing.assert_array_equal(found.selection, rough)
    assert rows(found.object) == rows(cut_by(scene, rough).object)


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
