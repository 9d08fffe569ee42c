"""The surface that an object hid goes on: checks, a wall, its edge; no shadow stays; what is made up is marked."""

import made_room
import numpy as np
import pytest
import toy

from gaussian_trimmer import formats
from gaussian_trimmer.evaluation.scoring import read_result
from gaussian_trimmer.gaussians import SH_C0, concatenate
from gaussian_trimmer.geometry.bounds import own_frame, robust_bounds
from gaussian_trimmer.output.report import describe
from gaussian_trimmer.output.saving import save
from gaussian_trimmer.removal.gaps import close_gaps
from gaussian_trimmer.removal.inpainting import continued, where_it_is
from gaussian_trimmer.removal.remove import CLOSED
from gaussian_trimmer.removal.surface_picture import SurfacePicture
from gaussian_trimmer.removal.views import RemovalViews, Surface
from gaussian_trimmer.rendering import render
from gaussian_trimmer.trimming.result import RowLabel
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.views.virtual_cameras import PlanConfig, plan_cameras


def ball_over_a_hole(radius=0.5):
    """The ball on a floor of one colour, with nothing below it, as training leaves it where nobody looks."""
    scene, truth = toy.ball_on_floor(n_ball=1500, floor_side=40)
    below = ~truth & (np.linalg.norm(scene.means[:, :2], axis=1) < radius) & (np.abs(scene.means[:, 2]) < 0.2)
    colours = scene.sh_dc.copy()
    colours[~truth] = (np.array(toy.WHITE) - 0.5) / SH_C0
    return scene.replace(sh_dc=colours.astype(np.float32)).select(~below), truth[~below]


SCENE, TRUTH = ball_over_a_hole()

CONFIG = toy.small_config(background="filled")


@pytest.fixture(scope="module")
def results():
    return [trim(SCENE, TRUTH, config=toy.small_config(background=mode)) for mode in ("clean", "filled")]


def test_the_hole_is_closed_in_the_colour_of_the_floor(results):
    (camera,), _ = plan_cameras(SCENE.select(TRUTH), toy.UP, PlanConfig(views=1, size=96, pitch_degrees=80))
    open_, closed = (render(result.background, camera) for result in results)
    middle = slice(44, 52), slice(44, 52)
    assert open_.alpha[middle].mean() < 0.3
    assert closed.alpha[middle].mean() > 0.9
    assert np.abs(closed.rgb[middle].mean(axis=(0, 1)) - toy.WHITE).max() < 0.1


def test_a_hole_that_is_seen_through_the_open_back_of_the_object_is_closed_too():
    back = TRUTH & (SCENE.means[:, 1] > -0.2)
    scene, truth = SCENE.select(~back), TRUTH[~back]
    rest = trim(scene, truth, config=CONFIG).background
    (camera,), _ = plan_cameras(SCENE.select(TRUTH), toy.UP, PlanConfig(views=1, size=96, pitch_degrees=80))
    assert render(rest, camera).alpha[44:52, 44:52].mean() > 0.9


def test_what_was_filled_is_marked(results, tmp_path):
    without, filled = results
    count = filled.count(RowLabel.FILLED)
    assert count > 10
    assert describe(filled)["counts"]["filled"] == count
    assert (filled.background_source[-count:] == -1).all()
    assert describe(without)["counts"]["filled"] == 0
    taken_off = len(filled.discarded) - len(without.discarded)
    assert len(filled.background) == len(without.background) + count - taken_off
    toy.check_parts(filled, TRUTH)
    save(filled, tmp_path)
    labels = np.load(tmp_path / "labels.npz", allow_pickle=False)
    assert labels["label_names"][labels["label"][-1]] == "filled"
    np.testing.assert_array_equal(formats.read(tmp_path / "background.ply").means, filled.background.means)
    found = read_result(tmp_path, SCENE)
    np.testing.assert_array_equal(found.selection, filled.object_mask)
    np.testing.assert_array_equal(found.before, TRUTH)


def test_the_object_and_what_hides_the_hole_stay_as_they_are(results):
    without, filled = results
    np.testing.assert_array_equal(filled.object.means, without.object.means)
    cameras, _ = plan_cameras(SCENE.select(TRUTH), toy.UP, PlanConfig(size=96))
    both = concatenate([filled.object, filled.background])
    for camera in cameras:
        before, after = (render(part, camera).rgb for part in (SCENE, both))
        assert np.mean((before - after) ** 2) < 10**-4


def test_a_surface_that_is_hardly_seen_around_the_object_is_closed_and_goes_no_farther():
    near = np.linalg.norm(SCENE.means[:, :2], axis=1) < 0.75
    wide, small = (trim(SCENE.select(part), TRUTH[part], config=CONFIG) for part in (near | ~near, near | TRUTH))
    assert wide.rest.not_filled.get(1) is None and small.rest.not_filled.get(1) is None
    assert CLOSED in small.rest.warnings[1] and CLOSED not in wide.rest.warnings[1]
    filled = small.background.select(small.background_label == RowLabel.FILLED)
    assert len(filled) > 10
    assert np.linalg.norm(filled.means[:, :2], axis=1).max() < 0.9
    assert np.abs(filled.means[:, 2]).max() < 0.3


def test_a_wall_does_not_go_on_over_the_doorway_beside_a_cupboard():
    wall, floor = made_room.wall(), made_room.floor()
    doorway = (np.abs(wall.means[:, 1] - 1) < 0.5) & (wall.means[:, 2] < 2)
    cupboard = made_room.box((-2.7, -0.3), (0.5, 1.4, 1.9), made_room.RED)
    hidden = (np.abs(wall.means[:, 1] + 0.3) < 0.6) & (wall.means[:, 2] < 1.8)
    scene, part = made_room.scene_of(cupboard, floor, wall.select(~(doorway | hidden)))
    result = trim(scene, part == 0, cameras=made_room.cameras())
    x, y, z = result.background.means[result.background_label == RowLabel.FILLED].T
    on_wall = np.abs(x + 3) < 0.1
    assert np.count_nonzero(on_wall & (np.abs(y + 0.3) < 0.5)) > 100
    assert np.count_nonzero(on_wall & (np.abs(y - 1.15) < 0.25) & (z < 1.8)) < 20


def test_a_hole_in_what_is_not_flat_is_closed_between_what_is_seen():
    ball = SCENE.select(TRUTH)
    across, up = (part.ravel() for part in np.meshgrid(np.linspace(-0.75, 0.75, 60), np.linspace(-1, 3, 60)))
    there = np.hypot(1.3 * across, up - 1) > 0.85  # what the ball hides of a niche behind it
    niche = np.column_stack([2 * np.sin(across), 1 + 2 * np.cos(across) ** 2, up])[there]
    around = toy.gaussians(niche, (0.05, 0.05, 0.05), toy.WHITE)
    scene, truth = concatenate([ball, around]), np.arange(len(ball) + len(around)) < len(ball)
    cameras = [toy.camera_at((x, -5, 2)) for x in (-1, 0, 1)]
    result = trim(scene, truth, cameras=cameras, up=toy.UP, config=CONFIG)
    assert CLOSED in result.rest.warnings[1]
    for camera in cameras:
        before, after, unfilled = (render(part, camera).alpha for part in (scene, result.background, around))
        middle = render(ball, camera).alpha > 0.9
        assert unfilled[middle].mean() < 0.6 and after[middle].mean() > 0.8
        assert np.abs(after - before)[render(ball, camera).alpha < 0.1].mean() < 0.01


@pytest.mark.parametrize(("places", "closed"), [(((0.5, -5), (-0.5, -5)), True), (((-5, 0), (5, 0)), False)])
def test_a_gap_far_behind_is_closed_only_if_most_views_see_it_hidden_by_the_object(places, closed):
    ball = SCENE.select(TRUTH)
    across, up = (part.ravel() for part in np.meshgrid(np.linspace(-4, 4, 80), np.linspace(-3, 5, 80)))
    there = np.hypot(across, up - 1) > 1.6  # 5 behind the ball, as through a window of which one view looks out
    far = toy.gaussians(np.column_stack([across, np.full_like(across, 5), up])[there], 0.09, toy.WHITE)
    scene, truth = concatenate([ball, far]), np.arange(len(ball) + np.count_nonzero(there)) < len(ball)
    cameras = [toy.camera_at((*place, 1)) for place in ((0, -5), *places)]
    bounds = robust_bounds(ball, own_frame(ball, toy.UP))
    views = RemovalViews(scene, truth, truth, bounds, [], observing=cameras)
    assert (len(close_gaps(views, far)) > 100) == closed


def test_a_small_spot_of_emptiness_beside_a_hole_leaves_no_more_than_itself_open():
    hole, empty, doorway = (np.zeros((128, 128), bool) for _ in range(3))
    hole[30:90, 30:90], empty[22:30, 50:58], doorway[:, 90:] = True, True, True
    surface = Surface(np.zeros(3), np.eye(3), 1.0)

    def open_in(empty):
        known = ~(hole | empty)
        picture = SurfacePicture(surface, np.zeros((128, 128, 3), np.float32), known, empty, hole)
        return np.count_nonzero(hole & ~where_it_is(picture, hole))

    assert 0 < open_in(empty) < np.count_nonzero(empty)
    assert 0.1 * hole.sum() < open_in(doorway) < 0.25 * hole.sum()  # one of four sides


def test_the_middle_of_a_frame_is_harmonic():
    known = np.ones((9, 9), bool)
    known[2:7, 2:7] = False
    slope = np.add.outer(np.arange(9.0), 2 * np.arange(9.0))
    np.testing.assert_allclose(continued(np.where(known, slope, 0), known, ~known), slope, atol=1e-6)


def test_without_a_flat_surface_nothing_is_filled():
    ball = SCENE.select(TRUTH)
    rest = ball.replace(means=ball.means + np.float32([0, 0, 9]))  # something round, far above
    scene, truth = concatenate([ball, rest]), np.arange(2 * len(ball)) < len(ball)
    result = trim(scene, truth, config=toy.small_config(background="filled"))
    assert not result.count(RowLabel.FILLED)
    assert "no flat surface" in result.rest.not_filled.get(1)
    assert describe(result)["objects"][0]["not_filled"] == result.rest.not_filled.get(1)
