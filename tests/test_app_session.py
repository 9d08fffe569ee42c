"""Tests of the app's state, without a browser: what is opened, marked, undone, cut out, kept and saved."""

import itertools
import json
import re
import shlex
import shutil
import stat
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import toy
from command_line import run
from toy import BALL, FLOOR, TOP

import gaussian_trimmer as gt
from gaussian_trimmer import formats
from gaussian_trimmer.app import edits
from gaussian_trimmer.app.files import save
from gaussian_trimmer.app.session import Cancelled, Session, project_as_json, read_project, restore
from gaussian_trimmer.app.snapshots import PALETTE, TrimChoices
from gaussian_trimmer.app.words import in_app
from gaussian_trimmer.cameras import Viewpoint
from gaussian_trimmer.errors import InputError, OutputExistsError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import SH_C0
from gaussian_trimmer.io.writing import write_private
from gaussian_trimmer.selecting.interpretation import INTERPRETATIONS
from gaussian_trimmer.selecting.marks import Box3D, Click, FromFile, Rows, Sphere, Stroke, read_marks, write_marks
from gaussian_trimmer.selecting.select import select
from gaussian_trimmer.selection_files.selection_file import flag
from gaussian_trimmer.trimming.up_vector import FROM_FORMAT, UpVector

DEFAULT = TrimChoices()


def state(session):
    now = session.now
    parts = [(part.name, part.colour, part.marks, part.n_selected, part.stale, part.fresh) for part in now.objects]
    return parts, now.active


def click_on_ball(session):
    camera = session.document.cameras.cameras[0]
    x, y = camera.project(toy.CENTRE[None])[0][0].astype(int).tolist()
    return Click(x, y, Viewpoint(camera))


def mark(session, *marks, **options):
    return session.do(edits.mark, *marks, **options)


def refused(session, edit, *arguments, match="."):
    """An edit is refused and changes nothing."""
    before = session.now
    with pytest.raises(InputError, match=match):
        session.do(edit, *arguments)
    assert session.now is before


def test_nothing_can_be_done_before_a_scene_is_open():
    empty = Session()
    assert empty.glance() is None
    for act in (empty.undo, empty.redo, lambda: mark(empty, BALL), lambda: empty.now):
        with pytest.raises(InputError, match="Open a scene first"):
            act()


def test_opening_tells_its_stages_and_keeps_the_scene_where_a_file_is_bad(session, tmp_path):
    stages = []
    session.open(session.document.path, None, stages.append)
    assert len(stages) == len(set(stages)) >= 3
    before = session.now
    (tmp_path / "broken.ply").write_bytes(b"ply\nformat nonsense")
    for name in ("broken.ply", "none.ply"):
        with pytest.raises(InputError, match=name):
            session.open(tmp_path / name)
    assert session.now is before


def test_cameras_are_added_and_marks_are_kept_but_not_those_of_another_scene(session, ball, tmp_path):
    session.open(session.document.path)
    mark(session, BALL)
    before = state(session)
    document = json.loads((ball[0] / "cameras.json").read_text())
    for frame in document["frames"]:
        pose = np.array(frame["world_to_camera"])
        frame["world_to_camera"] = (np.diag([-1, 1, -1, 1]) @ pose).tolist()  # they look away from the scene
    (tmp_path / "away.json").write_text(json.dumps(document))
    refused(session, edits.use_cameras, tmp_path / "away.json", match="0 % of this scene")
    session.do(edits.use_cameras, ball[0] / "cameras.json")
    assert session.document.cameras is not None and session.now.up.source == "camera file"
    assert state(session) == before
    session.undo()
    assert session.document.cameras is None


def test_spz_files_are_y_up_unless_something_else_is_known(session, tmp_path):
    formats.write(session.document.scene, tmp_path / "floor.spz")
    lone = session.document.scene.select(np.flatnonzero(np.arange(len(session.document.scene)) < 40))
    formats.write(lone, tmp_path / "lone.spz")  # too few for a ground plane
    opened = Session()
    opened.open(tmp_path / "floor.spz")
    assert opened.now.up.source == "ground plane" and opened.now.given_up is None
    opened.open(tmp_path / "lone.spz")
    assert opened.now.up.source == FROM_FORMAT
    assert opened.now.given_up == (0, 1, 0)  # the trim, and the command that repeats it, are told


def test_a_mark_that_changes_nothing_or_leaves_nothing_is_not_made(session):
    refused(session, edits.mark, TOP, match="Nothing is selected yet")
    refused(session, edits.mark, replace(BALL, effect="intersect"), match="mode")
    assert re.match(r"Added (\d+): a sphere. \1 Gaussians selected", mark(session, BALL))
    session.do(edits.trim_object, DEFAULT)
    refused(session, edits.mark, Sphere((0.0, 0.0, 1.0), 0.5), match="changes nothing")  # the cut-out stays
    refused(session, edits.mark, Sphere((0.0, 0.0, 1.0), 9.0, effect="remove"), match="nothing would be selected")
    outside = Sphere((2.0, 2.0, 0.0), 0.5, effect="remove")
    mark(session, outside)
    assert session.now.object.selected.excluded.any()
    refused(session, edits.mark, outside, match="changes nothing")


def test_marks_among_some_change_no_others(session):
    mark(session, BALL)
    before = session.now.object.selected.mask
    upper = session.document.scene.means[:, 2] > 1
    mark(session, Sphere((0.0, 0.0, 1.0), 1.2, effect="remove"), among=upper)
    after = session.now.object.selected.mask
    assert np.array_equal(after[~upper], before[~upper])
    assert after[upper].sum() < before[upper].sum()
    with pytest.raises(InputError, match="changes nothing that is shown"):
        mark(session, BALL, among=np.zeros(len(before), np.bool_))


def test_what_others_hide_or_lock_is_left_alone_and_the_marks_say_so(session):
    for kept in ("hidden", "locked"):
        session.open(session.document.path)
        mark(session, BALL)
        ours = session.now.object.selected.mask
        session.do(edits.describe, 1, kept, True)
        session.do(edits.add_object)
        mark(session, Sphere((0.0, 0.0, 0.0), 3.0))
        now = session.now
        assert now.object.n_selected and not (now.object.selected.mask & ours).any()
        again = select(session.document.scene, replace(now.basis, marks=now.object.marks))
        assert np.array_equal(again.mask, now.object.selected.mask)
    session.do(edits.show_all)
    assert not any(part.hidden for part in session.now.objects)


def test_undo_and_redo_go_through_everything(session):
    states = [state(session)]
    for edit, *arguments in (
        (edits.mark, BALL),
        (edits.mark, TOP, FLOOR),
        (edits.trim_object, DEFAULT),
        (edits.add_object,),
        (edits.mark, BALL),
        (edits.describe, 2, "name", "ball"),
        (edits.remove_object, 2),
        (edits.invert,),
        (edits.clear,),
    ):
        before = session.now.object.selected.mask
        session.do(edit, *arguments)
        states.append(state(session))
        assert edit is not edits.invert or np.array_equal(session.now.object.selected.mask, ~before)
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


@pytest.mark.parametrize("corrected", [False, True])
def test_cut_out_is_the_library_bit_by_bit_with_what_marks_removed_and_cut(session, corrected):
    mark(session, click_on_ball(session))
    if corrected:
        mark(session, TOP, Sphere((2.0, 2.0, 0.0), 0.5, effect="remove"))
        stroke = Stroke(Viewpoint(toy.camera_at((0, -8, 1))), ((0.1, 0.4), (0.9, 0.4)), 4.0)
        nothing = np.zeros(len(session.document.scene), np.bool_)
        assert mark(session, Rows.of(nothing, "brush", "remove", stroke)).startswith("Cut: brush")
    now, stages = session.now, []
    session.do(edits.trim_object, DEFAULT, stages.append)
    ours, selected = session.now.object.fresh, now.object.selected
    given = select(now.document.scene, replace(now.basis, marks=now.object.marks), cameras=now.document.cameras)
    theirs = gt.trim_objects(now.document.scene, {1: given}, cameras=now.document.cameras)
    for one, other in ((ours.object, theirs.object), (ours.background, theirs.background)):
        for name, values in one.to_arrays().items():
            assert values.tobytes() == other.to_arrays()[name].tobytes(), name
    assert corrected == selected.excluded.any() == bool(selected.cuts)
    assert stages[0] == "plan"


@pytest.mark.parametrize("effect", ["remove", "add", "intersect"])
def test_a_stroke_on_a_cut_out_changes_only_what_it_touches(session, effect):
    mark(session, BALL)
    session.do(edits.trim_object, DEFAULT)
    session.do(edits.add_object)
    mark(session, Sphere((2.5, 2.5, 0.0), 0.3))
    session.do(edits.trim_object, DEFAULT)
    session.do(edits.activate, 1)
    scene, first = session.document.scene, session.now.objects[0].fresh
    had, dropped = first.object_mask, first.selection & ~first.object_mask
    assert dropped.sum() > 5
    touched = {
        "remove": scene.means[:, 0] > 0.8,
        "add": dropped | (scene.means[:, 0] < -2.8),  # what the trim has cut off, and what it never looked at
        "intersect": np.abs(scene.means[:, 0]) < 0.7,
    }[effect]
    expected = {"remove": had & ~touched, "add": had | touched, "intersect": had & touched}[effect]
    mark(session, Rows.of(touched, "brush", effect, settled=True))
    assert np.array_equal(session.now.object.mask, expected)  # as it is shown until it is cut out again
    session.do(edits.trim_object, DEFAULT, joined=True, again=True)
    ours, other = (part.fresh for part in session.now.objects)
    assert np.array_equal(ours.object_mask, expected)
    for name, values in first.object.select(~touched[first.objects[0].source_index]).to_arrays().items():
        if effect == "remove":  # the others are as they were fitted before
            assert np.array_equal(values, ours.object.to_arrays()[name]), name
    given = select(scene, replace(session.now.basis, marks=session.now.object.marks))
    theirs = gt.trim_objects(scene, {1: given}, cameras=session.document.cameras)
    assert ours.object.means.tobytes() == theirs.object.means.tobytes()
    assert other is not None and other is not ours  # its own cut stays
    mark(session, TOP)
    assert session.now.object.selected.settled is None  # the trim decides about all again


def test_a_stroke_on_a_thing_without_surroundings_leaves_the_rest_as_it_is(tmp_path):
    scene, ball = toy.ball_on_floor(n_floaters=0)
    formats.write(scene.select(ball), tmp_path / "ball.ply")
    session = Session()
    session.open(tmp_path / "ball.ply")
    scene = session.document.scene
    mark(session, Rows.of(np.ones(len(scene), np.bool_), "all"))
    session.do(edits.trim_object, DEFAULT)
    whole, side = session.now.object.fresh.object, scene.means[:, 0] > 0.8
    mark(session, Rows.of(side, "brush", "remove", settled=True))
    session.do(edits.trim_object, DEFAULT, again=True)
    left, rest = session.now.object.fresh.object.to_arrays(), whole.select(~side).to_arrays()
    assert all(np.array_equal(left[name], values) for name, values in rest.items())


def test_a_cut_out_is_none_fresh_or_stale(session):
    def cut_out():
        return session.now.object.result, session.now.object.stale

    assert cut_out() == (None, False)
    mark(session, BALL)
    session.do(edits.trim_object, TrimChoices(fit=False))
    first, after = session.now.object.fresh, session.now
    assert cut_out() == (first, False) and session.now.object.before is None
    mark(session, TOP)
    assert cut_out() == (first, True)
    assert session.now.object.fresh is None
    had = session.now.object.before
    mark(session, FLOOR)
    assert session.now.object.before is had  # since the cut-out
    session.do(edits.trim_object, DEFAULT, joined=True, again=True)  # belongs to the step before
    assert session.now.object.fresh not in (None, first)
    session.undo()
    assert cut_out() == (first, True)
    session.undo()
    assert session.now is after
    session.do(edits.clear)
    assert cut_out() == (None, False)
    refused(session, edits.trim_object, DEFAULT, match="Nothing is selected")


def test_a_cancelled_edit_changes_nothing(ball):
    asked = []
    session = Session(lambda: bool(asked))
    session.open(ball[0] / "scene.ply")
    mark(session, BALL)
    before = session.now
    asked.append(True)
    with pytest.raises(Cancelled):
        session.do(edits.clear)
    assert session.now is before


def test_up_by_axis_by_points_and_found(session):
    assert session.now.up.source == "camera file"
    mark(session, Box3D((-1.2, -1.2, 0.1), (1.2, 1.2, 2.2), "up"))
    selected = session.now.object.n_selected
    session.do(edits.set_up, edits.normal_of([(0, 0, 0), (1, 0, 0.5), (0, 1, 0)], (0, 0, -5)))
    assert session.now.up.direction @ np.array([0.5, 0, -1]) / np.hypot(1, 0.5) == pytest.approx(1)
    assert session.now.object.n_selected != selected  # a box that stands upright has turned
    session.do(edits.set_up, None)
    assert session.now.up.source == "camera file" and session.now.object.n_selected == selected
    with pytest.raises(InputError, match="in a line"):
        edits.normal_of([(0, 0, 0), (1, 1, 1), (2, 2, 2)], (0, 0, 5))
    refused(session, edits.set_up, (0, 0, 0), match="up vector")


def test_objects_have_names_and_colours_of_their_own(session):
    mark(session, BALL)
    own = np.clip(0.5 + SH_C0 * session.document.scene.sh_dc[session.now.object.selected.mask], 0, 1).mean(axis=0) * 255
    distances = [np.linalg.norm(own - colour) for colour in PALETTE]
    assert session.now.object.colour == PALETTE[int(np.argmax(distances))]  # it stands out
    session.do(edits.add_object)
    assert session.now.objects[1].colour != session.now.objects[0].colour
    assert session.now.object.n_selected == 0
    refused(session, edits.describe, 2, "name", "object 1", match="object 1")
    for name in ("", "x" * 61, "a\x1b[31m"):
        refused(session, edits.describe, 2, "name", name, match="cannot be a name")
    session.do(edits.activate, 1, joined=True)
    assert session.now.object.n_selected > 0
    refused(session, edits.activate, 7, match="7")
    session.do(edits.activate, 2, joined=True)
    session.do(edits.remove_object, 2)
    refused(session, edits.remove_object, 1, match="only object")
    session.do(edits.add_object)
    assert session.now.object.id == 3  # a number never means two objects


def test_what_another_object_has_stays_there_unless_it_is_clicked_on_for_a_new_one(session):
    top = replace(TOP, effect="add", radius=1.2)  # with the middle of the ball
    mark(session, top)
    first = session.now.object.selected.mask
    session.do(edits.add_object)
    said = mark(session, BALL)
    masks = [part.selected.mask for part in session.now.objects]
    assert np.array_equal(masks[0], first) and masks[1].any() and not (masks[0] & masks[1]).any()
    assert re.search(r"\D(\d+) stay with object 1\.", said)
    assert not session.now.object.selected.excluded_mask[~first].any()
    refused(session, edits.mark, top, match="stay with object 1")
    session.do(edits.clear)
    assert "taken from object 1" in mark(session, click_on_ball(session))
    after = [part.selected.mask for part in session.now.objects]
    assert after[1].any() and not (after[0] & after[1]).any()
    assert np.array_equal(after[0] | after[1], first)  # the click means what the other object has of it
    session.do(edits.describe, 1, "locked", True)
    session.undo()
    session.undo()
    assert np.array_equal(session.now.objects[0].selected.mask, first)


def test_files_that_do_not_fit_change_nothing(session, tmp_path):
    mark(session, BALL)
    n, basis = len(session.document.scene), session.now.basis
    np.save(tmp_path / "long.npy", np.ones(n + 1, bool))
    np.save(tmp_path / "empty.npy", np.zeros(n, bool))
    (tmp_path / "text.npy").write_text("no array")
    write_marks(basis.__class__((BALL,), basis.up, scene_size=n + 1), tmp_path / "other.json")
    for name in ("long.npy", "empty.npy", "text.npy", "other.json", "none.npy"):
        refused(session, edits.load, tmp_path / name)


def test_a_project_brings_objects_and_marks_back(session, tmp_path):
    session.do(edits.set_up, (0.0, 0.0, 2.0))
    mark(session, click_on_ball(session), TOP)
    session.do(edits.describe, 1, "name", "ball")
    session.do(edits.add_object)
    mark(session, FLOOR)
    path = tmp_path / "new" / "a.json"
    write_private(path, project_as_json(session.now, path.parent))
    assert identify(path).kind == "project"
    assert [stat.S_IMODE(each.stat().st_mode) for each in (path.parent, path)] == [0o700, 0o600]
    project = read_project(path)
    assert project.scene == session.document.path and project.cameras == session.document.camera_path
    other = Session()
    other.open(project.scene, project.cameras)
    other.do(restore, project)
    for one, back in zip(session.now.objects, other.now.objects, strict=True):
        assert np.array_equal(one.selected.mask, back.selected.mask)
        assert np.array_equal(one.selected.excluded, back.selected.excluded)
        assert (one.name, len(one.marks)) == (back.name, len(back.marks))
    assert other.now.active == 1 and np.array_equal(other.now.up.direction, session.now.up.direction)
    other.undo()
    assert not other.now.has_work


def test_projects_of_other_scenes_and_damaged_ones_are_refused(session, tmp_path):
    mark(session, BALL)
    document = json.loads(project_as_json(session.now, tmp_path))
    (marks,) = document["objects"].values()
    for change in (
        {"scene": 5}, {"objects": []}, {"objects": {}}, {"content": "else"}, {"objects": {"a": {}}},
        {"objects": {"": marks}}, {"objects": {"a": marks, "b": marks | {"scene_size": 5}}},
        {"objects": {"a": marks | {"scene_size": 5}}}, {"objects": {"a": {**marks, "scene_size": None}}},
    ):  # fmt: skip
        (tmp_path / "b.json").write_text(json.dumps(document | change))
        with pytest.raises(InputError):
            restore(session.now, read_project(tmp_path / "b.json"))


@pytest.mark.parametrize(
    ("choices", "up", "format", "engine"),
    [(DEFAULT, None, None, None), (TrimChoices(False, False, True, False), (0.0, 0.1, 1.0), "splat", "unreal")],
)
def test_what_is_saved_is_what_the_command_makes(session, tmp_path, monkeypatch, choices, up, format, engine):
    if up:
        session.do(edits.set_up, up)
    mark(session, BALL if up else click_on_ball(session))
    mark(session, TOP)
    session.do(edits.trim_object, choices)
    _, command = save(session.now, tmp_path / "by app", format, engine=engine)
    monkeypatch.chdir(tmp_path)
    assert run(*shlex.split(command)[1:], "--quiet") == 0
    for file in (tmp_path / "by app").rglob("*"):
        if file.is_file() and file.name not in ("report.json", "manifest.json", "summary.csv"):
            assert file.read_bytes() == (tmp_path / "again" / file.relative_to(tmp_path / "by app")).read_bytes(), file
    suffix = format or "ply"
    placed = {f"object_for_{engine}.ply", f"background_for_{engine}.ply", "poses.json"} if engine else set()
    assert placed | {f"object.{suffix}", f"background.{suffix}", "selection.json", "labels.npz"} <= {
        path.name for path in (tmp_path / "again").iterdir()
    }


def test_saving_asks_for_a_cut_out_and_never_replaces_unasked(session, tmp_path):
    mark(session, BALL)
    with pytest.raises(InputError, match="object 1"):
        save(session.now, tmp_path / "out")
    session.do(edits.trim_object, DEFAULT)
    save(session.now, tmp_path / "out")
    with pytest.raises(OutputExistsError):
        save(session.now, tmp_path / "out")
    save(session.now, tmp_path / "out", overwrite=True)
    with pytest.raises(InputError, match="obj"):
        save(session.now, tmp_path / "other", "obj")
    assert not (tmp_path / "other").exists()


def test_a_scene_of_a_format_that_is_only_read_is_saved_in_the_nearest(ball, tmp_path):
    formats.write(formats.read(ball[0] / "scene.ply"), tmp_path / "scene.sog")
    shutil.unpack_archive(tmp_path / "scene.sog", tmp_path / "unpacked", "zip")
    opened = Session()
    opened.open(tmp_path / "unpacked" / "meta.json")
    mark(opened, BALL)
    opened.do(edits.trim_object, TrimChoices(fit=False))
    save(opened.now, tmp_path / "out")
    assert (tmp_path / "out" / "object.sog").is_file()


def test_the_command_holds_wherever_it_is_run_and_whatever_files_are_called(ball, tmp_path, monkeypatch):
    name = "a\n```b'.ply"
    shutil.copy(ball[0] / "scene.ply", tmp_path / name)
    monkeypatch.chdir(tmp_path)
    opened = Session()
    opened.open(Path(name))
    mark(opened, BALL)
    opened.do(edits.trim_object, TrimChoices(fit=False))
    _, command = save(opened.now, Path("out; x"))
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert run(*shlex.split(command)[1:], "--quiet") == 0
    made, again = tmp_path / "out; x" / "object.ply", tmp_path / "elsewhere" / "again" / "object.ply"
    assert made.read_bytes() == again.read_bytes()


def test_several_objects_share_nothing(session, ball, tmp_path):
    mark(session, BALL, Box3D((-9, -9, 1.0), (9, 9, 9), effect="intersect"))
    session.do(edits.add_object)
    mark(session, FromFile(ball[0] / "rough.npy"), Box3D((-9, -9, -9), (9, 9, 1.2), effect="intersect"))
    session.do(edits.describe, 2, "name", "the floor's")
    save(session.now, tmp_path / "out", "ply", together=True)
    labels = np.load(tmp_path / "out" / "labels.npz")
    ends = np.cumsum([*labels["object_rows"], len(labels["source_index"])])
    first, second = (labels["source_index"][start:end] for start, end in zip((0, *ends), ends[:2], strict=False))
    assert len(first) and len(second) and not np.intersect1d(first, second).size
    names = "object_1", "object_the_floor_s", "background"
    assert sum(len(formats.read(tmp_path / "out" / f"{name}.ply")) for name in names) == len(labels["label"])
    assert read_marks(tmp_path / "out" / "selection_the_floor_s.json").marks == session.now.object.marks
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert [each["name"] for each in report["objects"]] == ["object 1", "the floor's"]
    with pytest.raises(ZeroDivisionError):
        save(session.now, tmp_path / "never", None, lambda stage: 1 / 0, together=True)
    assert not (tmp_path / "never").exists()


@pytest.mark.parametrize(
    ("said", "cure"),
    [
        (UpVector(np.array([0.0, -1, 0]), "default", 0.0).doubt(), "choose +Y at 'Up is'"),
        (str(OutputExistsError("out")), "'Replace' beside 'Earlier results'"),
        (INTERPRETATIONS["around"], "drag 'Tolerance'"),
        (f"'a.npy' holds scores; choose with {flag('threshold')}, or not. Then go on.", "load it here. Then go on."),
    ],
)
def test_messages_have_the_apps_words_and_no_option(said, cure):
    assert "--" in said and "--" not in in_app(said) and cure in in_app(said)
