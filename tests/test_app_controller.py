"""Tests of controls and tools with a running server, to which no browser is connected."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest
import toy
from command_line import save_ball

from gaussian_trimmer.app import panels as controls
from gaussian_trimmer.cameras import look_at
from gaussian_trimmer.gaussians import quaternions_of
from gaussian_trimmer.selecting.marks import Box3D, Sphere

pytest.importorskip("viser", reason="needs viser: the app extra")
BALL = Sphere((0.0, 0.0, 1.0), 1.2)
TINY = Sphere((2.5, 2.5, 0.0), 0.3)
"""Beside the ball."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("ball")
    save_ball(path)
    return path


@pytest.fixture(scope="module")
def app():
    from gaussian_trimmer.app.serving import serving

    with serving(None, None, port=0) as running:
        yield running.controller


@pytest.fixture
def controller(app, folder):
    open_scene(app, folder / "scene.ply", folder / "cameras.json")
    return app


def open_scene(controller, path, camera_path=""):
    controller.panels.path.value, controller.panels.camera_path.value = str(path), str(camera_path)
    do(controller, controller.open)


def finish(controller):
    done = threading.Event()
    controller.worker.submit(done.set)
    assert done.wait(100)


def do(controller, act):
    controller.do("Testing", act)
    finish(controller)


def client(controller, eye=(0.0, -8.0, 4.0)):
    """A tab that looks at the ball."""
    pose = look_at(np.array(eye), toy.CENTRE, toy.UP)
    turn = quaternions_of(pose[:3, :3].T[None])[0]
    position = controller._view.frame.to_viewer(np.array(eye))
    camera = SimpleNamespace(position=position, wxyz=turn, fov=0.8, image_width=200, image_height=200, near=0.01)
    return SimpleNamespace(camera=camera, add_notification=lambda *arguments, **options: None)


def test_opening_starts_afresh(controller, folder):
    panels = controller.panels
    panels.part.value, panels.when.value, panels.tool.value = "Object", "After", controls.CLICK
    panels.show_command("of an earlier scene")
    open_scene(controller, folder / "scene.ply")
    assert (panels.part.value, panels.when.value, panels.tool.value) == ("Both", "Before", controls.LOOK)
    assert not panels.command.visible
    assert "press C and click" in panels.status_text


def test_the_box_in_space_is_of_lines_and_around_the_selection(controller):
    session, tools, view = controller.session, controller.tools, controller._view
    session.mark(BALL)
    before = session.now.object.selected.mask
    do(controller, lambda: tools.begin(controls.BOX3D, client(controller)))
    session.mark(view.box_mark(controller.panels.box_size.value, session.now.up.direction, "intersect"), TINY)
    assert (session.now.object.selected.mask & before).sum() == before.sum()  # it cuts nothing off
    edges = view._box[1].points
    assert edges.shape == (12, 2, 3)
    assert np.allclose(np.linalg.norm(edges[:, 0] - edges[:, 1], axis=1).max() / view.frame.scale, 2.2, atol=0.3)


def test_the_box_in_space_is_not_around_the_eye_where_nothing_is_selected(controller):
    do(controller, lambda: controller.tools.begin(controls.BOX3D, client(controller)))
    up = controller.session.now.up.direction
    box = controller._view.box_mark(controller.panels.box_size.value, up, "add")
    assert isinstance(box, Box3D)
    eye = controller.tools.viewpoint(client(controller)).camera.centre
    centre = controller._view.frame.to_scene(controller._view._box[0].position)
    assert np.linalg.norm(centre - eye) > 0.7 * np.linalg.norm(controller.panels.box_size.value)
    do(controller, lambda: controller.session.mark(box))
    assert controller.session.now.object.n_selected  # something is in it


def test_up_turns_the_view(controller):
    server = controller._server
    assert np.allclose(server.initial_camera.up, (0, 0, 1))
    do(controller, lambda: controller._set_up("-Y"))
    assert np.allclose(server.initial_camera.up, (0, -1, 0))
    do(controller, lambda: controller.step("Undo"))
    assert np.allclose(server.initial_camera.up, (0, 0, 1))


def test_the_object_alone_is_shown_in_its_own_colours_until_it_is_marked(controller):
    panels, tools = controller.panels, controller.tools
    do(controller, lambda: tools._mark(BALL))
    assert panels.overlays[controls.TINT]
    do(controller, lambda: controller.show_part("Object"))
    assert not panels.overlays[controls.TINT]
    do(controller, controller.trim)
    assert panels.when.value == "After" and not panels.overlays[controls.TINT]
    do(controller, lambda: tools._mark(TINY))
    assert panels.overlays[controls.TINT]
    do(controller, lambda: controller.show_part("Object"))
    do(controller, controller._toggle_tint)
    assert panels.overlays[controls.TINT]


def test_sentences_about_a_trim_go_with_it(controller, tmp_path):
    panels = controller.panels
    do(controller, lambda: controller.tools._mark(BALL))
    do(controller, controller.trim)
    assert "views accepted" in panels.summary.content
    panels.folder.value = str(tmp_path / "out")
    do(controller, controller._save)
    assert str(tmp_path / "out" / "selection.json") in panels.command.value and panels.command.visible
    do(controller, lambda: controller.step("Undo"))
    assert panels.summary.content == ""
    panels.folder.value = str(tmp_path / "all")
    do(controller, controller._save_all)
    assert (tmp_path / "all" / "object_1.ply").is_file()
    assert not panels.command.visible


def test_a_tool_without_a_scene_is_refused_and_leaves_no_sentence(folder):
    from gaussian_trimmer.app.serving import serving

    with serving(None, None, port=0) as app:
        controller = app.controller
        controller.tools.choose(controls.POINTS, None)
        finish(controller)
        assert controller.panels.tool.value == controls.LOOK
        open_scene(controller, folder / "scene.ply")
        controller.tools.choose(controls.POINTS, None)
        finish(controller)
        assert controller.panels.status_text == "Click three points on the ground."
        controller.tools.choose(controls.CLICK, None)
        finish(controller)
        assert "press C and click" in controller.panels.status_text
