"""Tests of what the page says, and of what is drawn over."""

import json
import zlib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import toy

from gaussian_trimmer.app.page import Action, Control, Drag, Gesture, Page
from gaussian_trimmer.app.viewpoints import View
from gaussian_trimmer.cameras import Camera, Viewpoint, look_at
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.selecting.marks import Stroke
from gaussian_trimmer.selecting.shapes import drawn_over, in_spheres, under_stroke


@pytest.fixture
def page():
    """A page with a control of each kind and an action, and what was done by it."""
    page, done = Page(), []
    for name, value, facts in (
        ("tool", "Look", {"options": ("Look", "Click")}),
        ("radius", 24, {"limits": (3, 200)}),
        ("on", True, {}),
        ("name", "", {}),
    ):
        control = Control(page, name, value, **facts)
        control.changed = lambda tab, name=name: done.append((name, tab.number))
    page.offer([Action("go", lambda tab: done.append("go"), "G")])
    page.drawn = lambda gesture, tab: done.append(gesture)
    page.changed_object = lambda *change: done.append(change[:3])
    page.dragged_box = done.append
    page.done = done
    return page


def tab(number=7):
    told = []
    return SimpleNamespace(number=number, view=None, send=told.append, told=told)


def tell(page, *messages, client=None):
    """Have a tab say something; return what is done."""
    for message in messages:
        page.hear(json.dumps(message), client or tab())
    return page.done


LASSO = {"is": "gesture", "tool": "Lasso", "places": [[0.1, 0.2], [1, 0]], "effect": "remove"}
VIEW = {"eye": [0, -5, 1], "target": [0, 0, 0], "up": [0, 0, 1], "fov": 0.8, "width": 300, "height": 200}


def test_gestures_actions_controls_objects_and_the_box_are_heard(page):
    change = {"is": "alter", "object": 3, "what": "name", "value": "mug"}
    drag = {"is": "drag", "low": [0, 0, 0], "high": [1, 2, 3]}
    chosen = {"is": "enter", "control": "tool", "value": "Click"}
    expected = [Gesture("Lasso", ((0.1, 0.2), (1.0, 0.0)), "remove"), "go", ("tool", 7), (3, "name", "mug")]
    done = tell(page, LASSO, {"is": "do", "action": "go"}, chosen, change, drag)
    assert done == [*expected, Drag((0, 0, 0), (1, 2, 3))] and page.controls["tool"].value == "Click"
    looking = tab()
    tell(page, LASSO | {"effect": None, "ghost": True, "view": VIEW}, client=looking)
    assert page.done[-1].ghost and looking.view == View((0, -5, 1), (0, 0, 0), (0, 0, 1), 0.8, 300, 200)
    page.hear(json.dumps(LASSO).encode() + b"\0" + zlib.compress(b"bits"), looking)
    assert page.done[-1].rows == b"bits"


def test_tabs_are_told_what_changes_and_new_ones_everything(page):
    first, second = tab(), tab()
    page.welcome(first)
    page.controls["radius"].value = 30
    page.show(said="<b onclick='x'>'/a'</b>")
    page.show(said="<b onclick='x'>'/a'</b>")
    radius = {"=radius": {"value": 30, "limits": [3, 200]}}
    assert [each["state"] for each in first.told[1:]] == [radius, {"said": "<b onclick='x'>'/a'</b>"}]
    page.welcome(second)
    assert set(second.told[0]["state"]) == {"=tool", "=radius", "=on", "=name", "keys", "said"}
    page.forget(first)
    page.show(said="gone")
    assert len(first.told) == 3 and second.told[-1] == {"state": {"said": "gone"}}


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", "[1]", '{"do": "go"}', "else", "[" * 100_000, b"", b"\xff\0x", json.dumps(LASSO).encode() + b"\0x",
     json.dumps(LASSO | {"places": [[0, 0]] * 1_000_000})],
)  # fmt: skip
def test_nonsense_is_not_heard(page, text):
    page.hear(text, tab())
    assert page.done == []


@pytest.mark.parametrize(
    "message",
    [{"is": "enter", "control": "tool", "value": "Rake"}, {"is": "enter", "control": "tool", "value": ["Look"]},
     {"is": "enter", "control": "radius", "value": 1e9}, {"is": "enter", "control": "radius", "value": float("nan")},
     {"is": "enter", "control": "radius", "value": "9"}, {"is": "enter", "control": "on", "value": 1},
     {"is": "enter", "control": "nothing", "value": 1}, {"is": "enter", "control": ["tool"], "value": 1},
     {"is": "enter", "control": "name", "value": "n" * 5000}, {"is": "do", "action": "stop"},
     {"is": "do", "action": {}},
     {"is": "alter", "object": "1", "what": "name", "value": ""}, {"is": ["do"], "action": "go"},
     {"is": "do", "action": "go", "more": 1}, {"is": "do", "action": "go", "view": VIEW | {"width": 0}},
     {"is": "drag", "low": [0, 0], "high": [1, 1, 1]}, LASSO | {"places": [[1]]}, LASSO | {"places": [[None, 2]]},
     LASSO | {"places": 7}, LASSO | {"places": [[float("nan"), 0]]}, LASSO | {"effect": "paint"}],
)  # fmt: skip
def test_what_cannot_be_is_not_taken(page, message):
    before = {name: control.value for name, control in page.controls.items()}
    assert tell(page, message, {"is": "do", "action": "go"}) == ["go"]
    assert {name: control.value for name, control in page.controls.items()} == before


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
    return under_stroke(scene, stroke, through=through, by_centres=by_centres)


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


def test_the_sphere_takes_what_is_near_the_surface_and_nothing_behind_its_edge():
    x, z = (grid.ravel() for grid in np.meshgrid(np.linspace(-2, 2, 81), np.linspace(-1, 3, 81)))
    front, back = np.stack([x, 0 * x, z], 1)[x < 0], np.stack([x, 3 + 0 * x, z], 1)
    scene = toy.gaussians(np.concatenate([front, back]), (0.05, 0.02, 0.05), toy.RED)
    near = np.arange(len(scene)) < len(front)
    stroke = Stroke(viewpoint(), ((0.49, 0.5),), 4.0)  # its ring reaches over the edge
    taken = in_spheres(scene, stroke)
    assert under(scene, stroke)[~near].any() and not taken[~near].any()
    middle = np.array([-0.04, 0.0, 0.96])  # of the pixel
    distances = np.linalg.norm(scene.means - middle, axis=1)
    assert taken[distances < 0.28].all() and not taken[distances > 0.45].any()
    longer = in_spheres(scene, replace(stroke, places=((0.49, 0.5), (0.3, 0.5))))
    assert (longer & taken).sum() == taken.sum() < longer.sum()
    assert not in_spheres(scene, replace(stroke, places=((0.5, 0.01),))).any()


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
