"""Tests of what the page says, and of what is drawn over."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import toy

from gaussian_trimmer.app.page import Action, Control, Gesture, Page
from gaussian_trimmer.cameras import Camera, Viewpoint, look_at
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.selecting.marks import Stroke
from gaussian_trimmer.selecting.shapes import drawn_over, in_spheres, under_stroke


class Gui:
    """What the page puts its elements on."""

    def add_html(self, content):
        return SimpleNamespace(content=content)

    def add_text(self, label, value):
        return SimpleNamespace(on_update=lambda act: setattr(self, "update", act))


@pytest.fixture
def page():
    """A page with a control of each kind and an action, and what was done by it."""
    page, done = Page(Gui()), []
    for name, value, facts in (
        ("tool", "Look", {"options": ("Look", "Click")}),
        ("radius", 24, {"limits": (3, 200)}),
        ("on", True, {}),
        ("name", "", {}),
    ):
        control = Control(page, name, value, **facts)
        control.changed = lambda tab, name=name: done.append((name, tab.client_id))
    page.offer([Action("go", lambda tab: done.append("go"), "G", lambda tab: done.append("end"))])
    page.drawn = lambda gesture, tab: done.append(gesture)
    page.changed_object = lambda *change: done.append(change[:3])
    page.done = done
    return page


def tell(page, *messages, client=7, first=1):
    """Have a tab say something; return what is done."""
    numbered = [{"number": first + place, **message} for place, message in enumerate(messages)]
    hear(page, "gesture:" + json.dumps(numbered), client)
    return page.done


def hear(page, text, client=7):
    page._hear(text, SimpleNamespace(client_id=client))


LASSO = {"tool": "Lasso", "places": [[0.1, 0.2], [1, 0]], "effect": "remove"}


def test_gestures_actions_controls_and_objects_are_heard_once(page):
    change = {"object": 3, "what": "name", "to": "mug"}
    messages = [LASSO, {"do": "go"}, {"do": "go", "ends": True}, {"set": "tool", "to": "Click"}, change]
    expected = [Gesture("Lasso", ((0.1, 0.2), (1.0, 0.0)), "remove"), "go", "end", ("tool", 7), (3, "name", "mug")]
    assert tell(page, *messages) == expected and page.controls["tool"].value == "Click"
    tell(page, *messages)  # the field has it still
    assert page.done == expected
    tell(page, *messages, {"do": "go"}, client=8)  # another tab
    assert page.done == [*expected, *[("tool", 8) if each == ("tool", 7) else each for each in expected], "go"]
    for client, (said, effect) in enumerate((("intersect", "intersect"), ("", None), ({}, None)), 9):
        drawn = LASSO | {"effect": said, "places": []}
        assert tell(page, drawn, client=client)[-1] == Gesture("Lasso", (), effect)


@pytest.mark.parametrize(
    "text",
    ["", "gesture:", "gesture:[]", "gesture:{}", "gesture:[1]", 'gesture:[{"do": "go"}]', "else",
     "gesture:" + "[" * 100_000, "gesture:" + json.dumps([{"number": 1, **LASSO, "places": [[0, 0]] * 100_000}])],
)  # fmt: skip
def test_nonsense_is_not_heard(page, text):
    hear(page, text)
    assert page.done == []


@pytest.mark.parametrize(
    "message",
    [{"set": "tool", "to": "Rake"}, {"set": "tool", "to": ["Look"]}, {"set": "radius", "to": 1e9},
     {"set": "radius", "to": float("nan")}, {"set": "radius", "to": "9"}, {"set": "on", "to": 1}, {"set": "nothing"},
     {"set": ["tool"]}, {"set": "name", "to": "n" * 5000}, {"do": "stop"}, {"do": {}}, {"object": "1"},
     LASSO | {"places": [[1]]}, LASSO | {"places": [[None, 2]]}, LASSO | {"places": 7},
     LASSO | {"places": [[float("nan"), 0]]}],
)  # fmt: skip
def test_what_cannot_be_is_not_taken(page, message):
    before = {name: control.value for name, control in page.controls.items()}
    assert tell(page, message, {"do": "go"}) == ["go"]
    assert {name: control.value for name, control in page.controls.items()} == before


def test_what_the_page_shows_is_text(page):
    page.show(said="<b onclick='x'>'/a'</b>")
    page.controls["name"].value = "'><script>"
    assert "<" not in page._state.content[len("<span") : -len("></span>")]
    assert page._state.content.count("'") == 2


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
