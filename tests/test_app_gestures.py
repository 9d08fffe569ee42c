"""Tests of what the page says, of what is drawn over, and of Gaussians that are placed elsewhere."""

import json

import numpy as np
import pytest
import toy

from gaussian_trimmer.app.gestures import Gesture, parse_gesture
from gaussian_trimmer.cameras import Camera, look_at
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.selecting.marks import Stroke, Viewpoint
from gaussian_trimmer.selecting.strokes import drawn_over, under_stroke


def said(**changes):
    plain = {"tool": "Lasso", "places": [[0.1, 0.2], [1, 0]], "keys": "ctrl", "time": 5.0}
    return "gesture:" + json.dumps(plain | changes)


def test_gestures_are_understood():
    assert parse_gesture(said()) == Gesture("Lasso", ((0.1, 0.2), (1.0, 0.0)), "remove")
    assert parse_gesture(said(keys="both")).effect == "intersect"
    assert parse_gesture(said(keys="")).effect is None
    assert parse_gesture(said(places=[])).places == ()


@pytest.mark.parametrize(
    "text",
    ["", "gesture:", "gesture:[]", "else" + said(), said(places=[[1]]), said(places=[[None, 2]]), said(places=7),
     said(places=[[float("nan"), 0]]), said(places=[[0, 0]] * 100_000)],
)  # fmt: skip
def test_nonsense_is_no_gesture(text):
    assert parse_gesture(text) is None


def viewpoint(size=100):
    pose = look_at(np.array([0.0, -8, 1]), toy.CENTRE, toy.UP)
    return Viewpoint(Camera(pose, np.array([[size, 0, size / 2], [0, size, size / 2], [0, 0, 1]], float), size, size))


def test_masks_of_lines_and_outlines():
    def pixels(places, radius=None):
        return drawn_over(Stroke(viewpoint(), places, radius))[1].sum()

    assert pixels(((0.2, 0.2), (0.6, 0.2), (0.6, 0.6), (0.2, 0.6))) == pytest.approx(40**2, rel=0.06)
    assert pixels(((0.2, 0.5), (0.8, 0.5)), 5.0) == pytest.approx(60 * 10 + np.pi * 25, rel=0.15)
    assert pixels(((0.5, 0.5),), 5.0) == pytest.approx(np.pi * 25, rel=0.3)
    assert pixels(((-3.0, -3.0), (9.0, 9.0)), 5.0)  # outside the picture is no error


def under(scene, stroke, *, through=False, by_centres=False):
    return under_stroke(scene, stroke, through=through, by_centres=by_centres, renderer=get_renderer("numba"))


@pytest.mark.parametrize("by_centres", [False, True])
def test_the_brush_takes_the_surface_and_through_takes_all(by_centres):
    scene, _ = toy.ball_on_floor(n_floaters=0)
    stroke = Stroke(viewpoint(), ((0.5, 0.5),), 4.0)
    surface = under(scene, stroke, by_centres=by_centres)
    through = under(scene, stroke, through=True, by_centres=by_centres)
    assert surface.any() and (through & surface).sum() == surface.sum() < through.sum()
    assert scene.means[surface, 1].max() < 0 < scene.means[through, 1].max()
    pixels = stroke.view.camera.project(scene.means[through].astype(np.float64))[0]
    assert np.linalg.norm(pixels - 50, axis=1).max() < 5.5
    assert not under(scene, Stroke(viewpoint(), ((0.5, 0.02),), 1.0), by_centres=by_centres).any()


def test_by_footprint_a_gaussian_is_taken_where_it_shows():
    screen, behind = toy.gaussians([[-0.5, -4, 1]] * 3, (0.3, 0.02, 0.3), toy.BLUE), [[-0.5, 0, 1], [1.5, 0, 1]]
    scene = concatenate([screen, toy.gaussians(behind, (0.6, 0.02, 0.2), toy.RED, opacity=0.99)])
    right_of_screen = Stroke(viewpoint(), ((0.47, 0.3), (0.6, 0.3), (0.6, 0.7), (0.47, 0.7)))
    assert under(scene, right_of_screen).tolist() == [False] * 3 + [True, False]  # its centre is behind the screen
    assert not under(scene, right_of_screen, by_centres=True).any()
    middle = Stroke(viewpoint(), ((0.68, 0.5),), 1.0)
    assert under(scene, middle, by_centres=True).tolist() == [False] * 4 + [True]
    assert not under(scene, middle).any()  # it shows beside the stroke


def test_a_lasso_takes_no_more_than_it_surrounds_behind_the_camera_too():
    scene, _ = toy.ball_on_floor(n_floaters=0)
    pose = look_at(np.array([0.0, 0, 1]), np.array([0.0, 5, 1]), toy.UP)  # from within
    inside = Viewpoint(Camera(pose, viewpoint().camera.K, 100, 100))
    everywhere = Stroke(inside, ((-1.0, -1.0), (2.0, -1.0), (2.0, 2.0), (-1.0, 2.0)))
    taken = under(scene, everywhere, through=True)
    assert (scene.means[taken, 1] > 0).all()
