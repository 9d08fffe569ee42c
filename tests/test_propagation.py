"""Tests of carrying a mask of one view on to all sides of the object."""

from dataclasses import replace

import numpy as np
import pytest
import toy
from test_clicks import camera_at

from gaussian_trimmer.gaussians import SH_C0, concatenate
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.selecting.propagation import propagate_mask

RENDERER = get_renderer("numba")
CAMERA = camera_at((7, 0, 4.5), toy.POLE_TOP)


@pytest.fixture(scope="module")
def pole():
    return toy.ball_on_pole()


def mask_of(scene, chosen, camera=CAMERA):
    return RENDERER.blend_values(scene, camera, chosen.astype(np.float32)[:, None])[..., 0] > 0.5


def propagated(scene, mask, camera=CAMERA, up=toy.UP, **options):
    return propagate_mask(scene, camera, RENDERER.render(scene, camera), mask, up, RENDERER, **options)


def check_ball(selection, scene, part):
    """The whole ball, front and back, and next to nothing of what touches it."""
    ball = part == toy.BALL
    assert toy.jaccard(selection, ball) > 0.9
    assert selection[ball & (scene.means[:, 0] < -0.5)].mean() > 0.9
    assert selection[part == toy.NEIGHBOUR].mean() < 0.05
    assert selection[part == toy.POLE].mean() < 0.1
    assert not selection[part == toy.FLOOR].any()


def test_a_ball_gets_its_back_without_the_neighbour_that_touches_it(pole):
    scene, part = pole
    check_ball(propagated(scene, mask_of(scene, part == toy.BALL)), scene, part)


def test_nothing_that_the_view_selected_is_lost(pole):
    scene, part = pole
    mask = mask_of(scene, part == toy.BALL)
    weights = RENDERER.blend_weights(scene, CAMERA, mask.astype(np.uint8), 2)
    shown = (weights[:, 1] > weights[:, 0]) & (weights[:, 1] > 1)
    assert propagated(scene, mask)[shown].mean() > 0.98


def test_a_spot_that_the_mask_left_out_comes_along():
    """A white tip that hangs on the ball and on nothing else, as the tip of a tail."""
    scene, part = toy.ball_on_pole(neighbour=False)
    tip = (part == toy.BALL) & (scene.means[:, 2] > 3.85)
    white = np.where(tip[:, None], (np.array(toy.WHITE) - 0.5) / SH_C0, scene.sh_dc).astype(np.float32)
    selection = propagated(scene.replace(sh_dc=white), mask_of(scene, (part == toy.BALL) & ~tip))
    assert selection[tip].mean() > 0.9
    assert toy.jaccard(selection, part == toy.BALL) > 0.9


def test_what_lies_behind_the_visible_background_is_no_object(pole):
    """A red ball below the floor, in touch with nothing, hidden by the floor beside the mask."""
    scene, part = pole
    rng = np.random.default_rng(3)
    outward = rng.normal(size=(300, 3))
    below = np.array([1.0, 0, -0.4]) + 0.3 * outward / np.linalg.norm(outward, axis=1, keepdims=True)
    both = concatenate([scene, toy.gaussians(below, 0.04, toy.RED)])
    selection = propagated(both, mask_of(both, np.append(part != toy.FLOOR, np.zeros(300, bool))))
    assert not selection[len(scene) :].any()
    assert selection[: len(scene)][part == toy.POLE].mean() > 0.9


def test_an_occluder_does_not_cut_a_hole_into_the_object():
    """A blue board before the ball's upper half: the mask lacks that half, the selection has it."""
    scene, part = toy.ball_on_pole(neighbour=False)
    steps = np.linspace(-1.2, 1.2, 49)
    y, z = (values.ravel() for values in np.meshgrid(steps, 4.0 + 0.4 * steps))
    board = toy.gaussians(np.stack([np.full_like(y, 3.0), y, z], axis=1), (0.02, 0.05, 0.05), toy.BLUE)
    both = concatenate([scene, board])
    ball = np.append(part == toy.BALL, np.zeros(len(board), bool))
    selection = propagated(both, mask_of(both, ball))
    assert not selection[len(scene) :].any()
    hidden = ball[: len(scene)] & (scene.means[:, 2] > 3.5)
    assert selection[: len(scene)][hidden].mean() > 0.9


def test_units_rotation_and_order_change_nothing(pole):
    scene, part = pole
    mask = mask_of(scene, part == toy.BALL)
    plain = propagated(scene, mask)
    order = np.random.default_rng(2).permutation(len(scene))
    assert toy.jaccard(propagated(scene.select(order), mask), plain[order]) > 0.99
    turned, scale = toy.any_rotation(), 40.0
    pose = CAMERA.world_to_camera.copy()
    pose[:3, :3] = pose[:3, :3] @ turned.T
    pose[:3, 3] *= scale
    camera = replace(CAMERA, world_to_camera=pose)
    moved = propagated(toy.moved(scene, turned, scale), mask, camera, turned @ toy.UP)
    check_ball(moved, scene, part)


def test_training_cameras_on_one_side(pole):
    """Where nobody looked from behind, the views do not either; what they do not show still follows its neighbours."""
    scene, part = pole
    selection = propagated(scene, mask_of(scene, part == toy.BALL), seen_from=[CAMERA])
    front = (part == toy.BALL) & (scene.means[:, 0] > 0)
    assert selection[front].mean() > 0.95
    assert selection[part == toy.NEIGHBOUR].mean() < 0.1


def test_masks_that_show_no_surface(pole):
    scene, _ = pole
    empty = np.zeros((CAMERA.height, CAMERA.width), bool)
    assert not propagated(scene, empty).any()
    sky = empty.copy()
    sky[:5, :5] = True
    assert not propagated(scene, sky).any()
