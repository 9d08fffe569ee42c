"""Tests of controls and tools with a running server, to which no browser is connected."""

import io
import threading
import zipfile
from types import SimpleNamespace

import made_room as room
import numpy as np
import pytest
import toy
from command_line import save_ball

from gaussian_trimmer import formats
from gaussian_trimmer.app import panels as controls
from gaussian_trimmer.app.display import Showing, shown_rows
from gaussian_trimmer.app.gestures import STILL_TAKEN, Gesture
from gaussian_trimmer.app.wipe import compared
from gaussian_trimmer.cameras import look_at
from gaussian_trimmer.gaussians import quaternions_of
from gaussian_trimmer.geometry.bounds import up_frame
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
def app(tmp_path_factory):
    from gaussian_trimmer.app.serving import serving

    with serving(None, None, port=0, state=tmp_path_factory.mktemp("state")) as running:
        yield running.controller


@pytest.fixture
def controller(app, folder):
    open_scene(app, folder / "scene.ply", folder / "cameras.json")
    if app.session.now.has_work:
        do(app, lambda: app.step("Undo"))  # the work of the test before
    return app


def open_scene(controller, path, camera_path=""):
    controller.panels.path.value, controller.panels.camera_path.value = str(path), str(camera_path)
    do(controller, controller.open)


def finish(controller):
    controller.worker._thread.submit(lambda: None).result(100)  # without stopping what gives way


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


def gesture(tool, *places, effect=None):
    return Gesture(tool, places, effect)


def do_gesture(controller, *arguments, **options):
    given = gesture(*arguments, **options)
    controller.panels.tool.value = given.tool
    controller.tools.heard(given, client(controller))
    finish(controller)
    finish(controller)  # the trim that follows


def select_ball(controller, *marks):
    do(controller, lambda: controller.session.mark(BALL, *marks))


def test_opening_starts_afresh_but_for_the_work_that_was_kept(controller, folder):
    panels = controller.panels
    select_ball(controller)
    panels.part.value, panels.when.value, panels.tool.value = controls.OBJECT, "After", controls.CLICK
    panels.show_command("of an earlier scene")
    open_scene(controller, folder / "scene.ply")
    assert (panels.part.value, panels.when.value, panels.tool.value) == (controls.EVERYTHING, "Before", controls.LOOK)
    assert not panels.command.visible
    assert "Your work is back" in panels.status_text
    assert controller.session.now.object.marks == (BALL,)
    do(controller, lambda: controller.step("Undo"))
    assert not controller.session.now.has_work
    open_scene(controller, folder / "scene.ply")
    assert "click on the object" in panels.status_text


def test_the_box_in_space_is_of_lines_and_around_the_selection(controller):
    session, tools, view = controller.session, controller.tools, controller._view
    session.mark(BALL)
    before = session.now.object.selected.mask
    do(controller, lambda: tools.begin(controls.BOX3D, client(controller)))
    session.mark(view.box_mark(session.now.up.direction, "intersect"), TINY)
    assert (session.now.object.selected.mask & before).sum() == before.sum()  # it cuts nothing off
    edges = view._box._edges.points
    assert edges.shape == (12, 2, 3)
    assert np.allclose(np.linalg.norm(edges[:, 0] - edges[:, 1], axis=1).max() / view.frame.scale, 2.2, atol=0.3)


def test_what_was_cut_out_is_cut_out_again_when_the_scene_is_opened_again(controller, folder):
    session, panels = controller.session, controller.panels
    select_ball(controller)
    do(controller, controller.cut_out)
    first, marked = session.now.object.result, session.now.object.n_selected
    do(controller, lambda: controller.change_objects("New"))
    open_scene(controller, folder / "scene.ply", folder / "cameras.json")
    finish(controller)
    again = session.now.objects[0].result
    assert again is not first and session.now.objects[0].n_selected == marked
    assert np.array_equal(again.only.source_index, first.only.source_index)
    assert np.array_equal(again.object.means, first.object.means)
    assert "What you had cut out is back: 1 object." in panels.status_text
    do(controller, lambda: controller.step("Undo"))
    assert not session.now.has_work  # it was one step


def test_what_is_to_be_cut_out_again_is_so_after_another_restart_too(controller, folder):
    session = controller.session
    select_ball(controller)
    do(controller, controller.cut_out)
    follow, controller._follow = controller._follow, lambda client: None  # the program ends before it comes to it
    try:
        for _ in range(2):
            open_scene(controller, folder / "scene.ply", folder / "cameras.json")
            assert session.now.object.result is None and session.now.object.to_cut_out
            assert "is being cut out again" in controller.panels.status_text
    finally:
        controller._follow = follow
    do(controller, lambda: session.mark(TINY) and "")
    finish(controller)
    assert session.now.object.result is None  # another mark: no longer what was cut out


def test_a_face_of_the_box_in_space_is_dragged_and_the_opposite_one_stays(controller):
    session, view, panels = controller.session, controller._view, controller.panels
    session.mark(BALL)
    do(controller, lambda: controller.tools.begin(controls.BOX3D, client(controller)))
    up, before = session.now.up.direction, view.box_mark(session.now.up.direction, "add")
    axes = up_frame(up)
    for number, axis, end in ((0, 0, "low"), (5, 2, "high")):
        face = np.array(getattr(before, end)) @ axes
        sign = 1 if end == "high" else -1
        view._box.drag_face(number, view.frame.to_viewer(face + sign * 0.5 * axes[axis]))
        after = view.box_mark(up, "add")
        moved = np.array(getattr(after, end)) - getattr(before, end)
        assert np.allclose(moved, sign * 0.5 * np.eye(3)[axis], atol=1e-5)
        other = "low" if end == "high" else "high"
        assert np.allclose(getattr(after, other), getattr(before, other), atol=1e-5)
        assert np.allclose(panels.box_size.value, np.array(after.high) - after.low, atol=1e-4)
        before = after
    view._box.drag_face(5, view.frame.to_viewer(np.array(before.low) @ axes - 3 * axes[2]))  # past the other face
    flat = view.box_mark(up, "add")
    assert before.low[2] == pytest.approx(flat.low[2], abs=1e-5) and flat.high[2] > flat.low[2]


def test_the_box_in_space_is_not_around_the_eye_where_nothing_is_selected(controller):
    do(controller, lambda: controller.tools.begin(controls.BOX3D, client(controller)))
    up = controller.session.now.up.direction
    box = controller._view.box_mark(up, "add")
    assert isinstance(box, Box3D)
    eye = controller.tools.viewpoint(client(controller)).camera.centre
    centre = controller._view.frame.to_scene(controller._view._box.centre)
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


def test_cutting_out_shows_the_object_alone_in_its_own_colours(controller):
    panels = controller.panels
    select_ball(controller)
    do(controller, controller.cut_out)
    assert panels.showing == Showing("object", "after", "own")
    do(controller, lambda: controller.show_part(controls.WITHOUT))
    assert panels.showing == Showing("background", "after", "own")
    do(controller, lambda: controller.show_part(controls.EVERYTHING))
    assert panels.showing == Showing("both", "after", "objects")
    do(controller, lambda: controller.step("Undo"))
    assert panels.showing == Showing("both", "before", "objects")


def test_the_scene_without_the_object_is_one_button_away(controller):
    select_ball(controller)
    do(controller, lambda: controller.show_part(controls.WITHOUT))
    assert controller.session.now.object.result is not None
    assert controller.panels.showing == Showing("background", "after", "own")


def test_two_states_are_compared_until_something_else_is_done(controller):
    panels, tab = controller.panels, client(controller)

    def page_has_its_picture():
        controller._heard(gesture(STILL_TAKEN), tab)
        finish(controller)

    def wipe():
        controller.switch_wipe(tab)
        finish(controller)

    select_ball(controller)
    wipe()
    assert "cut the object out first" in panels.status_text and not panels.compare[controls.WIPE]
    do(controller, controller.cut_out)
    shown = panels.showing
    wipe()
    assert panels.compare[controls.WIPE] and panels.compared is None  # until there is a picture
    page_has_its_picture()
    assert panels.compared == Showing("object", "before", "own")
    assert panels.showing == shown  # which marks and results go by
    wipe()
    assert panels.compared is None and not panels.compare[controls.WIPE]
    page_has_its_picture()  # too late
    assert panels.compared is None
    do(controller, lambda: controller.show_part(controls.WITHOUT))
    wipe()
    page_has_its_picture()
    assert panels.compared == Showing("both", "before", "own")
    controller._moved(tab)
    finish(controller)
    assert panels.compared is None and "views accepted" in panels.status_text
    wipe()
    page_has_its_picture()
    do(controller, lambda: controller.step("Undo"))
    assert panels.compared is None and not panels.compare[controls.WIPE]


@pytest.mark.parametrize(
    ("shown", "other", "is_left"),
    [
        (Showing("object", "before", "changes"), Showing("object", "after", "changes"), True),
        (Showing("object", "after", "own"), Showing("object", "before", "own"), False),
        (Showing("background", "after", "changes"), Showing("both", "before", "own"), False),
        (Showing("both", "before", "objects"), Showing("background", "after", "own"), True),
    ],
)
def test_what_is_before_is_at_the_left(shown, other, is_left):
    comparison = compared(shown)
    assert (comparison.other, comparison.still.is_left) == (other, is_left)


def test_a_correction_of_what_was_cut_out_is_cut_out_again_and_is_one_step(controller):
    session, panels = controller.session, controller.panels
    select_ball(controller)
    do(controller, controller.cut_out)
    before = session.now
    panels.brush.value = 20
    do_gesture(controller, controls.BRUSH, (0.5, 0.45), (0.55, 0.45), effect="remove")
    assert session.now.object.n_selected < before.object.n_selected
    assert session.now.object.result is not None
    assert not (session.now.object.result.object_mask & session.now.object.selected.excluded).any()
    assert panels.showing == Showing("object", "after", "own")
    do(controller, lambda: controller.step("Undo"))
    assert session.now is before


def test_marks_made_meanwhile_go_before_the_trim_that_follows(controller):
    session, panels = controller.session, controller.panels
    select_ball(controller)
    do(controller, controller.cut_out)
    panels.tool.value = controls.BRUSH
    blocked = threading.Event()
    controller.worker.submit(lambda: blocked.wait(50))
    tab = client(controller)
    for x in (0.42, 0.58):
        controller.tools.heard(gesture(controls.BRUSH, (x, 0.45), effect="remove"), tab)
    blocked.set()
    finish(controller)
    finish(controller)
    assert len(session.now.object.marks) == 3
    assert session.now.object.result is not None
    do(controller, lambda: controller.step("Undo"))
    assert session.now.object.earlier is not None  # of the first stroke, which was not trimmed


def test_lasso_polygon_and_brush_take_what_they_are_drawn_over(controller):
    session = controller.session
    line = ((0.3, 0.3), (0.7, 0.3), (0.7, 0.7), (0.3, 0.7))
    numbers = {}
    for tool in (controls.LASSO, controls.POLYGON):
        for reach in ("Surface", controls.THROUGH):
            controller.panels.reach.value = reach
            do_gesture(controller, tool, *line)
            numbers[tool, reach] = session.now.object.n_selected
            assert session.now.object.marks[-1].tool == tool.lower()
            do(controller, lambda: controller.step("Undo"))
    controller.panels.reach.value = "Surface"
    assert numbers[controls.LASSO, "Surface"] == numbers[controls.POLYGON, "Surface"]
    assert 0 < numbers[controls.LASSO, "Surface"] <= numbers[controls.LASSO, controls.THROUGH]


def test_marks_reach_nothing_that_is_not_shown(controller):
    session, panels = controller.session, controller.panels
    select_ball(controller)
    before = session.now.object.selected.mask
    panels.look_at(controls.OBJECT, "Before", controls.OWN)
    panels.reach.value, panels.effect.value = controls.THROUGH, "Add"
    do_gesture(controller, controls.LASSO, (0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
    assert "changes nothing that is shown" in panels.status_text
    do(controller, lambda: controller.tools._mark(Sphere((0, 0, 1), 9.0)))
    assert np.array_equal(session.now.object.selected.mask, before)
    panels.reach.value = "Surface"


def test_keys_of_the_page_change_the_brush(controller):
    controller.panels.brush.value = 24
    controller.tools.heard(Gesture("]", (), None), client(controller))
    assert controller.panels.brush.value == 30
    controller.tools.heard(Gesture("[", (), None), client(controller))
    assert controller.panels.brush.value == 24


def test_a_name_is_the_objects_as_soon_as_it_is_entered(controller):
    controller.panels.name.value = " my  ball "
    controller._describe()
    finish(controller)
    assert controller.session.now.object.name == "my ball"
    assert controller.panels.name.value == " my  ball "  # somebody may go on typing
    controller.panels.name.value = ""
    controller._describe()
    finish(controller)
    assert controller.session.now.object.name == "my ball"


def test_files_from_the_browser_are_taken_for_what_they_are(controller, folder, tmp_path):
    session, files = controller.session, controller.files
    mask = np.linalg.norm(session.document.scene.means - toy.CENTRE, axis=1) < 1.2
    np.save(tmp_path / "ball.npy", mask)
    do(controller, lambda: files.received("../ball.npy", (tmp_path / "ball.npy").read_bytes()))
    assert np.array_equal(session.now.object.selected.mask, mask)
    sent = []
    tab = SimpleNamespace(send_file_download=lambda name, data, save_immediately: sent.append((name, data)))
    do(controller, lambda: files.download_project(tab))
    do(controller, lambda: controller.step("Clear"))
    do(controller, lambda: files.received(*sent[0]))
    assert np.array_equal(session.now.object.selected.mask, mask)
    do(controller, lambda: files.received("cameras.json", (folder / "cameras.json").read_bytes()))
    assert "has these cameras now" in controller.panels.status_text
    scene = (folder / "scene.ply").read_bytes()
    do(controller, lambda: files.received("other.ply", scene, as_scene=True))
    assert session.document.path.name == "other.ply"
    assert np.array_equal(session.now.object.selected.mask, mask)  # the work on what the scene holds, wherever it lies
    do(controller, lambda: files.received("nonsense.npy", b"nothing"))
    assert "nonsense.npy" in controller.panels.status_text


def test_results_are_downloaded(controller, tmp_path):
    sent = {}
    tab = SimpleNamespace(
        add_notification=lambda *arguments, **options: None,
        send_file_download=lambda name, data, save_immediately: sent.update({name: data}),
    )
    do(controller, lambda: controller.files.download(controls.OBJECT, tab))
    assert "press 'Cut out' first" in controller.panels.status_text
    select_ball(controller)
    do(controller, lambda: controller.session.describe_object("my ball", (1, 2, 3)))
    do(controller, controller.cut_out)
    for what in controls.DOWNLOADS:
        do(controller, lambda what=what: controller.files.download(what, tab))
    assert set(sent) == {"my_ball.ply", "without_my_ball.ply", "my_ball.zip", "my_ball.html"}
    (tmp_path / "object.ply").write_bytes(sent["my_ball.ply"])
    assert len(formats.read(tmp_path / "object.ply")) == len(controller.session.now.object.result.object)
    with zipfile.ZipFile(io.BytesIO(sent["my_ball.zip"])) as archive:
        assert {"my_ball/object.ply", "my_ball/report.json", "my_ball/selection.json"} <= set(archive.namelist())
    controller.panels.placed[controls.UPRIGHT] = True
    do(controller, lambda: controller.files.download(controls.OBJECT, tab))
    controller.panels.placed[controls.UPRIGHT] = False
    (tmp_path / "upright.ply").write_bytes(sent["my_ball.ply"])
    means = formats.read(tmp_path / "upright.ply").means
    assert abs(np.quantile(means[:, 1], 0.01)) < 0.01 and np.median(means[:, 1]) > 0.5


def test_what_is_hidden_is_not_shown_and_not_marked(controller):
    session = controller.session
    select_ball(controller)
    ball = session.now.object.selected.mask
    do(controller, controller.hide)
    assert not (shown_rows(session.now, controller.panels.showing) & ball).any()
    do(controller, lambda: controller.change_objects("New"))
    do(controller, lambda: session.mark(Sphere((0, 0, 1), 9.0)))
    assert not (session.now.object.selected.mask & ball).any()
    do(controller, lambda: controller.change_objects("Show all"))
    assert shown_rows(session.now, controller.panels.showing).all()


def test_sentences_about_a_trim_go_with_it(controller, tmp_path):
    panels = controller.panels
    select_ball(controller)
    do(controller, controller.cut_out)
    assert "views accepted" in panels.summary.content
    panels.folder.value = str(tmp_path / "out")
    do(controller, controller.files.save)
    assert str(tmp_path / "out" / "selection.json") in panels.command.value and panels.command.visible
    do(controller, lambda: controller.step("Undo"))
    assert panels.summary.content == ""
    panels.folder.value = str(tmp_path / "all")
    do(controller, controller.files.save_all)
    assert (tmp_path / "all" / "object_1.ply").is_file()
    assert not panels.command.visible


@pytest.fixture(scope="module")
def furnished(tmp_path_factory):
    """A red box, and a blue ball that stands apart: the folder, and the part that each Gaussian is of, (N,)."""
    box, ball = room.box((0, -0.9), (0.8, 0.8, 1.0), room.RED, 1), room.ball((0.3, 1.2), 0.5, room.BLUE, 2)
    scene, part = room.scene_of(room.floor(), room.wall(), box, ball)
    folder = tmp_path_factory.mktemp("room")
    room.save(scene, room.cameras(), folder)
    return folder, part


def test_objects_are_found_shown_and_saved_and_are_one_step(app, furnished, tmp_path):
    folder, part = furnished
    open_scene(app, folder / "scene.ply", folder / "cameras.json")
    session, panels = app.session, app.panels
    before = session.now
    panels.look_at(controls.OBJECT, "Before", controls.OWN)
    do(app, app.find_objects)
    assert panels.status_text.startswith("Found 2 objects")
    assert panels.showing == Showing("both", "before", "objects")
    found = session.now.objects
    assert [each.name for each in found] == ["object 1", "object 2"]
    assert found[0].colour != found[1].colour
    for number in (2, 3):
        assert max(toy.jaccard(each.selected.mask, part == number) for each in found) > 0.8
    do(app, app.find_objects)
    assert "Left out: 2 marked already" in panels.status_text
    assert session.now.objects == found
    do(app, lambda: app.change_objects("Delete"))
    panels.folder.value = str(tmp_path / "all")
    do(app, app.files.save_all)
    assert [path.name for path in sorted((tmp_path / "all").glob("object_*.ply"))] == ["object_2.ply"]
    do(app, app.find_objects)
    assert session.now.objects[0] is found[1]
    np.testing.assert_array_equal(session.now.object.selected.mask, found[0].selected.mask)
    assert session.now.object.id == 3  # no other object has had it
    for _ in range(3):
        do(app, lambda: app.step("Undo"))
    assert session.now is before


def test_finding_objects_is_cancelled(app, furnished):
    open_scene(app, furnished[0] / "scene.ply", furnished[0] / "cameras.json")
    before, stages = app.session.now, []

    def busy(doing, share):
        stages.append(doing)
        if "3/" in doing:
            app.worker.cancel()

    shown, app.panels.busy = app.panels.busy, busy
    try:
        do(app, app.find_objects)
    finally:
        app.panels.busy = shown
    assert "Cancelled" in app.panels.status_text
    assert app.session.now is before
    assert not any("surfaces" in stage for stage in stages)


def test_a_tool_without_a_scene_is_refused_and_leaves_no_sentence(folder, tmp_path):
    from gaussian_trimmer.app.serving import serving

    with serving(None, None, port=0, state=tmp_path) as app:
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
        assert "click on the object" in controller.panels.status_text
