"""Tests of several objects, of what is shown and hidden, and of projects, without a browser."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from app_session import BALL, FLOOR, TOP, click_on_ball

from gaussian_trimmer import formats
from gaussian_trimmer.app.marking import touches
from gaussian_trimmer.app.project import autosave_path, is_project, read_project, restored, write_project
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.app.snapshots import PALETTE
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import SH_C0
from gaussian_trimmer.selecting.marks import Sphere


def test_what_others_hide_or_lock_is_left_alone_and_the_marks_say_so(session, ball):
    from gaussian_trimmer.selecting.select import select

    for hidden, locked in ((True, False), (False, True)):
        session.open(session.document.path)
        session.mark(BALL)
        ours = session.now.object.selected.mask
        session.keep_object(hidden=hidden, locked=locked)
        session.add_object()
        session.mark(Sphere((0.0, 0.0, 0.0), 3.0))
        now = session.now
        assert now.object.n_selected and not (now.object.selected.mask & ours).any()
        again = select(session.document.scene, replace(now.basis, marks=now.object.marks))
        assert np.array_equal(again.mask, now.object.selected.mask)
    session.show_all()
    assert not any(part.hidden for part in session.now.objects)


def test_marks_among_some_change_no_others(session):
    session.mark(BALL)
    before = session.now.object.selected.mask
    upper = session.document.scene.means[:, 2] > 1
    session.mark(Sphere((0.0, 0.0, 1.0), 1.2, effect="remove"), among=upper)
    after = session.now.object.selected.mask
    assert np.array_equal(after[~upper], before[~upper])
    assert after[upper].sum() < before[upper].sum()
    with pytest.raises(InputError, match="changes nothing that is shown"):
        session.mark(BALL, among=np.zeros(len(before), np.bool_))


def test_what_lies_far_away_does_not_touch():
    means = np.array([[0, 0, 0], [0, 0, 1], [0, 0.05, 0], [0, 3, 0]], np.float32)
    selected = np.array([True, True, False, False])
    assert touches(means, selected, np.array([False, False, True, True]))
    assert not touches(means, selected, np.array([False, False, False, True]))


def test_inverting_twice_is_nothing(session):
    session.mark(BALL)
    mask = session.now.object.selected.mask
    session.invert()
    assert np.array_equal(session.now.object.selected.mask, ~mask)
    session.invert()
    assert np.array_equal(session.now.object.selected.mask, mask)


def test_a_trim_can_belong_to_the_mark_before_it(session):
    session.mark(BALL)
    session.trim()
    before = session.now
    session.mark(TOP)
    session.trim(joined=True)
    assert session.now.object.result is not None and session.now.object.earlier is None
    session.undo()
    assert session.now is before


def test_letters_of_a_name_are_one_step(session):
    before = session.now
    for name in ("b", "ba", "ball"):
        session.describe_object(name, before.object.colour)
    assert session.now.object.name == "ball"
    session.undo()
    assert session.now is before


def test_the_first_mark_gives_a_colour_that_stands_out(session):
    session.mark(BALL)
    own = np.clip(0.5 + SH_C0 * session.document.scene.sh_dc[session.now.object.selected.mask], 0, 1).mean(axis=0) * 255
    distances = [np.linalg.norm(own - colour) for colour in PALETTE]
    assert session.now.object.colour == PALETTE[int(np.argmax(distances))]


def test_a_project_brings_objects_and_marks_back(session, ball, tmp_path):
    session.set_up((0.0, 0.0, 2.0))
    session.mark(click_on_ball(session))
    session.mark(TOP)
    session.describe_object("ball", (1, 2, 3))
    session.keep_object(hidden=False, locked=True)
    session.add_object()
    session.mark(FLOOR)
    write_project(session.now, tmp_path / "new" / "a.json")
    assert is_project(tmp_path / "new" / "a.json")
    project = read_project(tmp_path / "new" / "a.json")
    assert project.scene == session.document.path and project.cameras == session.document.camera_path
    other = Session()
    other.open(project.scene, project.cameras)
    other.restore(restored(project, other.document, lambda stage: None))
    for one, back in zip(session.now.objects, other.now.objects, strict=True):
        assert np.array_equal(one.selected.mask, back.selected.mask)
        assert np.array_equal(one.selected.excluded, back.selected.excluded)
        assert (one.name, one.colour, one.locked) == (back.name, back.colour, back.locked)
    assert other.now.active == 1 and np.array_equal(other.now.up.direction, session.now.up.direction)
    other.undo()
    assert not other.now.has_work


def test_projects_of_other_scenes_and_damaged_ones_are_refused(session, tmp_path):
    session.mark(BALL)
    write_project(session.now, tmp_path / "a.json")
    document = json.loads((tmp_path / "a.json").read_text())
    for change, message in (
        ({"scene_size": 5}, "has 5 Gaussians"),
        ({"active": 3}, "active object"),
        ({"objects": []}, "active object"),
        ({"content": "else"}, "not a project"),
        ({"objects": [{}]}, "objects"),
        ({"objects": 2 * document["objects"]}, "two objects of the same name"),
    ):
        (tmp_path / "b.json").write_text(json.dumps(document | change))
        with pytest.raises(InputError, match=message):
            restored(read_project(tmp_path / "b.json"), session.document, lambda stage: None)


def test_work_is_kept_by_what_a_scene_holds(session, ball, tmp_path):
    shutil.copy(ball[0] / "scene.ply", tmp_path / "copy.ply")
    scene, copy = session.document.scene, formats.read(tmp_path / "copy.ply")
    assert autosave_path(tmp_path, scene) == autosave_path(tmp_path, copy)
    assert autosave_path(tmp_path, scene) != autosave_path(tmp_path, scene.replace(means=scene.means + 1))
