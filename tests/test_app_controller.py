"""Tests of controls, tools and files with a running server, to which no browser is connected."""

import hashlib
import io
import json
import threading
import zipfile
from contextlib import contextmanager
from dataclasses import asdict, replace
from types import SimpleNamespace

import made_room as room
import numpy as np
import pytest
import toy
from toy import BALL, FLOOR

from gaussian_trimmer import formats
from gaussian_trimmer.app import edits
from gaussian_trimmer.app import panels as controls
from gaussian_trimmer.app.display import FILL, REPLACED, shown_rows
from gaussian_trimmer.app.files import ALL_FILES, DOWNLOADS, OBJECT
from gaussian_trimmer.app.page import Gesture
from gaussian_trimmer.app.session import read_project, restore
from gaussian_trimmer.app.snapshots import Similarity
from gaussian_trimmer.app.viewpoints import Event, Showing, View, doubts
from gaussian_trimmer.cameras import point_of
from gaussian_trimmer.selecting.marks import Box3D, Sphere

pytest.importorskip("starlette", reason="needs the app extra")
TINY = Sphere((2.5, 2.5, 0.0), 0.3)
"""Beside the ball."""


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    from gaussian_trimmer.app.serving import serving

    with serving(None, None, port=0, state=tmp_path_factory.mktemp("state")) as app:
        yield app.controller


def finish(app):
    for _ in range(2):  # a job, and what follows it
        app.jobs.worker._thread.submit(lambda: None).result(100)  # without stopping what gives way


def act(function, *arguments, **options):
    """Have the app do one of its actions."""
    function(*arguments, **options)
    finish(function.__self__)


def do(app, name):
    """Have the app do what a button or a key does."""
    app.jobs.page.actions[name].act(tab(app))
    finish(app)


def open_scene(app, path, camera_path=""):
    """Open a scene, without the work on it of an earlier test."""
    app.panels.path.value, app.panels.camera_path.value = str(path), str(camera_path)
    act(app.open)
    if app.session.now.has_work:
        do(app, "Undo")


@pytest.fixture
def app(running, ball):
    open_scene(running, ball[0] / "scene.ply", ball[0] / "cameras.json")
    return running


def mark(app, *marks, event=Event.MARKED):
    app.jobs.do("Marking", lambda: app.session.do(edits.mark, *marks), event)
    finish(app)


def tab(app, eye=(0.0, -8.0, 4.0)):
    """A tab that looks at the ball, and what was sent to it."""
    frame, sent = app.jobs.view.frame, {}
    eye, target = (point_of(frame.to_viewer(np.array(point))) for point in (eye, toy.CENTRE))
    view = View(eye, target, point_of(toy.UP), 0.8, 200, 200)
    return SimpleNamespace(view=view, send=lambda message: None, send_file=sent.__setitem__, sent=sent)


def gesture(app, tool, *places, effect=None, **more):
    app.panels.tool.value = tool
    app.tools.heard(Gesture(tool, places, effect, **more), tab(app))
    finish(app)


@contextmanager
def told(app, act):
    """Have something done with the stages that the app has told so far whenever it tells one."""
    stages, shown = [], app.panels.busy

    def busy(doing, share):
        stages.append(doing)
        act(stages)
        shown(doing, share)

    app.panels.busy = busy
    try:
        yield stages
    finally:
        app.panels.busy = shown


@pytest.fixture
def looked(app, monkeypatch):
    """Where the view was sent to: eyes and targets, in order."""
    looked = []
    monkeypatch.setattr(app.jobs.view, "look", lambda client, eye, target: looked.append((eye, target)))
    return looked


@pytest.fixture
def wall(running, tmp_path):
    """An open scene of a red wall with a green stripe: colours and means of its Gaussians."""
    steps = np.linspace(-2, 2, 81)
    means = toy.CENTRE + np.stack(np.meshgrid(steps, [0.0], steps, indexing="ij"), -1).reshape(-1, 3)
    colours = np.where(np.abs(means[:, :1] - 1.2) < 0.6, (0.1, 0.7, 0.1), toy.RED)
    colours[np.abs(means[:, 0]) > 1.85] = (0.85, 0.1, 0.1)
    formats.write(toy.gaussians(means, (0.05, 0.02, 0.05), colours), tmp_path / "wall.ply")
    open_scene(running, tmp_path / "wall.ply")
    return colours, means


EVERYWHERE = (0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)


def test_a_selection_grows_and_shrinks_by_what_is_seen_whatever_the_density(app, tmp_path):
    scene, ball = toy.ball_on_floor(floor_side=90)
    dense = scene.select(np.repeat(np.arange(len(scene)), np.where(ball, 3, 1)))
    dense = dense.replace(means=dense.means + np.random.default_rng(0).normal(0, 0.003, dense.means.shape).astype("f4"))
    formats.write(dense, tmp_path / "dense.ply")
    open_scene(app, tmp_path / "dense.ply")
    disc = Box3D((-0.8, -0.8, -0.2), (0.8, 0.8, 2.1))
    mark(app, disc)
    before = app.session.now.object.selected.mask
    for way, sign in (("Grow", 1), ("Shrink", -1)):
        app.tools.change_selection(way, tab(app))
        finish(app)
        after = app.session.now.object.selected.mask
        assert sign * (after.sum() - before.sum()) > 0.02 * before.sum()
        before = after
    steps = []
    for eye in ((0.0, -8.0, 4.0), (0.0, -16.0, 8.0)):
        app.tools.change_selection("Grow", tab(app, eye))
        finish(app)
        steps.append(app.session.now.object.marks[-1].spacings)
        do(app, "Undo")
    assert steps[1] == pytest.approx(2 * steps[0], rel=0.15)


def test_names_and_modes_do_not_leak_from_scene_to_scene_and_work_is_kept(app):
    panels = app.panels
    mark(app, BALL)
    panels.showing = Showing("Object", "Cut-out", "Own")
    panels.tool.value, panels.effect.value, panels.reach.value = controls.CLICK, controls.KEEP_ONLY, controls.THROUGH
    panels.existing.value, panels.folder.value = controls.REPLACE, "/somewhere/else"
    panels.command.value = "of an earlier scene"
    blocked = threading.Event()
    app.jobs.worker.submit(lambda: blocked.wait(50))
    app.open()
    app.change_object(1, "name", "meant for the scene before")
    blocked.set()
    finish(app)
    assert panels.showing == Showing() and panels.tool.value == controls.LOOK
    assert (panels.effect.value, panels.reach.value, panels.existing.value) == (
        controls.ADD, controls.SURFACE, controls.KEEP,
    )  # fmt: skip
    assert panels.folder.value == "trimmed/scene" and not panels.command.value
    assert app.session.now.object.name == "object 1"
    assert app.session.now.object.marks == (BALL,)  # the work that was kept
    do(app, "Undo")
    act(app.open)
    assert not app.session.now.has_work


def test_keep_only_falls_back_to_add(app):
    panels = app.panels
    panels.effect.value = controls.KEEP_ONLY
    gesture(app, controls.LASSO, *EVERYWHERE)  # nothing is selected: refused
    assert panels.effect.value == controls.KEEP_ONLY and not app.session.now.has_work
    mark(app, BALL)
    panels.reach.value = controls.THROUGH
    gesture(app, controls.LASSO, (0.0, 0.0), (1.0, 0.0), (1.0, 0.5), (0.0, 0.5))
    assert panels.effect.value == controls.ADD
    selected = app.session.now.object.n_selected
    gesture(app, controls.LASSO, *EVERYWHERE)
    assert app.session.now.object.n_selected > selected


def test_a_correction_is_cut_out_again_as_one_step_and_undoing_it_cuts_nothing_out(app):
    session, panels = app.session, app.panels
    mark(app, BALL)
    act(app.cut_out)
    assert panels.showing == Showing("Object", "Cut-out", "Own")
    before = session.now
    panels.brush.value = 20
    gesture(app, controls.BRUSH, (0.5, 0.45), (0.55, 0.45), effect="remove")
    assert session.now.object.n_selected < before.object.n_selected
    lost = before.object.mask & ~session.now.object.mask
    assert np.array_equal(lost, session.now.object.selected.settled.touched & before.object.mask)
    assert not (session.now.object.mask & ~before.object.mask).any()
    assert not (session.now.object.fresh.object_mask & session.now.object.selected.excluded).any()
    assert session.now.object.marks[-1].cut is not None and session.now.object.selected.cuts
    assert panels.showing == Showing("Object", "Cut-out", "Changes")  # until something else is asked for
    assert panels.status_text.startswith("Removed") and "again" in panels.status_text
    do(app, "Undo")
    assert session.now is before and panels.showing == Showing("Object", "Cut-out", "Changes")
    act(app.show_part, OBJECT)
    assert panels.showing == Showing("Object", "Cut-out", "Own")

    act(app.show_part, "Everything")
    panels.when.value = "Selection"
    mark(app, TINY)
    mark(app, FLOOR)
    marked = session.now.object
    do(app, "Undo")
    assert session.now.object.stale and len(session.now.object.marks) == len(marked.marks) - 1
    assert panels.showing == Showing("Everything", "Selection", "Objects")


def test_marks_made_meanwhile_go_before_the_trim_that_follows(app):
    session = app.session
    mark(app, BALL)
    act(app.cut_out)
    app.panels.tool.value = controls.BRUSH
    blocked = threading.Event()
    app.jobs.worker.submit(lambda: blocked.wait(50))
    for x in (0.42, 0.58):
        app.tools.heard(Gesture(controls.BRUSH, ((x, 0.45),), "remove"), tab(app))
    blocked.set()
    finish(app)
    assert len(session.now.object.marks) == 3 and session.now.object.fresh is not None
    do(app, "Undo")
    assert session.now.object.stale  # of the first stroke, which was not trimmed


def test_a_trim_that_follows_is_given_up_when_the_user_cancels_and_not_when_it_gives_way(app):
    mark(app, BALL)
    act(app.cut_out)
    with told(app, lambda stages: len(stages) > 4 and app.jobs.worker.cancel()):
        gesture(app, controls.BRUSH, (0.5, 0.45), effect="remove")
    assert app.session.now.object.stale and not app.jobs.due


def test_the_box_in_space_is_around_the_selection_and_a_dragged_face_moves_alone(app):
    session, view, up = app.session, app.jobs.view, app.session.now.up.direction

    def chosen():
        app.tools.choose(controls.BOX3D, tab(app))
        finish(app)
        return view.box_mark(up, "intersect")

    mark(app, replace(chosen(), effect="add"))
    assert session.now.object.n_selected  # where nothing is selected, it is around what is looked at
    do(app, "Undo")
    mark(app, BALL)
    selected, before = session.now.object.selected.mask, chosen()
    session.do(edits.mark, before, TINY)
    assert (session.now.object.selected.mask & selected).sum() == selected.sum()  # it cuts nothing off
    step = app.jobs.view.frame.scale * 0.5
    for axis, end in ((0, "low"), (2, "high")):
        sign, drag = 1 if end == "high" else -1, view._box
        place = np.array(getattr(drag, end)) + sign * step * np.eye(3)[axis]
        app.jobs.page.dragged_box(replace(drag, **{end: point_of(place)}))
        after, other = view.box_mark(up, "add"), "low" if end == "high" else "high"
        moved = np.array(getattr(after, end)) - getattr(before, end)
        assert np.allclose(moved, sign * 0.5 * np.eye(3)[axis], atol=1e-5)
        assert np.allclose(getattr(after, other), getattr(before, other), atol=1e-5)
        before = after
    app.jobs.page.dragged_box(replace(view._box, high=view._box.low))  # a face at the other one is no box
    assert view.box_mark(up, "add") == before


def test_up_turns_the_view(app):
    shown = app.jobs.page._shown
    assert np.allclose(shown["upwards"], (0, 0, 1))
    app.panels.up.value = "-Y"
    act(app._set_up, None)
    assert np.allclose(shown["upwards"], (0, -1, 0))
    do(app, "Undo")
    assert np.allclose(shown["upwards"], (0, 0, 1))


def test_home_and_f_without_a_selection_look_as_at_first_and_what_is_cut_out_is_framed(app, looked):
    view = tab(app)
    act(app.focus, view)
    act(app.focus, view, whole=True)
    mark(app, BALL)
    act(app.focus, view)
    act(app.cut_out, view)
    home, also, selected, cut_out = looked
    assert home == also == app.jobs.view.start
    for whole, (eye, target) in ((BALL.radius, selected), (toy.RADIUS, cut_out)):
        lowered = toy.CENTRE - target  # What is looked at stands above the picture's middle: the tools are below.
        assert np.allclose(lowered[:2], 0, atol=0.1) and 0 < lowered[2] < 0.3
        height = 2 * whole / np.linalg.norm(np.subtract(eye, target)) / (2 * np.tan(0.4))
        assert height == pytest.approx(0.8, abs=0.12)


def test_what_is_doubtful_is_looked_at_one_after_the_other(app, looked):
    said, view = [], tab(app)
    act(app.look_at_doubt, view)
    assert "has not been cut out" in app.panels.status_text and not looked
    mark(app, BALL)
    act(app.cut_out)
    found = doubts(app.session.now.object.fresh)
    for _ in range(len(found) + 1):
        act(app.look_at_doubt, view)
        said.append(app.panels.status_text)
    assert said == [words for words, _ in found] + said[:1] and said
    for (eye, target), (_, away) in zip(looked, found, strict=False):
        seen = np.subtract(eye, target)
        assert seen @ away > 0.95 * np.linalg.norm(seen) * np.linalg.norm(away)


def test_a_click_or_a_box_where_nothing_stands_marks_what_is_there(running, wall):
    (colours, _), app = wall, running
    before = app.session.now
    gesture(app, controls.BOX, (0.4, 0.4), (0.6, 0.6))
    assert 0 < app.session.now.object.n_selected < 0.3 * len(colours)
    for place in ((0.02, 0.02), (0.5, 0.5)):  # nothing is there; it is selected already
        before = app.session.now
        gesture(app, controls.CLICK, place)
        said = app.panels.status_text
        assert app.session.now is before and "--" not in said and not any(map(str.isdigit, said))
    gesture(app, controls.BOX, (0.48, 0.4), (0.6, 0.6), effect="remove")
    assert 0 < app.session.now.object.n_selected < before.object.n_selected  # a plain rectangle


def test_the_tolerance_dragged_after_a_click_makes_it_again_by_colour(running, wall):
    colours, means = wall
    session, tolerance, taken = running.session, running.panels.tolerance, []
    gesture(running, controls.CLICK, (0.5, 0.5))
    for percent in (3, 100, 3):
        tolerance.enter(percent, tab(running))
        finish(running)
        taken.append(session.now.object.selected.mask)
    red = (np.abs(colours - toy.RED).max(axis=1) < 0.03) & (means[:, 0] < 1)
    assert np.array_equal(taken[0], red) and np.array_equal(taken[2], red) and taken[1].all()
    assert len(session.now.object.marks) == 1
    do(running, "Undo")  # one step, whatever was dragged
    assert not session.now.object.n_selected
    before = session.now
    tolerance.enter(50, tab(running))
    finish(running)
    assert session.now is before  # there is no click to make again


def test_rows_that_the_page_has_found_are_marked_where_centres_count(app):
    view, scene = app.jobs.view, app.session.document.scene
    inside = np.linalg.norm(scene.means - toy.CENTRE, axis=1) < 0.9
    bits = np.packbits(inside[view.painter.packing.order], bitorder="little").tobytes()
    app.panels.taking.value = controls.CENTRES
    gesture(app, controls.LASSO, *EVERYWHERE, rows=bits)
    assert np.array_equal(app.session.now.object.selected.mask, inside)
    before = app.session.now
    gesture(app, controls.LASSO, *EVERYWHERE, rows=bits[:-1])
    assert app.session.now is before and "another scene" in app.panels.status_text
    app.panels.taking.value = controls.FOOTPRINT
    gesture(app, controls.LASSO, *EVERYWHERE, rows=bits)  # what shows is decided here
    assert app.session.now.object.n_selected > inside.sum()


def test_what_is_deleted_is_taken_out_of_the_scene_and_comes_back(app):
    mark(app, BALL)
    before = app.session.now
    do(app, "Take it out of the scene")
    now = app.session.now
    assert now.object.fresh is not None and now.object.hidden and now.object.marks == (BALL,)
    assert app.panels.showing == Showing("Everything", "Cut-out", "Own")
    gone = now.object.mask
    gone[now.object.fresh.discarded] = True
    assert not (shown_rows(now, app.panels.showing) & gone).any()
    do(app, "Undo")
    assert app.session.now is before


def test_in_the_mode_replace_a_mark_without_a_key_begins_anew(app):
    mark(app, FLOOR)
    app.panels.effect.value = controls.ANEW
    gesture(app, controls.CLICK, (0.5, 0.5))
    only = app.session.now.object.selected.mask
    assert not (only & app.session.now.applied(app.session.now.nothing(), [TINY]).mask).any()
    mark(app, TINY)
    gesture(app, controls.CLICK, (0.5, 0.5), effect="add")
    assert app.session.now.object.n_selected > np.count_nonzero(only)


def test_the_rest_is_a_ghost_that_can_be_marked_while_a_key_is_held(app):
    mark(app, BALL)
    act(app.cut_out)
    before = app.session.now.object
    gesture(app, controls.LASSO, *EVERYWHERE, effect="add")
    assert app.session.now.object is before  # what is not shown is not reached
    gesture(app, controls.LASSO, *EVERYWHERE, effect="add", ghost=True)
    assert app.session.now.object.n_selected > before.n_selected


def test_a_click_on_another_objects_thing_goes_on_with_that_object_unless_it_is_the_first(app):
    mark(app, BALL)
    do(app, "New object")
    mark(app, TINY)
    before = app.session.now
    gesture(app, controls.CLICK, (0.5, 0.5))
    assert app.session.now.object.id == 1 and app.session.now.objects == before.objects
    do(app, "New object")
    gesture(app, controls.CLICK, (0.5, 0.5))  # it is meant
    first, _, third = (part.selected.mask for part in app.session.now.objects)
    assert app.session.now.object.id == 3 and third.any() and not (first & third).any()


def test_marks_reach_nothing_that_is_not_shown(app):
    mark(app, BALL)
    before = app.session.now
    app.panels.showing = Showing("Object", "Selection", "Own")
    app.panels.reach.value = controls.THROUGH
    gesture(app, controls.LASSO, *EVERYWHERE)
    assert app.session.now is before and "changes nothing that is shown" in app.panels.status_text
    act(app.hide)
    assert not (shown_rows(app.session.now, Showing()) & before.object.selected.mask).any()
    do(app, "Unhide all")
    assert shown_rows(app.session.now, Showing()).all()
    app.panels.showing = Showing()
    app.tools.change_selection("All", None)
    finish(app)
    assert app.session.now.object.selected.mask.all()


def test_objects_are_named_coloured_hidden_locked_chosen_and_deleted_by_their_numbers(app):
    do(app, "New object")
    for what, value in (("name", " my  ball "), ("colour", "#0a0b0c"), ("hidden", True), ("locked", True)):
        act(app.change_object, 1, what, value)
    for what, value in (("name", "object 2"), ("colour", "red"), ("marks", "none"), ("name", None)):
        act(app.change_object, 1, what, value)
    first = app.session.now.objects[0]
    assert (first.name, first.colour, first.hidden, first.locked) == ("my ball", (10, 11, 12), True, True)
    act(app.change_object, 1, "active", True)
    act(app.hide)
    assert app.session.now.object.id == 1 and not app.session.now.object.hidden
    act(app.change_object, 1, "delete", True)
    act(app.change_object, 1, "name", "gone")
    assert [part.name for part in app.session.now.objects] == ["object 2"] and "object 1" in app.panels.status_text


def receive(app, name, data, view):
    """Have the app take a file that came from the browser."""
    part = app._files._state / "part"
    part.write_bytes(data)
    act(app.receive, app._files.store(name, part, hashlib.sha256(data).hexdigest()), view)


def test_files_from_the_browser_are_taken_for_what_they_are(app, ball, tmp_path):
    session, view, folder = app.session, tab(app), ball[0]
    mask = np.linalg.norm(session.document.scene.means - toy.CENTRE, axis=1) < 1.2
    np.save(tmp_path / "ball.npy", mask)
    receive(app, "../ball.npy", (tmp_path / "ball.npy").read_bytes(), view)
    assert np.array_equal(session.now.object.selected.mask, mask)
    app.jobs.do("Saving", lambda: app._files.download_project(view))
    do(app, "Clear")
    receive(app, *next(iter(view.sent.items())), view)
    assert np.array_equal(session.now.object.selected.mask, mask)
    receive(app, "cameras.json", (folder / "cameras.json").read_bytes(), view)
    assert "has these cameras now" in app.panels.status_text
    part = session.document.scene.select(np.flatnonzero(mask)[::2])
    formats.write(part, tmp_path / "part.ply")
    receive(app, "part.ply", (tmp_path / "part.ply").read_bytes(), view)
    assert session.now.object.n_selected == len(part)  # it is of the open scene
    do(app, "Undo")
    formats.write(toy.ball_on_floor(floor_side=20)[0], tmp_path / "else.ply")
    for name, data in (("else.ply", tmp_path / "else.ply"), ("other.ply", folder / "scene.ply")):
        receive(app, name, data.read_bytes(), view)
        finish(app)
        assert session.document.path.name == name
    assert np.array_equal(session.now.object.selected.mask, mask)  # the work on what the scene holds, wherever it lies
    receive(app, "nonsense.npy", b"nothing", view)
    assert "nonsense.npy" in app.panels.status_text


def test_results_are_downloaded_and_saved(app, tmp_path):
    view, panels = tab(app), app.panels
    act(app.download, OBJECT, view)
    assert not view.sent
    mark(app, BALL)
    app.session.do(edits.describe, 1, "name", "my ball")
    act(app.cut_out)
    for what in DOWNLOADS:
        act(app.download, what, view)
    assert set(view.sent) == {"my_ball.ply", "without_my_ball.ply", "my_ball.zip"}
    (tmp_path / "object.ply").write_bytes(view.sent["my_ball.ply"])
    assert len(formats.read(tmp_path / "object.ply")) == len(app.session.now.object.fresh.object)
    panels.program.value = "three.js"
    act(app.download, OBJECT, view)
    act(app.download, ALL_FILES, view)
    panels.program.value = controls.AS_IT_LIES
    with zipfile.ZipFile(io.BytesIO(view.sent["my_ball.zip"])) as archive:
        wanted = {f"my_ball/{name}" for name in ("object.ply", "object_for_three.spz", "report.json", "selection.json")}
        assert wanted <= set(archive.namelist())
    (tmp_path / "upright.spz").write_bytes(view.sent["my_ball.spz"])  # what the program reads
    means = formats.read(tmp_path / "upright.spz").means
    assert abs(np.quantile(means[:, 1], 0.01)) < 0.01 and np.median(means[:, 1]) > 0.5

    panels.folder.value = str(tmp_path / "out")
    act(app.save)
    assert str(tmp_path / "out" / "report.json") in panels.command.value
    act(app.save)
    assert controls.REPLACE in panels.status_text and "--overwrite" not in panels.status_text
    panels.folder.value = str(tmp_path / "all")
    act(app.save, together=True)
    assert (tmp_path / "all" / "object_my_ball.ply").is_file() and not panels.command.value


def test_an_object_is_moved_turned_and_scaled_for_its_files_alone(app, tmp_path):
    session, view, page = app.session, tab(app), app.jobs.page
    mark(app, BALL)
    act(app.cut_out)
    frame, result = app.jobs.view.frame, session.now.object.fresh
    half = Similarity(2.0, (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)), (1.0, 2.0, 3.0))
    page.hear(json.dumps({"is": "move", "object": 1, "by": asdict(frame.moved(half))}), view)
    finish(app)
    expected = 2 * result.object.means[:, [1, 0, 2]] * (-1, 1, 1) + (1, 2, 3)
    app.panels.folder.value = str(tmp_path / "moved")
    act(app.save)
    saved = {name: formats.read(tmp_path / "moved" / f"{name}.ply") for name in ("object", "object_placed")}
    assert np.allclose(saved["object"].means, result.object.means)
    assert np.allclose(saved["object_placed"].means, expected, atol=1e-4)
    assert np.allclose(saved["object_placed"].scales, 2 * saved["object"].scales, rtol=1e-4)
    act(app.download, OBJECT, view)
    (tmp_path / "sent.ply").write_bytes(next(iter(view.sent.values())))
    assert np.allclose(formats.read(tmp_path / "sent.ply").means, expected, atol=1e-4)
    kept = read_project(app._files._autosave)
    assert np.allclose(kept.moved["object 1"].to, half.to, atol=1e-4)
    assert session.do(restore, kept) and np.allclose(session.now.object.moved.turn, half.turn)
    do(app, "Undo")
    do(app, "Undo")
    assert session.now.object.moved is None and session.now.object.fresh is result
    page.hear(json.dumps({"is": "move", "object": 1, "by": {"turn": [0, 0, 0, 0]}}), view)  # turns nothing
    finish(app)
    assert session.now.object.moved is None


def test_a_second_scene_stands_beside_the_first_as_an_object(app, tmp_path):
    session, before = app.session, app.session.now
    mark(app, BALL)
    marked, n = session.now.object.selected.mask, len(session.document.scene)
    added = toy.ball_on_floor(floor_side=20)[0]
    added = added.replace(sh_rest=np.zeros((len(added), 3, 3), np.float32))
    formats.write(added, tmp_path / "lamp.ply")
    act(app.receive, tmp_path / "lamp.ply", tab(app), beside=True)
    assert "lamp stands beside the scene" in app.panels.status_text
    assert len(app.jobs.view.painter.states(session.now)) == n + len(added)
    ball, lamp = session.now.objects
    assert lamp.name == "lamp" and np.array_equal(lamp.mask, np.arange(n + len(added)) >= n)
    assert np.array_equal(ball.mask[:n], marked) and not ball.mask[n:].any()
    scene, whole = session.document.scene, app.jobs.view.painter.scene
    assert whole is scene and scene.sh_degree == 1 and np.allclose(scene.means[:n], before.document.scene.means)
    assert scene.means[n:, 0].min() > scene.means[:n, 0].max() - 0.5 or not np.allclose(scene.means[n:], added.means)
    assert app.panels.tool.value == controls.MOVE
    assert formats.read(session.document.path).means.shape == scene.means.shape
    do(app, "Undo")
    assert session.document is before.document and app.jobs.view.painter.scene is before.document.scene


def test_a_colour_is_picked(app, wall):
    colours, _ = wall
    gesture(app, controls.COLOUR, (0.5, 0.5))
    mask = app.session.now.object.selected.mask
    assert mask[np.isclose(colours[:, 1], toy.RED[1])].all() and not mask[colours[:, 1] > 0.5].any()
    app.panels.tolerance.value = 100
    app.tools.tolerate(tab(app))
    finish(app)
    assert app.session.now.object.selected.mask.all()


def test_what_was_saved_together_is_what_is_seen(app, tmp_path):
    session, panels = app.session, app.panels
    mark(app, BALL)
    do(app, "New object")
    mark(app, TINY)
    act(app.change_object, 1, "hidden", True)
    before = session.now
    panels.folder.value = str(tmp_path / "all")
    act(app.save, together=True)
    assert "1 of them is hidden" in panels.status_text and all(part.fresh for part in session.now.objects)
    states = app.jobs.view.painter.states(session.now)
    layers = app.jobs.view.painter.layers(session.now, states)
    fills = sum(np.count_nonzero(layer.states[:, 2] & FILL) for layer in layers)
    whole = shown_rows(session.now, Showing("Scene without it", "Cut-out")) & (states[:, 2] & REPLACED == 0)
    saved = formats.read(tmp_path / "all" / "background.ply")
    assert len(saved) == whole.sum() + fills and np.array_equal(
        saved.means[: whole.sum()], session.document.scene.means[whole]
    )
    panels.folder.value = str(tmp_path / "one")
    act(app.save)
    report = json.loads((tmp_path / "one" / "report.json").read_text())
    assert [each["name"] for each in report["objects"]] == ["object"] and "command" in report
    assert session.now.object.together  # what is seen stays
    do(app, "Undo")
    assert session.now is before


@pytest.fixture(scope="module")
def furnished(tmp_path_factory):
    """A red box, and a blue ball that stands apart: the folder, and the part that each Gaussian is of, (N,)."""
    box, ball = room.box((0, -0.9), (0.8, 0.8, 1.0), room.RED, 1), room.ball((0.3, 1.2), 0.5, room.BLUE, 2)
    scene, part = room.scene_of(room.floor(), room.wall(), box, ball)
    folder = tmp_path_factory.mktemp("room")
    room.save(scene, room.cameras(), folder)
    return folder, part


def test_objects_are_found_and_shown_and_are_one_step(running, furnished):
    (folder, part), app = furnished, running
    open_scene(app, folder / "scene.ply", folder / "cameras.json")
    session, panels = app.session, app.panels
    before = session.now
    with told(app, lambda stages: "3/" in stages[-1] and app.jobs.worker.cancel()) as stages:
        act(app.find_objects)
    assert session.now is before and not any("surfaces" in stage for stage in stages)
    panels.showing = Showing("Object", "Selection", "Own")
    act(app.find_objects)
    assert panels.status_text.startswith("Found 2 objects") and panels.showing == Showing()
    found = session.now.objects
    assert [each.name for each in found] == ["object 1", "object 2"]
    assert found[0].colour != found[1].colour
    for number in (2, 3):
        assert max(toy.jaccard(each.selected.mask, part == number) for each in found) > 0.8
    act(app.find_objects)
    assert "2 marked already" in panels.status_text and session.now.objects == found
    act(app.change_object, session.now.object.id, "delete", True)
    act(app.find_objects)
    assert session.now.objects[0] is found[1]
    np.testing.assert_array_equal(session.now.object.selected.mask, found[0].selected.mask)
    assert session.now.object.id == 3  # no other object has had it
    for _ in range(3):
        do(app, "Undo")
    assert session.now is before


def test_a_tool_without_a_scene_is_refused_and_leaves_no_sentence(ball, tmp_path):
    from gaussian_trimmer.app.serving import serving

    with serving(None, None, port=0, state=tmp_path) as started:
        app = started.controller
        app.tools.choose(controls.POINTS, None)
        finish(app)
        assert app.panels.tool.value == controls.LOOK
        open_scene(app, ball[0] / "scene.ply")
        for tool, said in ((controls.POINTS, "three points"), (controls.CLICK, "Click on the object")):
            app.tools.choose(tool, None)
            finish(app)
            assert said in app.panels.status_text
