"""Tests of what the page says, of what is drawn over, and of Gaussians that are placed elsewhere."""

import json

import numpy as np
import pytest
import toy

from gaussian_trimmer.app.gestures import Gesture, parse_gesture
from gaussian_trimmer.app.viewpoints import drawn_mask, rows_drawn
from gaussian_trimmer.cameras import Camera, look_at
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.selecting.marks import Viewpoint


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
    camera = viewpoint().camera
    square = ((0.2, 0.2), (0.6, 0.2), (0.6, 0.6), (0.2, 0.6))
    assert drawn_mask(camera, square, None).sum() == pytest.approx(40**2, rel=0.06)
    stroke = drawn_mask(camera, ((0.2, 0.5), (0.8, 0.5)), 5.0)
    assert stroke.sum() == pytest.approx(60 * 10 + np.pi * 25, rel=0.15)
    assert drawn_mask(camera, ((0.5, 0.5),), 5.0).sum() == pytest.approx(np.pi * 25, rel=0.3)
    assert drawn_mask(camera, ((-3.0, -3.0), (9.0, 9.0)), 5.0).any()  # outside the picture is no error


def test_the_brush_takes_the_surface_and_through_takes_all():
    scene, _ = toy.ball_on_floor(n_floaters=0)
    view, renderer = viewpoint(), get_renderer("numba")
    place = [(0.5, 0.5)]
    surface = rows_drawn(scene, view, place, radius=4.0, through=False, renderer=renderer)
    through = rows_drawn(scene, view, place, radius=4.0, through=True, renderer=renderer)
    assert surface.any() and (through & surface).sum() == surface.sum() < through.sum()
    assert scene.means[surface, 1].max() < 0 < scene.means[through, 1].max()
    pixels = view.camera.project(scene.means[through].astype(np.float64))[0]
    assert np.linalg.norm(pixels - 50, axis=1).max() < 5.5
    with pytest.raises(InputError, match="Nothing that is shown"):
        rows_drawn(scene, view, [(0.5, 0.02)], radius=1.0, through=False, renderer=renderer)


def test_a_lasso_takes_no_more_than_it_surrounds_behind_the_camera_too():
    scene, _ = toy.ball_on_floor(n_floaters=0)
    pose = look_at(np.array([0.0, 0, 1]), np.array([0.0, 5, 1]), toy.UP)  # from within
    inside = Viewpoint(Camera(pose, viewpoint().camera.K, 100, 100))
    everywhere = ((-1.0, -1.0), (2.0, -1.0), (2.0, 2.0), (-1.0, 2.0))
    taken = rows_drawn(scene, inside, everywhere, radius=None, through=True, renderer=get_renderer("numba"))
    assert (scene.means[taken, 1] > 0).all()
