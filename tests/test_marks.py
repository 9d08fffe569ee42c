"""Marks: what they select together, what is saved of them, and what files of marks may say."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import toy

import gaussian_trimmer as gt
from gaussian_trimmer.cameras import Viewpoint
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.selecting.marks import (
    Box,
    Box3D,
    Click,
    FromFile,
    Grow,
    Rows,
    Shrink,
    Sphere,
    write_marks,
)
from gaussian_trimmer.selecting.selection import read_selection_result
from gaussian_trimmer.selecting.shapes import grown, shrunk
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.views.virtual_cameras import PlanConfig, plan_cameras

SCENE, TRUTH = toy.ball_on_floor()
CAMERAS = plan_cameras(SCENE.select(TRUTH), toy.UP, PlanConfig(size=96))[0]


pytestmark = pytest.mark.usefixtures("one_thread")


def middle(camera, point=toy.CENTRE):
    x, y = camera.project(np.array([point]))[0][0]
    return int(x), int(y)


def selected(*marks, up=toy.UP, scene=SCENE):
    return gt.select(scene, marks, up=up)


def test_volumes_select_what_lies_in_them():
    x, y, z = SCENE.means.T
    assert np.array_equal(
        selected(Box3D((-1, -1, 0), (1, 0, 2))).mask, (abs(x) <= 1) & (y <= 0) & (y >= -1) & (z >= 0) & (z <= 2)
    )
    assert np.array_equal(selected(Sphere((0, 0, 1), 1.1)).mask, np.linalg.norm(SCENE.means - (0, 0, 1), axis=1) <= 1.1)


def test_up_aligned_coordinates_turn_with_the_scene():
    turn = toy.any_rotation()
    turned = toy.moved(SCENE, turn)
    height = Box3D((-99, -99, 1), (99, 99, 99), "up")
    expected = selected(height).mask
    assert np.array_equal(expected, SCENE.means[:, 2] > 1)
    found = selected(height, up=turn @ toy.UP, scene=turned).mask
    assert np.count_nonzero(found != expected) < 5  # centres on the border, up to rounding


def test_marks_count_in_order():
    ball, upper = Sphere((0, 0, 1), 1.2), Box3D((-99, -99, 1), (99, 99, 99))
    z = SCENE.means[:, 2]
    in_ball = selected(ball).mask
    without = replace(upper, effect="remove")
    assert np.array_equal(selected(ball, without).mask, in_ball & (z <= 1))
    assert np.array_equal(selected(ball, without, upper).mask, (in_ball & (z <= 1)) | (z > 1))
    assert np.array_equal(selected(ball, upper, without).mask, in_ball & (z <= 1))
    assert np.array_equal(selected(ball, replace(upper, effect="intersect")).mask, in_ball & (z > 1))


def test_rims_grow_and_shrink_by_spacings():
    line = toy.gaussians(np.arange(40)[:, None] * [0.5, 0, 0], 0.1, (0.5, 0.5, 0.5))
    some = np.arange(40) < 20
    assert np.flatnonzero(grown(line.means, some, 2.1)).max() == 21
    assert np.flatnonzero(shrunk(line.means, some, 2.1)).max() == 17
    assert not shrunk(line.means, np.ones(40, bool), 2.1).sum() < 40
    assert np.array_equal(gt.select(line, [Box3D((-1, -1, -1), (9.6, 1, 1)), Grow(2.1), Shrink(2.1)]).mask, some)


def test_saved_marks_select_the_same(tmp_path):
    np.save(tmp_path / "part.npy", np.where(SCENE.means[:, 0] > 0.5, 4, 0))
    marks = [
        Box(20, 20, 76, 76, CAMERAS[1]),
        FromFile(tmp_path / "part.npy", SelectionOptions(object_id=(4,)), "remove"),
        Sphere((0.0, 0.0, 1.9), 0.3, "up", "remove"),
        Shrink(0.5),
    ]
    made = selected(*marks)
    made.save_marks(tmp_path / "marks.json")
    again = gt.select(SCENE, tmp_path / "marks.json")
    assert np.array_equal(again.mask, made.mask)
    assert again.marks.marks[1].options.object_id == (4,)
    assert json.loads((tmp_path / "marks.json").read_text())["marks"][1]["path"] == "part.npy"
    again.save_marks(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "marks.json").read_bytes()
    with pytest.raises(InputError, match="scene of 1612 Gaussians, and this one has 12"):
        gt.select(SCENE.select(np.arange(12)), tmp_path / "marks.json")


def test_views_from_all_around_are_saved_with_what_is_drawn_in_them(tmp_path):
    made = selected(Click(320, 320, 0))
    made.save_marks(tmp_path / "marks.json")
    (mark,) = gt.read_marks(tmp_path / "marks.json").marks
    assert isinstance(mark.view, Viewpoint)
    assert mark.view.drawn_centre == made.marks.marks[0].view.drawn_centre
    assert np.array_equal(mark.view.camera.world_to_camera, made.marks.marks[0].view.camera.world_to_camera)
    assert np.array_equal(gt.select(SCENE, tmp_path / "marks.json").mask, made.mask)


def test_a_click_adds_or_removes_a_whole_thing_beside_others():
    scene, first, second = toy.two_balls((2.6, 0, 0))
    cameras = plan_cameras(scene.select(first | second), toy.UP, PlanConfig(size=128))[0]
    at_second = toy.CENTRE + np.array([2.6, 0, 0])
    view = next(camera for camera in cameras if abs(middle(camera)[0] - middle(camera, at_second)[0]) > 30)
    both = gt.select(scene, [Click(*middle(view), view), Click(*middle(view, at_second), view)], up=toy.UP)
    assert toy.jaccard(both.mask, first | second) > 0.9
    one = [*both.marks.marks, Click(*middle(view), view, "remove")]
    assert toy.jaccard(gt.select(scene, one, up=toy.UP).mask, second) > 0.9


def test_a_click_moves_the_boundary_where_a_part_is_wrong():
    """Half of the ball is painted blue: one click on it takes it out as a whole."""
    blue = TRUTH & (SCENE.means[:, 0] > 0.1)
    colours = SCENE.sh_dc.copy()
    colours[blue] = SCENE.sh_dc[blue][:, ::-1]
    scene = SCENE.replace(sh_dc=colours)
    point = toy.CENTRE + np.array([0.95, 0, 0.3])
    camera = min(CAMERAS, key=lambda camera: np.linalg.norm(camera.centre - point))
    whole = Sphere((0.0, 0.0, 1.0), 1.1, effect="add")
    lower = Box3D((-99, -99, 0.1), (99, 99, 99), effect="intersect")
    red = gt.select(scene, [whole, lower, Click(*middle(camera, point), camera, "remove")], up=toy.UP)
    assert red.interpretations[-1].startswith("the boundary moved around the click")
    assert toy.jaccard(red.mask, selected(whole, lower).mask & ~blue) > 0.9
    with pytest.raises(InputError, match="not selected"):
        gt.select(scene, [*red.marks.marks, Click(*middle(camera, point), camera, "remove")], up=toy.UP)


@cache
def clicked():
    return gt.select(SCENE, [Click(320, 320, 0)], up=toy.UP)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(content="cameras"), "holds no marks"),
        (lambda d: d.update(up=[0, 0, 0]), "up vector"),
        (lambda d: d["marks"].append({"mark": "wave"}), "no known kind"),
        (lambda d: d["marks"][0].pop("x"), "has no x"),
        (lambda d: d["marks"][0].update(view=7), "one of the file's 1 views"),
        (lambda d: d["views"][0].update(width=-3), "image of -3 x 640"),
        (lambda d: d["views"][0].update(near=0), "near"),
        (lambda d: d["views"][0]["world_to_camera"][0].__setitem__(0, 5), "pose"),
    ],
)
def test_files_of_marks_that_cannot_be(tmp_path, change, message):
    write_marks(clicked().marks, tmp_path / "marks.json")
    document = json.loads((tmp_path / "marks.json").read_text())
    change(document)
    (tmp_path / "marks.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=message):
        gt.read_marks(tmp_path / "marks.json")


def test_marks_that_cannot_be():
    with pytest.raises(InputError, match="There is no mark"):
        gt.select(SCENE, [])
    with pytest.raises(InputError, match="nothing is selected before it"):
        gt.select(SCENE, [Grow(1.0)])
    with pytest.raises(InputError, match=r"Nothing is selected after the last mark \(a sphere\)"):
        gt.select(SCENE, [Sphere((99.0, 99.0, 99.0), 0.1)])
    with pytest.raises(InputError, match="Mark 1 is a tuple; give"):
        gt.select(SCENE, [(250, 190)])
    with pytest.raises(InputError, match="no view 40"):
        gt.select(SCENE, [Click(1, 1, 40)])


def test_rows_select_themselves_and_nothing_else(tmp_path):
    some = np.random.default_rng(0).random(len(SCENE)) < 0.3
    mark = Rows.of(some, "lasso")
    assert np.array_equal(selected(mark).mask, some)
    taken = selected(mark, Rows.of(TRUTH, "brush", "remove"))
    assert np.array_equal(taken.mask, some & ~TRUTH)
    taken.save_marks(tmp_path / "rows.json")
    assert np.array_equal(gt.select(SCENE, tmp_path / "rows.json").mask, taken.mask)


@pytest.mark.parametrize(
    "runs", ["", "%%%", "5", f"0 {len(SCENE) + 8}", f"-1 {len(SCENE) + 1}", f"0 {1 << 70}", "0 " * 9999]
)
def test_rows_of_other_scenes_and_nonsense_are_refused(runs):
    with pytest.raises(InputError, match="rows"):
        selected(Rows(runs, "lasso"))


BALL, PATCH = Sphere((0, 0, 1), 1.1), Sphere((0, -1, 1), 0.6, effect="remove")
IN_PATCH = np.linalg.norm(SCENE.means - (0, -1, 1), axis=1) <= 0.6


def test_the_last_mark_on_a_gaussian_decides_what_stays_out():
    again = selected(BALL, PATCH, Sphere((0, -1, 1), 0.3))
    assert np.array_equal(selected(BALL, PATCH).excluded, IN_PATCH)
    assert np.array_equal(again.excluded, IN_PATCH & ~again.mask) and again.excluded.sum() < IN_PATCH.sum()


def test_what_is_selected_cannot_be_excluded():
    ball = TRUTH & (SCENE.means[:, 2] > 0.1)
    free, bound = (
        gt.trim(SCENE, ball, config=toy.small_config(), excluded=excluded).object_mask
        for excluded in (None, np.ones(len(SCENE), bool))
    )
    assert np.array_equal(bound & ball, free & ball)


def test_rows_and_marks_are_written_together(tmp_path, monkeypatch):
    def fail(*_):
        raise OSError(28, "No space left on device")

    selected(BALL, PATCH).save(tmp_path / "a.npy")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.setattr("gaussian_trimmer.selecting.marks.write_json", fail)
    with pytest.raises(InputError, match="No space"):
        selected(BALL).save(tmp_path / "a.npy")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_an_array_does_not_say_what_was_removed_and_whoever_gives_one_is_told(tmp_path):
    selected(BALL, PATCH).save(tmp_path / "a.npy")
    said = []
    assert read_selection_result(tmp_path / "a.npy", SCENE, say=said.append).excluded is None
    assert len(said) == 1 and "a.json" in said[0]
    found = read_selection_result(tmp_path / "a.json", SCENE, say=said.append)
    assert np.array_equal(found.excluded, IN_PATCH) and len(said) == 1
    with pytest.raises(InputError, match="holds marks; give"):
        selected(FromFile(tmp_path / "a.json"))
