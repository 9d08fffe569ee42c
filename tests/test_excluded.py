"""What marks removed stays out of the object, however much it looks like part of it."""

import numpy as np
import pytest
import toy
from command_line import run

import gaussian_trimmer as gt
from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.selecting.marks import FromFile, Sphere
from gaussian_trimmer.selecting.reading import read_selection_result
from gaussian_trimmer.trimming.trim import trim_objects

SCENE, TRUTH = toy.ball_on_floor()
BALL = Sphere((0, 0, 1), 1.1)
PATCH = Sphere((0, -1, 1), 0.6, effect="remove")
IN_PATCH = np.linalg.norm(SCENE.means - (0, -1, 1), axis=1) <= 0.6


pytestmark = pytest.mark.usefixtures("one_thread")


def ball_without_its_patch():
    return gt.select(SCENE, [BALL, PATCH], up=toy.UP)


def trimmed(selection, **options):
    return gt.trim(SCENE, selection, config=toy.small_config(), up=toy.UP, **options).object_mask


def test_the_last_mark_on_a_gaussian_decides():
    again = gt.select(SCENE, [BALL, PATCH, Sphere((0, -1, 1), 0.3)], up=toy.UP)
    assert np.array_equal(ball_without_its_patch().excluded, IN_PATCH)
    assert np.array_equal(again.excluded, IN_PATCH & ~again.mask) and again.excluded.sum() < IN_PATCH.sum()


def test_what_a_mark_removed_is_not_recovered():
    selection = ball_without_its_patch()
    assert trimmed(selection.mask)[IN_PATCH].sum() > 20  # the trimmer sees that the patch belongs to the ball
    assert not trimmed(selection)[IN_PATCH].any()
    assert not trimmed(selection.mask, excluded=IN_PATCH)[IN_PATCH].any()


def test_what_a_mark_removed_stays_out_of_that_one_of_several_objects():
    config, selection = toy.small_config(), ball_without_its_patch()
    kept_out, taken_in = (
        trim_objects(SCENE, {3: one}, config=config).objects[0].source_index for one in (selection, selection.mask)
    )
    assert IN_PATCH[taken_in].sum() > 20
    assert not IN_PATCH[kept_out].any()


def test_what_is_selected_cannot_be_excluded():
    ball = TRUTH & (SCENE.means[:, 2] > 0.1)
    assert np.array_equal(trimmed(ball, excluded=np.ones(len(SCENE), bool)) & ball, trimmed(ball) & ball)


def test_rows_and_marks_are_written_together(tmp_path, monkeypatch):
    ball_without_its_patch().save(tmp_path / "a.npy")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.setattr("gaussian_trimmer.selecting.marks.write_json", lambda *_: fail())
    with pytest.raises(InputError, match="No space"):
        gt.select(SCENE, [BALL], up=toy.UP).save(tmp_path / "a.npy")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_an_array_does_not_say_what_was_removed_and_whoever_gives_one_is_told(tmp_path):
    ball_without_its_patch().save(tmp_path / "a.npy")
    said = []
    assert read_selection_result(tmp_path / "a.npy", SCENE, say=said.append).excluded is None
    assert len(said) == 1 and "a.json" in said[0]
    found = read_selection_result(tmp_path / "a.json", SCENE, say=said.append)
    assert np.array_equal(found.excluded, IN_PATCH) and len(said) == 1


def fail():
    raise OSError(28, "No space left on device")


@pytest.mark.parametrize("how", ["trim", "select"])
def test_every_way_from_marks_to_a_trim_keeps_to_them(tmp_path, monkeypatch, how):
    monkeypatch.chdir(tmp_path)
    formats.write(SCENE, tmp_path / "scene.ply")
    ball_without_its_patch().save(tmp_path / "a.npy")
    common = ["--up", 0, 0, 1, "--set", "plan.size=96", "--output"]
    if how == "select":
        assert run("select", "scene.ply", "--marks", "a.json", *common, "b.npy", "--trim", "out") == 0
    else:
        assert run("trim", "scene.ply", "a.json", *common, "out") == 0
    labels = np.load(tmp_path / "out" / "labels.npz")
    rows = labels["source_index"][: int(labels["n_object"])]
    assert len(rows) > 100 and not IN_PATCH[rows].any()


def test_files_of_marks_hold_no_files_of_marks(tmp_path):
    ball_without_its_patch().save(tmp_path / "a.npy")
    with pytest.raises(InputError, match="holds marks; give"):
        gt.select(SCENE, [FromFile(tmp_path / "a.json")], up=toy.UP)
