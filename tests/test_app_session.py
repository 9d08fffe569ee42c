"""Tests of the app's state, without a browser: what is opened, marked, undone, trimmed and saved."""

import itertools
import json
import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import toy
from app_session import BALL, FLOOR, TOP, click_on_ball
from command_line import run

from gaussian_trimmer import formats
from gaussian_trimmer.app.documents import TrimChoices, normal_of
from gaussian_trimmer.app.saving import Target, command_for
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.app.worker import Cancelled
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.selecting.marks import Box3D, Sphere
from gaussian_trimmer.selecting.marks_file import read_marks, write_marks


def state(session):
    now = session.now
    return [(part.name, part.colour, part.marks, part.n_selected, part.result) for part in now.objects], now.active


def test_nothing_can_be_done_before_a_scene_is_open():
    empty = Session()
    assert empty.glance() is None
    for act in (empty.undo, empty.redo, empty.clear, empty.trim, lambda: empty.mark(BALL), lambda: empty.now):
        with pytest.raises(InputError, match="Open a scene first"):
            act()


def test_opening_tells_its_stages_and_keeps_the_scene_where_a_file_is_bad(session, tmp_path):
    stages = []
    session.open(session.document.path, None, stages.append)
    assert len(stages) == len(set(stages)) >= 3
    session.mark(BALL)
    before = state(session)
    (tmp_path / "broken.ply").write_bytes(b"ply\nformat nonsense")
    for path, message in ((tmp_path / "broken.ply", "broken.ply"), (tmp_path / "none.ply", "no file")):
        with pytest.raises(InputError, match=message):
            session.open(path)
    assert state(session) == before


def test_cameras_are_added_to_the_open_scene_and_marks_are_kept(session, ball):
    session.open(session.document.path)
    session.mark(BALL)
    before = state(session)
    session.use_cameras(ball[0] / "cameras.json")
    assert session.document.cameras is not None
    assert session.now.up.source == "camera file"
    assert state(session) == before
    assert session.undo() == "cameras"
    assert session.document.cameras is None


def test_cameras_of_another_scene_are_refused(session, ball, tmp_path):
    session.mark(BALL)
    before = state(session)
    document = json.loads((ball[0] / "cameras.json").read_text())
    for frame in document["frames"]:
        pose = np.array(frame["world_to_camera"])
        pose[:3, :3] = np.diag([-1, 1, -1]) @ pose[:3, :3]  # they look away from the scene
        pose[:3, 3] = np.diag([-1, 1, -1]) @ pose[:3, 3]
        frame["world_to_camera"] = pose.tolist()
    (tmp_path / "away.json").write_text(json.dumps(document))
    for act in (session.use_cameras, lambda path: session.open(ball[0] / "scene.ply", path)):
        with pytest.raises(InputError, match="0 % of this scene"):
            act(tmp_path / "away.json")
        assert state(session) == before


def test_cameras_of_a_nerfstudio_training_are_brought_to_its_coordinates(ball, tmp_path):
    for name in ("scene.ply", "cameras.json"):
        shutil.copy(ball[0] / name, tmp_path)
    transform = np.eye(4)[:3]
    transform[:, 3] = 0.1, 0.0, 0.0
    (tmp_path / "dataparser_transforms.json").write_text(json.dumps({"transform": transform.tolist(), "scale": 1.0}))
    plain, moved = Session(), Session()
    plain.open(ball[0] / "scene.ply", ball[0] / "cameras.json")
    moved.open(tmp_path / "scene.ply", tmp_path / "cameras.json")
    for one, other in zip(plain.document.cameras.cameras, moved.document.cameras.cameras, strict=True):
        np.testing.assert_allclose(other.centre, one.centre + np.array([0.1, 0, 0]), atol=1e-9)


def test_marks_add_up_as_select_has_them(session, ball):
    from gaussian_trimmer.selecting.select import select
    from gaussian_trimmer.selecting.view_lookup import resolve_views

    marks = [click_on_ball(session), TOP, Box3D((-3, -3, 0.3), (3, 3, 3), "up", "intersect")]
    for mark in marks:
        session.mark(mark)
    scene, cameras = session.document.scene, session.document.cameras
    expected = select(scene, resolve_views(scene, marks, cameras=cameras), cameras=cameras).mask
    assert np.array_equal(session.now.object.selected.mask, expected)
    assert 0 < expected.sum() < ball[2].sum()


def test_a_mark_after_which_nothing_is_selected_is_refused(session):
    with pytest.raises(InputError, match="nothing is selected before"):
        session.mark(TOP)
    session.mark(BALL)
    before = state(session)
    with pytest.raises(InputError, match="nothing would be selected"):
        session.mark(Sphere((0.0, 0.0, 1.0), 9.0, effect="remove"))
    assert state(session) == before


def test_a_mark_that_changes_nothing_is_not_made(session):
    assert re.match(r"Added (\d+): a sphere. \1 Gaussians selected", session.mark(BALL))
    session.trim()
    before = state(session)
    with pytest.raises(InputError, match="changes nothing"):
        session.mark(Sphere((0.0, 0.0, 1.0), 0.5))
    assert state(session) == before  # with the trim
    outside = Sphere((2.0, 2.0, 0.0), 0.5, effect="remove")
    assert "the trim will leave out" in session.mark(outside)
    with pytest.raises(InputError, match="changes nothing"):
        session.mark(outside)


def test_undo_and_redo_go_through_everything(session):
    states = [state(session)]
    for act in (
        lambda: session.mark(BALL),
        lambda: session.mark(TOP, FLOOR),
        session.trim,
        session.add_object,
        lambda: session.mark(BALL),
        lambda: session.describe_object("ball", (1, 2, 3)),
        session.remove_object,
        session.clear,
    ):
        act()
        states.append(state(session))
    assert all(one != other for one, other in itertools.pairwise(states))
    for expected in states[-2::-1]:
        session.undo()
        assert state(session) == expected
    with pytest.raises(InputError, match="nothing to undo"):
        session.undo()
    for expected in states[1:]:
        session.redo()
        assert state(session) == expected
    with pytest.raises(InputError, match="nothing to redo"):
        session.redo()


def test_a_trim_is_that_of_the_library_and_a_mark_makes_it_out_of_date(session, ball):
    import gaussian_trimmer as gt

    session.mark(click_on_ball(session))
    stages = []
    said = session.trim(progress=stages.append)
    result = session.now.object.result
    alone = gt.trim(session.document.scene, session.now.object.selected.mask, cameras=session.document.cameras)
    assert np.array_equal(result.only.source_index, alone.only.source_index)
    assert toy.jaccard(result.object_mask, ball[2]) > 0.9
    assert "views accepted" in said
    assert stages[0] == "plan"
    session.mark(TOP)
    assert session.now.object.result is None
    session.undo()
    assert session.now.object.result is result


def test_a_cancelled_trim_changes_nothing(session):
    session.mark(BALL)
    before, stages = state(session), []
    with pytest.raises(Cancelled):
        session.trim(progress=stages.append, cancelled=lambda: len(stages) == 3)
    assert len(stages) == 3
    assert state(session) == before


def test_up_by_axis_by_points_and_found(session):
    assert session.now.up.source == "camera file"
    session.mark(Box3D((-1.2, -1.2, 0.1), (1.2, 1.2, 2.2), "up"))
    selected = session.now.object.n_selected
    up = session.set_up(normal_of([(0, 0, 0), (1, 0, 0.5), (0, 1, 0)], (0, 0, -5)))
    assert up.direction @ np.array([0.5, 0, -1]) / np.hypot(1, 0.5) == pytest.approx(1)
    assert session.now.object.n_selected != selected  # a box that stands upright has turned
    assert session.set_up(None).source == "camera file"
    assert session.now.object.n_selected == selected
    with pytest.raises(InputError, match="in a line"):
        normal_of([(0, 0, 0), (1, 1, 1), (2, 2, 2)], (0, 0, 5))
    with pytest.raises(InputError, match="up vector"):
        session.set_up((0, 0, 0))


def test_objects_have_names_and_colours_of_their_own(session):
    session.mark(BALL)
    added = session.add_object()
    assert added.colour != session.now.objects[0].colour
    assert session.now.object.n_selected == 0
    with pytest.raises(InputError, match="Another object"):
        session.describe_object("object 1", (1, 2, 3))
    for name in ("", "x" * 61, "a\x1b[31m"):
        with pytest.raises(InputError, match="cannot be a name"):
            session.describe_object(name, (1, 2, 3))
    session.activate(1)
    assert session.now.object.n_selected > 0
    with pytest.raises(InputError, match="no object 7"):
        session.activate(7)
    session.activate(2)
    session.remove_object()
    with pytest.raises(InputError, match="only object"):
        session.remove_object()
    assert session.add_object().id == 3  # a number never means two objects


def test_selection_files_and_marks_files_are_loaded(session, ball, tmp_path):
    np.save(tmp_path / "ball.npy", ball[2])
    session.mark(TOP.__class__((0.0, 0.0, 0.0), 1.0))
    session.load(tmp_path / "ball.npy")
    assert np.array_equal(session.now.object.selected.mask, ball[2])
    session.mark(TOP)
    write_marks(session.now.basis.__class__(session.now.object.marks, (0.0, 0.0, 1.0)), tmp_path / "marks.json")
    expected = session.now.object.selected.mask
    session.clear()
    session.load(tmp_path / "marks.json")
    assert np.array_equal(session.now.object.selected.mask, expected)


def test_files_that_do_not_fit_change_nothing(session, tmp_path):
    session.mark(BALL)
    before = state(session)
    n = len(session.document.scene)
    np.save(tmp_path / "long.npy", np.ones(n + 1, bool))
    np.save(tmp_path / "empty.npy", np.zeros(n, bool))
    (tmp_path / "text.npy").write_text("no array")
    basis = session.now.basis
    write_marks(basis.__class__((BALL,), basis.up, scene_size=n + 1), tmp_path / "other.json")
    for name in ("long.npy", "empty.npy", "text.npy", "other.json", "none.npy"):
        with pytest.raises(InputError):
            session.load(tmp_path / name)
        assert state(session) == before


@pytest.mark.parametrize(
    ("choices", "up", "format"),
    [(TrimChoices(), None, None), (TrimChoices(False, False, True, False), (0.0, 0.1, 1.0), "splat")],
)
def test_what_is_saved_is_what_the_command_makes(session, tmp_path, monkeypatch, choices, up, format):
    if up:
        session.set_up(up)
    session.mark(BALL if up else click_on_ball(session))
    session.mark(TOP)
    session.trim(choices)
    command = session.save(Target(tmp_path / "by app", format))
    monkeypatch.chdir(tmp_path)
    assert run(*shlex.split(command)[1:], "--quiet") == 0
    for file in (tmp_path / "by app").rglob("*"):
        if file.is_file() and file.name not in ("report.json", "manifest.json"):
            assert file.read_bytes() == (tmp_path / "again" / file.relative_to(tmp_path / "by app")).read_bytes(), file
    suffix = format or "ply"
    assert {f"object.{suffix}", f"background.{suffix}", "selection.json", "labels.npz"} <= {
        path.name for path in (tmp_path / "again").iterdir()
    }


def test_saving_asks_for_a_trim_and_never_replaces_unasked(session, tmp_path):
    session.mark(BALL)
    with pytest.raises(InputError, match="trim it first"):
        session.save(Target(tmp_path / "out"))
    session.trim()
    session.save(Target(tmp_path / "out"))
    with pytest.raises(InputError):
        session.save(Target(tmp_path / "out"))
    with pytest.raises(InputError, match="Unknown format"):
        session.save(Target(tmp_path / "other", "obj"))
    assert not (tmp_path / "other").exists()


def test_a_scene_of_a_format_that_is_only_read_is_saved_in_the_nearest(ball, tmp_path):
    formats.write(formats.read(ball[0] / "scene.ply"), tmp_path / "scene.sog")
    shutil.unpack_archive(tmp_path / "scene.sog", tmp_path / "unpacked", "zip")
    opened = Session()
    opened.open(tmp_path / "unpacked" / "meta.json")
    opened.mark(BALL)
    opened.trim()
    opened.save(Target(tmp_path / "out"))
    assert (tmp_path / "out" / "object.sog").is_file()


def test_the_command_holds_wherever_it_is_run_and_whatever_files_are_called(session, monkeypatch):
    monkeypatch.chdir(session.document.path.parent)
    name = Path("a\n```b'.ply")
    now = replace(session.now, document=replace(session.document, path=name))
    parts = shlex.split(command_for(now, Target(Path("out"), "ply")))
    assert parts[2] == str(name.absolute())
    assert parts[parts.index("--marks") + 1] == str(Path("out", "selection.json").absolute())


def test_several_objects_share_nothing(session, tmp_path):
    session.mark(BALL, Box3D((-9, -9, 1.0), (9, 9, 9), effect="intersect"))
    session.add_object()
    session.mark(BALL, Box3D((-9, -9, -9), (9, 9, 1.2), effect="intersect"))
    session.describe_object("the floor's", (1, 2, 3))
    session.save_objects(Target(tmp_path / "out", "ply"))
    labels = np.load(tmp_path / "out" / "labels.npz")
    ends = np.cumsum([*labels["object_rows"], len(labels["source_index"])])
    first, second = (labels["source_index"][start:end] for start, end in zip((0, *ends), ends[:2], strict=False))
    assert len(first) and len(second) and not np.intersect1d(first, second).size
    names = "object_1", "object_the_floor_s", "background"
    assert sum(len(formats.read(tmp_path / "out" / f"{name}.ply")) for name in names) == len(labels["label"])
    assert read_marks(tmp_path / "out" / "selection_the_floor_s.json").marks == session.now.object.marks
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert [(each["name"], each["file"]) for each in report["objects"]] == [
        ("object 1", "object_1.ply"), ("the floor's", "object_the_floor_s.ply"),
    ]  # fmt: skip
    with pytest.raises(Cancelled):
        session.save_objects(Target(tmp_path / "never"), cancelled=lambda: True)
    assert not (tmp_path / "never").exists()
