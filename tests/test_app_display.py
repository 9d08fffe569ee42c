"""Tests of what the app shows: which Gaussians, in which colours, from where; and of marks on what is shown."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import toy

from gaussian_trimmer.app import edits
from gaussian_trimmer.app.display import Painter, changed_rows, shown_rows, thinned
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.app.snapshots import Document, Snapshot, TrimChoices
from gaussian_trimmer.app.viewpoints import Frame, Showing, before_what_shows, points_at, viewpoint_of
from gaussian_trimmer.cameras import look_at
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import write
from gaussian_trimmer.gaussians import quaternions_of
from gaussian_trimmer.selecting.marks import Box3D, Click, FromFile, Sphere
from gaussian_trimmer.selecting.selection import Selection
from gaussian_trimmer.trimming.config import SplitConfig, TrimConfig
from gaussian_trimmer.trimming.result import RowLabel
from gaussian_trimmer.trimming.trim import trim


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ball")
    scene, truth = toy.ball_on_floor()
    write(scene, folder / "scene.ply")
    np.save(folder / "rough.npy", toy.dilated(scene, truth))
    opened = Session()
    opened.open(folder / "scene.ply")
    opened.do(edits.set_up, (0.0, 0.0, 1.0))
    opened.do(edits.mark, FromFile(folder / "rough.npy"))
    opened.do(edits.trim_object, TrimChoices())
    opened.do(edits.add_object)
    opened.do(edits.mark, Sphere((2.5, 2.5, 0.0), 0.5))
    return opened


@pytest.fixture
def first(session):
    """The session with the first object, which was cut out, as the active one."""
    session.do(edits.activate, 1, joined=True)
    yield session
    session.do(edits.activate, 2, joined=True)


@pytest.fixture
def painter(session):
    return Painter(session.document.scene, 10**6)


def tinted(splats, plain):
    return np.abs(splats.colours - plain.colours).max(axis=1) > 0.01


def test_before_the_objects_have_their_colours_and_nothing_else(session, painter):
    now, plain = session.now, painter.paint(session.now, Showing(colours="Own"))
    shown = painter.paint(now, Showing())
    assert len(shown) == len(session.document.scene)
    owner = np.any([part.selected.mask for part in now.objects], axis=0)
    assert np.array_equal(tinted(shown, plain), owner)
    first, second = (shown.colours[part.selected.mask].mean(axis=0) for part in now.objects)
    assert np.abs(first - second).max() > 0.2


def test_parts_are_the_object_and_the_rest(session, painter):
    now, scene = session.now, session.document.scene
    result = now.objects[0].fresh
    for when, rest in (("Selection", now.objects[0].selected.mask), ("Cut-out", result.object_mask)):
        object_ = painter.paint(now, Showing("Object", when))
        background = painter.paint(now, Showing("Scene without it", when))
        both = painter.paint(now, Showing("Everything", when))
        assert len(object_) == now.object.n_selected  # the second object has not been trimmed
        gone = len(result.discarded) - result.count(RowLabel.FILLED) if when == "Cut-out" else 0
        more = len(result.object) - result.object_mask.sum() if when == "Cut-out" else 0  # the fit has cut some in two
        assert len(background) == (~(rest | now.object.selected.mask)).sum() - gone
        assert len(both) == len(scene) - gone + more
    assert rest.sum() < now.objects[0].n_selected


def large_ball():
    """A ball of Gaussians so large that they straddle its outline, and which they are."""
    scene, truth = toy.ball_on_floor()
    return scene.replace(log_scales=scene.log_scales + np.log(4) * truth[:, None].astype(np.float32)), truth


def test_split_parts_and_filled_gaussians_are_shown():
    scene, truth = large_ball()
    result = trim(scene, truth, config=TrimConfig(split=SplitConfig("plane")), up="z")
    n_split = result.count(RowLabel.SPLIT_OUTSIDE)
    assert n_split > 0
    document = Document(Path("a.ply"), None, scene, None)
    first = Snapshot.first(document, document.find_up((0.0, 0.0, 1.0)))
    selected = Selection(truth, np.zeros_like(truth))
    now = first.with_object(replace(first.object, selected=selected, result=result), "cut out")
    object_, background, both = (
        Painter(scene, 10**6).paint(now, Showing(part, "Cut-out"))
        for part in ("Object", "Scene without it", "Everything")
    )
    assert (len(object_), len(background)) == (len(result.object), len(result.background))
    assert len(both) == len(object_) + len(background)
    centres = Painter(scene, 10**6).frame.to_scene(object_.centres.astype(np.float64))
    assert np.allclose(np.sort(centres, axis=0), np.sort(result.object.means, axis=0), atol=1e-5)


def test_large_scenes_are_thinned_for_display_only(session):
    n = len(session.document.scene)
    few = Painter(session.document.scene, n // 4)
    shown = few.paint(session.now, Showing(colours="Own"))
    whole = Painter(session.document.scene, n).paint(session.now, Showing(colours="Own"))
    assert len(shown) == pytest.approx(n / 4, rel=0.1)
    assert np.trace(shown.covariances, axis1=1, axis2=2).mean() > 3 * np.trace(
        whole.covariances, axis1=1, axis2=2
    ).mean()  # fmt: skip
    object_ = few.paint(session.now, Showing("Object"))
    assert len(object_) == min(session.now.object.n_selected, n // 4)  # the object keeps all that there is room for


def test_what_is_near_the_eye_is_shown_in_full(session, painter):
    scene = session.document.scene
    eye = browser(painter.frame, eye=(0.0, -1.6, 1.0)).camera  # before the ball
    rows, growth = thinned(scene.means, np.ones(len(scene), np.bool_), len(scene) // 3, eye)
    assert len(rows) == pytest.approx(len(scene) / 3, rel=0.15)
    pixels, depths = eye.project(scene.means.astype(np.float64))
    near = (depths > 0) & (depths < 1.0) & ((pixels >= 0) & (pixels < (eye.width, eye.height))).all(axis=1)
    kept = np.isin(np.arange(len(scene)), rows)
    assert kept[near].mean() > 0.9 > 2 * kept[~near].mean()
    assert (growth[near[rows]] < 1.5).all()
    assert growth.sum() == pytest.approx(len(scene), rel=0.3)  # areas are covered as before
    again, _ = thinned(scene.means, np.ones(len(scene), np.bool_), len(scene) // 3, eye)
    assert np.array_equal(rows, again)


def test_colours_are_those_that_the_eye_sees(session):
    scene = session.document.scene
    rest = np.zeros((len(scene), 3, 3), np.float32)
    rest[:, 0, 2] = -0.5  # redder towards one side of x
    painter = Painter(scene.replace(sh_rest=rest), 10**6)
    assert painter.depends_on_eye and not Painter(scene, 10**6).depends_on_eye
    now = session.now
    left, right = (
        painter.paint(now, Showing(colours="Own"), browser(painter.frame, eye=(x, 0.1, 1.0)).camera)
        .colours[:, 0]
        .mean()
        for x in (-9.0, 9.0)
    )
    assert abs(left - right) > 0.1


def test_changes_have_their_colours(first, painter):
    now = first.now
    result = now.object.fresh
    added, removed, cut, relit = changed_rows(now.object)
    assert np.array_equal(removed, result.selection & ~result.object_mask) and removed.any()
    shown = painter.paint(now, Showing("Object", "Cut-out", "Changes"))
    plain = painter.paint(now, Showing("Object", "Cut-out", "Own"))
    assert len(shown) == len(plain) + (removed & ~cut).sum()  # what was removed is seen, too
    red = shown.colours[removed[np.maximum(shown.rows, 0)]]
    assert (red[:, 0] > red[:, 2] + 0.2).all()
    without = painter.paint(now, Showing("Scene without it", "Cut-out", "Changes"))
    made_up = without.colours[without.rows == -1]
    assert len(made_up) == result.count(RowLabel.FILLED)
    assert (made_up[:, 2] < made_up[:, 0]).all()  # yellow
    assert not added.any() or (added & result.object_mask).any()
    assert relit.sum() == result.count(RowLabel.RELIT)


def test_after_further_marks_the_cut_out_is_seen_with_them_and_changes_are_theirs(first):
    before, changes = first.now.object.mask, Showing("Object", "Cut-out", "Changes")
    first.do(edits.mark, toy.TOP)
    stale = first.now.object
    inside = np.linalg.norm(first.document.scene.means - np.array(toy.TOP.centre), axis=1) <= toy.TOP.radius
    assert stale.fresh is None and np.array_equal(stale.mask, before & ~inside)
    assert np.array_equal(changed_rows(stale)[1], before & inside)
    assert shown_rows(first.now, changes)[before & inside].all()  # until it is cut out again
    first.do(edits.trim_object, TrimChoices(), joined=True, again=True)
    fresh = first.now.object
    assert np.array_equal(changed_rows(fresh)[1], before & ~fresh.mask)
    assert not shown_rows(first.now, changes)[before & inside].all()
    first.undo()


def test_the_frame_makes_any_scene_a_few_units_large():
    scene, _ = toy.ball_on_floor()
    for scale, shift in ((1e-4, 0.0), (1.0, 1e5), (1e4, 3.0)):
        frame = Frame.around((scene.means * np.float32(scale) + np.float32(shift)).astype(np.float32))
        points = scene.means.astype(np.float64) * scale + shift
        assert np.median(np.linalg.norm(frame.to_viewer(points), axis=1)) == pytest.approx(5, rel=0.05)
        assert np.allclose(frame.to_scene(frame.to_viewer(points)), points)
    assert Frame.around(np.ones((3, 3), np.float32)).scale == 1


def browser(frame, eye=(0.0, -8.0, 4.0), width=200, height=100):
    pose = look_at(np.array(eye), toy.CENTRE, toy.UP)
    turn = quaternions_of(pose[:3, :3].T[None])[0]
    camera = SimpleNamespace(
        position=frame.to_viewer(np.array(eye)), wxyz=turn, fov=0.8, image_width=width, image_height=height, near=0.01
    )
    return viewpoint_of(camera, frame)


def test_a_browsers_camera_is_the_same_camera_in_the_scene():
    scene, _ = toy.ball_on_floor()
    frame = Frame.around(scene.means)
    camera = browser(frame).camera
    assert np.allclose(camera.centre, (0, -8, 4))
    assert np.allclose(camera.world_to_camera, look_at(np.array([0.0, -8, 4]), toy.CENTRE, toy.UP), atol=1e-6)
    assert np.allclose(camera.project(toy.CENTRE[None])[0], (100, 50), atol=1e-4)
    assert 2 * np.arctan(50 / camera.K[1, 1]) == pytest.approx(0.8)


def test_points_lie_on_the_surface_and_are_nan_in_the_void():
    scene, _ = toy.ball_on_floor(n_floaters=0)
    frame = Frame.around(scene.means)
    view = browser(frame)
    on_ball, void = points_at(scene, view, [(0.5, 0.5), (0.5, 0.0)])
    assert np.linalg.norm(np.array(on_ball) - toy.CENTRE) == pytest.approx(toy.RADIUS, abs=0.12)
    assert on_ball[1] < 0
    assert np.isnan(void).all()


def test_with_the_object_alone_a_click_means_the_object_and_not_what_is_hidden_before_it(session):
    session.do(edits.add_object)
    session.do(edits.mark, Box3D((-2.0, -2.0, 0.02), (2.0, 2.0, 3.0)))  # the ball without the floor
    now, scene = session.now, session.document.scene
    shown = scene.select(np.flatnonzero(shown_rows(now, Showing("Object"))))
    view = browser(Frame(np.zeros(3), 1.0), eye=(0.5, 0.0, -6.0), width=160, height=160)
    before = now.object.n_selected
    with pytest.raises(InputError, match="not selected"):
        session.do(edits.mark, Click(80, 88, view, "remove"))  # meets the floor
    past = before_what_shows(shown, view, [(0.5, 0.55)])
    session.do(edits.mark, Click(80, 88, past, "remove"))
    assert session.now.object.n_selected < before
    with pytest.raises(InputError, match="Nothing that is shown"):
        before_what_shows(shown, view, [(0.0, 0.0)])
    for _ in range(3):
        session.undo()
