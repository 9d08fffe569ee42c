"""Tests of picking an object by a click or a box."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import toy
from benchmark_data import benchmark_scene
from command_line import run

from gaussian_trimmer import formats
from gaussian_trimmer.cameras import Viewpoint
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Gaussians, concatenate
from gaussian_trimmer.rendering import blend_values
from gaussian_trimmer.selecting.clicks import (
    NothingFoundError,
    pieces_at_click,
    select_around_click,
    select_by_box,
    select_by_click,
    select_by_colour,
)
from gaussian_trimmer.selecting.marks import Box3D, Click
from gaussian_trimmer.selecting.segment_on_plane import pieces_on_plane, windows_around
from gaussian_trimmer.selecting.select import select
from gaussian_trimmer.surface.overview import OverviewConfig, drawn_rows, plan_overview
from gaussian_trimmer.surface.viewed_scene import ViewedScene, look_at_pixel
from gaussian_trimmer.views.view import bounding_box


@pytest.fixture(scope="module")
def ball():
    return toy.ball_on_floor(n_ball=1500)


def pixel_of(camera, point):
    x, y = camera.project(np.atleast_2d(np.asarray(point, float)))[0][0]
    return int(x), int(y)


def click_on(point, camera, scene, up=toy.UP):
    return select_by_click(ViewedScene(scene, camera, up), *pixel_of(camera, point))


def box_in(scene, camera, box):
    return select_by_box(ViewedScene(scene, camera, toy.UP), box)


@pytest.mark.parametrize("position", [(5, 0, 3), (0, -7, 4)])
def test_click_finds_what_stands_on_the_floor(ball, position):
    scene, truth = ball
    found, how = click_on(toy.CENTRE, toy.camera_at(position), scene)
    assert how == "piece"
    assert toy.jaccard(found, truth) > 0.9


def test_large_pictures_and_units_change_nothing(ball):
    scene, truth = ball
    turned, scale = toy.any_rotation(), 40.0
    camera = toy.camera_at((5, 0, 3), size=900)
    pose = camera.world_to_camera.copy()
    pose[:3, :3] = pose[:3, :3] @ turned.T
    pose[:3, 3] *= scale
    moved, view = toy.moved(scene, turned, scale), replace(camera, world_to_camera=pose)
    pick, _ = select_by_click(ViewedScene(moved, view, turned @ toy.UP), *pixel_of(camera, toy.CENTRE))
    assert toy.jaccard(pick, truth) > 0.9


def test_a_rough_surface_does_not_hide_what_stands_on_it():
    scene, truth = toy.ball_on_floor(n_ball=450, floor_side=60)
    rng = np.random.default_rng(5)
    means = scene.means.copy()
    floor = np.flatnonzero(~truth & (np.abs(means[:, 2] + 0.05) < 0.01))
    means[floor, 2] -= 0.14
    higher = floor[rng.random(len(floor)) < 0.3]
    means[higher, 2] += rng.uniform(0, 0.14, len(higher)).astype(np.float32)
    pick, how = click_on(toy.CENTRE, toy.camera_at((5, 0, 3)), scene.replace(means=means))
    assert how == "piece"
    assert toy.jaccard(pick, truth) > 0.9


def test_permuted_gaussians_give_the_permuted_answer(ball):
    scene, _ = ball
    order = np.random.default_rng(1).permutation(len(scene))
    camera = toy.camera_at((5, 0, 3))
    straight, permuted = (click_on(toy.CENTRE, camera, s)[0] for s in (scene, scene.select(order)))
    np.testing.assert_array_equal(straight[order], permuted)


def two_balls(apart=2.7):
    """The ball, another one some radii beside it, and more floor: the scene, and the rows of either ball."""
    scene, first = toy.ball_on_floor(n_ball=1500)
    ball, floor = scene.select(first), scene.select(scene.means[:, 2] < 0)
    ball = ball.replace(means=ball.means + np.float32([0, apart, 0]))
    floor = floor.replace(means=floor.means + np.float32([0, 6, 0]))
    part = np.repeat([0, 1, 2], [len(scene), len(ball), len(floor)])
    return concatenate([scene, ball, floor]), np.pad(first, (0, len(ball) + len(floor))), part == 1


def test_neighbours_stay_apart():
    scene, first, second = two_balls()
    camera = toy.camera_at((6, 1, 4), (0, 1.3, 1))
    assert toy.jaccard(click_on(toy.CENTRE, camera, scene)[0], first) > 0.9
    assert toy.jaccard(click_on(toy.CENTRE + np.array([0, 2.7, 0]), camera, scene)[0], second) > 0.9


@pytest.mark.parametrize("apart", [2.16, 2.24])
def test_seeds_all_over_a_ball_mean_the_same_things(apart):
    """Some of the gaps that are tried join the balls: all seeds on one of them find it alone, or all find both."""
    rng = np.random.default_rng(0)
    outward = rng.normal(size=(2, 1500, 3))
    outward /= np.linalg.norm(outward, axis=2, keepdims=True)
    floor = np.stack(np.meshgrid(np.arange(-4, 7, 0.2), np.arange(-4, 7, 0.2), [-0.05], indexing="ij"), -1)
    positions = np.concatenate([outward[0] + [0, 0, 1], outward[1] + [0, apart, 1], floor.reshape(-1, 3)])
    second = slice(1500, 3000)
    visible, level = np.full(len(positions), 10, np.float32), np.zeros(len(positions), np.float32)
    shares = []
    for row in np.flatnonzero(positions[:1500, 0] > 0.9)[:10]:
        seeds = np.zeros(len(positions), np.float32)
        seeds[row] = 1
        scale = 3.5 - 0.6 * positions[row, 0]
        windows = windows_around(scale, positions)
        pieces = pieces_on_plane(positions - positions[row], seeds, visible, level, scale, windows)
        shares.append(pieces[0][second].mean())
    assert max(shares) < 0.1 or min(shares) > 0.9


def test_what_is_clicked_away_leaves_what_was_clicked():
    """Two balls that touch are one thing for a click; a second one takes the other ball away."""
    scene, first, second = two_balls(apart=1.9)
    camera = toy.camera_at((6, 1, 4), (0, 1, 1))
    clicks = [
        Click(*pixel_of(camera, point), Viewpoint(camera), effect)
        for point, effect in ((toy.CENTRE, "add"), (toy.CENTRE + np.array([0, 1.9, 0]), "remove"))
    ]
    both, one = (select(scene, clicks[:count], up=toy.UP).mask for count in (1, 2))
    assert both[first].mean() > 0.9 and both[second].mean() > 0.9
    assert one[first].mean() > 0.85 and one[second].mean() < 0.1


def test_what_few_large_gaussians_show_is_one_object():
    """A ball of sixty Gaussians on a floor of two hundred: their centres alone are too few and too far apart."""
    rng = np.random.default_rng(0)
    outward = rng.normal(size=(60, 3))
    ball = outward / np.linalg.norm(outward, axis=1, keepdims=True) + [0, 0, 1]
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-4, 4, 0.57), np.arange(-4, 4, 0.57)))
    floor = np.column_stack([x, y, np.full(len(x), -0.1)])
    means = np.concatenate([ball, floor])
    scales = np.concatenate([np.full((60, 3), 0.2), np.tile([0.4, 0.4, 0.03], (len(floor), 1))])
    colours = np.concatenate([rng.uniform(-1.5, 1.5, (60, 3)), rng.uniform(-1.5, 1.5, (len(floor), 3))])
    n = len(means)
    scene = Gaussians(means, np.log(scales), [[1.0, 0, 0, 0]] * n, np.full(n, 3.0), colours, np.zeros((n, 3, 0)))
    camera = toy.camera_at((6, 1, 4), (0, 0, 1))
    pick, how = click_on((0, 0, 1), camera, scene)
    assert how == "piece"
    np.testing.assert_array_equal(pick, np.arange(n) < 60)


def test_box_finds_the_thing_that_fills_it():
    scene, first, second = two_balls()
    camera = toy.camera_at((6, 1, 4), (0, 1.3, 1))
    for truth in (first, second):
        shown = blend_values(scene, camera, truth.astype(np.float32)[:, None])[..., 0] > 0.5
        pick, how = box_in(scene, camera, bounding_box(shown))
        assert how == "piece"
        assert toy.jaccard(pick, truth) > 0.9


def patch_on_wall():
    """A red disc that lies in a blue wall, and which Gaussians are red."""
    steps = np.linspace(-3, 3, 101)
    wall = np.stack(np.meshgrid([0.0], steps, steps, indexing="ij"), -1).reshape(-1, 3)
    red = np.linalg.norm(wall, axis=1) < 0.8
    return toy.gaussians(wall, (0.02, 0.05, 0.05), np.where(red[:, None], toy.RED, toy.BLUE)), red


def test_where_nothing_stands_a_box_means_a_part_and_a_click_asks_for_one():
    scene, red = patch_on_wall()
    camera = toy.camera_at((6, 0, 0.5), (0, 0, 0))
    shown = blend_values(scene, camera, red.astype(np.float32)[:, None])[..., 0] > 0.5
    pick, how = box_in(scene, camera, bounding_box(shown, 1))
    assert how == "part"
    assert toy.jaccard(pick, red) > 0.8
    assert click_on((0, 0.1, 0.1), camera, scene)[1] == "around"
    near = toy.camera_at((3, 0, 0.2), (0, 0, 0))  # the wall goes on beyond the picture
    assert toy.jaccard(select_around_click(ViewedScene(scene, near, toy.UP), 100, 100), red) > 0.8
    selected = select(scene, [Click(100, 100, near)], up=toy.UP)  # and is never refused
    assert toy.jaccard(selected.mask, red) > 0.8
    assert "around the click" in selected.interpretations[0]
    plain = scene.replace(sh_dc=np.full_like(scene.sh_dc, 0.3))
    with pytest.raises(NothingFoundError, match="box close around"):
        box_in(plain, camera, (60, 60, 140, 140))


def test_what_is_seen_alone_is_what_a_click_means_where_nothing_stands():
    scene, truth = toy.ball_on_floor()
    ball = scene.select(np.flatnonzero(truth | (np.linalg.norm(scene.means, axis=1) > 12)))  # and strays
    camera = toy.camera_at((5, 0, 3))
    pick, how = click_on((0.9, 0, 1.3), camera, ball)
    assert how == "alone"
    assert toy.jaccard(pick, np.linalg.norm(ball.means - toy.CENTRE, axis=1) < 1.5) > 0.95
    near = select_around_click(ViewedScene(ball, toy.camera_at((1.6, 0, 1)), toy.UP), 100, 100)
    assert 0 < near.sum() < 0.7 * pick.sum()


def test_what_fills_photographs_is_not_seen_alone():
    scene, truth = toy.ball_on_floor()
    ball, camera = scene.select(np.flatnonzero(truth)), toy.camera_at((1.6, 0, 1))
    assert click_on((0.9, 0, 1), camera, ball)[1] == "alone"
    photographed = ViewedScene(ball, camera, toy.UP, seen_from=[camera])
    assert select_by_click(photographed, *pixel_of(camera, (0.9, 0, 1)))[1] == "around"


@pytest.mark.parametrize("is_level", [True, False])
def test_nothing_stands_on_a_slice_through_upright_sides(is_level):
    """A layer is a table top if it lies level; the same centres of upright discs are sides of the thing itself."""
    thin, wide = 0.01, 0.12
    scene, truth = toy.ball_on_floor(n_ball=1500)
    scales = np.where(truth[:, None], scene.scales, (wide, wide, thin) if is_level else (wide, thin, wide))
    scene = scene.replace(log_scales=np.log(scales).astype(np.float32))
    view = ViewedScene(scene, toy.camera_at((5, 0, 3)), toy.UP)
    assert bool(pieces_at_click(view, look_at_pixel(view, 100, 100))) == is_level


def test_a_click_made_again_on_a_part_of_what_is_seen_alone_takes_all_of_it():
    scene, truth = toy.ball_on_floor()
    ball = scene.select(np.flatnonzero(truth))
    view = Viewpoint(toy.camera_at((5, 0, 3)))
    click = Click(*map(int, pixel_of(view.camera, (0.9, 0, 1.3))), view)
    part = Box3D((-2, -2, 1.0), (2, 2, 3), "world")
    assert select(ball, [part]).mask.mean() < 0.9
    assert select(ball, [part, click]).mask.mean() > 0.95
    with pytest.raises(InputError, match="already"):
        select(scene, [part, click], up=toy.UP)


def test_nearer_surface_comes_first():
    """A ball on a plinth on the floor: the ball, then both; a point on the plinth means both."""
    scene, truth = toy.ball_on_floor(n_ball=1500, floor_side=60)
    steps = np.linspace(-2.0, 2.0, 41)
    top = np.stack(np.meshgrid(steps, steps, [-0.1], indexing="ij"), -1).reshape(-1, 3)
    heights = np.linspace(-2.0, -0.1, 20)
    side = np.stack(np.meshgrid(steps, heights, indexing="ij"), -1).reshape(-1, 2)
    walls = [np.insert(side, axis, end, axis=1) for axis in (0, 1) for end in (-2.0, 2.0)]
    plinth = np.concatenate([top, *walls])
    floor = scene.means[~truth] * [2, 2, 1] - [0, 0, 2]
    positions = np.concatenate([scene.means[truth], plinth, floor])
    n, parts = truth.sum(), np.repeat([0, 1, 2], [truth.sum(), len(plinth), len(floor)])
    visible, level = np.full(len(positions), 10, np.float32), np.zeros(len(positions), np.float32)

    def asked(row):
        seeds = np.zeros(len(positions), np.float32)
        seeds[row] = 1
        windows = windows_around(5.0, positions)
        return pieces_on_plane(positions - positions[row], seeds, visible, level, 5.0, windows)

    on_ball = asked(int(np.argmin(np.linalg.norm(positions[:n] - [1, 0, 1], axis=1))))
    assert toy.jaccard(on_ball[0], parts == 0) > 0.9
    assert any(toy.jaccard(piece, parts <= 1) > 0.9 for piece in on_ball[1:])
    on_plinth = asked(int(np.argmin(np.linalg.norm(positions - [2, 0, -1], axis=1))))
    assert toy.jaccard(on_plinth[0], parts <= 1) > 0.9


@pytest.mark.parametrize("pixel", [(-1, 5), (5, 200)])
def test_pixels_outside_the_picture(ball, pixel):
    with pytest.raises(InputError, match="outside the view of 200 x 200"):
        select_by_click(ViewedScene(ball[0], toy.camera_at((5, 0, 3)), toy.UP), *pixel)


@pytest.mark.parametrize("box", [(5, 5, 5, 9), (200, 0, 220, 5)])
def test_impossible_boxes(ball, box):
    with pytest.raises(InputError, match="holds no pixel of the view of 200 x 200 pixels"):
        box_in(ball[0], toy.camera_at((5, 0, 3)), box)


def test_where_nothing_is_seen(ball):
    away = toy.camera_at((40, 0, 60), (80, 0, 120))
    with pytest.raises(InputError, match="Nothing is seen at the pixel"):
        select_by_click(ViewedScene(ball[0], away, toy.UP), 100, 100)
    with pytest.raises(InputError, match="Nothing is seen in the box"):
        box_in(ball[0], away, (50, 50, 150, 150))


def test_overview_looks_at_the_detail_and_leaves_the_walls_out():
    scene, truth = toy.ball_on_floor(n_ball=3000)
    wall = toy.gaussians(np.random.default_rng(0).normal(size=(500, 3)) * [0.1, 8, 8] + [-12, 0, 0], 1.0, toy.WHITE)
    both = concatenate([scene, wall])
    overview = plan_overview(both, toy.UP, OverviewConfig(ring=5))
    assert len(overview.views) == 10
    for camera in (view.camera for view in overview.views[:5]):
        x, y = pixel_of(camera, toy.CENTRE)
        assert 0.2 * camera.width < x < 0.8 * camera.width
        assert 0.2 * camera.height < y < 0.8 * camera.height
    rows = drawn_rows(both.means, overview.views[0])
    assert set(np.flatnonzero(truth)) <= set(rows)
    assert rows.max() < len(scene)
    assert overview.whole == range(5, 10)
    for view in overview.views[5:]:
        pixels, _ = view.camera.project(both.means.astype(np.float64))
        assert ((pixels > 0) & (pixels < view.camera.width)).all(axis=1).mean() > 0.95
        assert len(drawn_rows(both.means, view)) == len(both)


def test_overview_stands_where_it_is_told_to():
    scene, _ = toy.ball_on_floor()
    plain, near = (plan_overview(scene, toy.UP, OverviewConfig(distance=d)).views[3].camera for d in (1, 0.5))
    assert np.isclose(2 * np.linalg.norm(near.centre - toy.CENTRE), np.linalg.norm(plain.centre - toy.CENTRE), rtol=0.3)
    level = plan_overview(scene, toy.UP, OverviewConfig(pitch=0, target=(2.0, 0.0, 1.0)))
    for camera in (view.camera for view in level.views):
        assert np.allclose(pixel_of(camera, (2.0, 0.0, 1.0)), 320, atol=1)
        assert np.isclose(camera.centre[2], 1.0)


@pytest.mark.parametrize(("name", "view"), [("fern", 5), ("mug", 5), ("lighthouse", 0)])
def test_a_small_tolerance_stays_within_a_thing_of_a_trained_scene(name, view):
    """It takes a part of it in a like colour, and a larger one takes that and more."""
    scene = benchmark_scene("tabletop")
    camera = scene.training_cameras[view]
    mask = (scene.coverage(name, camera.name) > 0.5).astype(np.uint8)
    depth = cv2.distanceTransform(mask, cv2.DIST_L2, 5)
    y, x = np.unravel_index(np.argmax(depth), depth.shape)
    looked_at = ViewedScene(scene.gaussians, camera, scene.up)
    small, larger = (select_by_colour(looked_at, int(x), int(y), tolerance) for tolerance in (0.06, 0.1))
    thing = scene.coarse(name, "exact")
    assert thing[larger].mean() > 0.9
    assert 0 < small.sum() < larger.sum() and (larger | ~small).all()


def test_what_a_click_takes_alone_is_trimmed_though_it_is_the_whole_file(tmp_path):
    scene, truth = toy.ball_on_floor(n_floaters=0)
    formats.write(scene.select(truth), tmp_path / "ball.ply")
    command = ["select", tmp_path / "ball.ply", "--up", "z", "--view-index", 0, "--click", 320, 320]
    out = ["--output", tmp_path / "ball.npy", "--trim", tmp_path / "out", "--quiet", "--refine", "off"]
    assert run(*command, *out, "--set", "plan.size=160") == 0
    assert len(formats.read(tmp_path / "out" / "object.ply")) == truth.sum()


@pytest.mark.parametrize("count", [1, 3])
def test_a_box_on_hardly_any_gaussians_is_answered(count):
    means = np.array(toy.CENTRE) + np.array([[0, 0, 0], [0, 0.3, 0], [0, 0, 0.3]])[:count]
    blobs = toy.gaussians(means, (0.3, 0.3, 0.3), (0.5, 0.5, 0.5))
    with pytest.raises(NothingFoundError):
        box_in(blobs, toy.camera_at((5, 0, 3)), (80, 80, 120, 120))
