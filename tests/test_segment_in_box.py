"""Tests of segmenting what a box in one view holds."""

import numpy as np
import pytest
import toy
from test_clicks import camera_at
from test_propagation import CAMERA, check_ball, mask_of

from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.selecting.clicks import select_by_box
from gaussian_trimmer.selecting.segment_in_box import segment_in_box
from gaussian_trimmer.views import bounding_box

RENDERER = get_renderer("numba")


@pytest.fixture(scope="module")
def pole():
    return toy.ball_on_pole()


def box_around(mask, margin=2):
    x0, y0, x1, y1 = bounding_box(mask)
    height, width = mask.shape
    return max(x0 - margin, 0), max(y0 - margin, 0), min(x1 + margin, width), min(y1 + margin, height)


def segmented(scene, box, camera=CAMERA, **options):
    return segment_in_box(scene, camera, box, toy.UP, RENDERER, **options)


@pytest.mark.parametrize("position", [(7, 0, 4.5), (6, 3, 3), (6, -2, 6)])
def test_a_ball_on_a_pole_gets_its_back_without_the_neighbour(pole, position):
    scene, part = pole
    camera = camera_at(position, toy.POLE_TOP)
    found = segmented(scene, box_around(mask_of(scene, part == toy.BALL, camera)), camera)
    check_ball(found.selection, scene, part)
    assert found.overlap > 0.8
    assert 0 < found.score <= 1


def test_the_command_of_users_takes_it_as_a_part(pole):
    scene, part = pole
    pick = select_by_box(scene, CAMERA, box_around(mask_of(scene, part == toy.BALL)), toy.UP, RENDERER)
    assert pick.ways == ("part",)
    check_ball(pick.selection, scene, part)


def test_a_thin_thing_far_before_a_wall():
    """Most of the box shows the wall: its surface and the wand's are searched each for itself."""
    steps = np.linspace(-6, 6, 121)
    y, z = (values.ravel() for values in np.meshgrid(steps, steps))
    wall = toy.gaussians(np.stack([np.full_like(y, -8.0), y, z], axis=1), (0.02, 0.08, 0.08), toy.WHITE)
    along = np.linspace(-1, 1, 400)
    rng = np.random.default_rng(0)
    wand = np.stack([np.zeros(400), along, along], axis=1) + rng.normal(0, 0.03, (400, 3))
    scene = concatenate([wall, toy.gaussians(wand, 0.03, toy.WHITE)])
    truth = np.arange(len(scene)) >= len(wall)
    camera = camera_at((6, 0, 0.5), (0, 0, 0))
    found = segmented(scene, box_around(mask_of(scene, truth, camera)), camera)
    assert toy.jaccard(found.selection, truth) > 0.9


def test_a_thing_that_leaves_the_picture_is_followed_beyond_it():
    scene, part = toy.ball_on_pole(neighbour=False)
    camera = camera_at((7, 0, 4.5), toy.POLE_TOP + np.array([0, 0, -2.7]))
    mask = mask_of(scene, part == toy.BALL, camera)
    box = box_around(mask)
    assert box[1] == 0
    found = segmented(scene, box, camera)
    assert toy.jaccard(found.selection, part == toy.BALL) > 0.85


def test_a_tight_box_means_no_more_than_what_is_in_it(pole):
    """Half of the ball in a box: nothing that is seen outside of it."""
    scene, part = pole
    x0, y0, x1, y1 = box_around(mask_of(scene, part == toy.BALL))
    found = segmented(scene, (x0, y0, (x0 + x1) // 2, y1))
    pixels, _ = CAMERA.project(scene.means[found.selection].astype(np.float64))
    assert (pixels[:, 0] < (x0 + x1) // 2).all()


def test_an_empty_box(pole):
    scene, _ = pole
    assert segmented(scene, (0, 0, 12, 12)) is None
