"""The app in a real browser. One short way through it is in every run; the others take minutes and are slow."""

import base64
from pathlib import Path

import numpy as np
import pytest
import toy
from browser import Tab, chromium, until

from gaussian_trimmer import formats, sample
from gaussian_trimmer.app import edits
from gaussian_trimmer.app.viewpoints import Event

pytestmark = pytest.mark.needs("browser", "starlette")

UP = np.array([0, 0, 0.16])
SHOWN = 16_000
"""Gaussians that are shown: software rendering of all of them takes seconds."""
SMALL = (1000, 640)


@pytest.fixture(scope="module")
def running_browser():
    with chromium() as opened:
        yield opened


@pytest.fixture
def browser(running_browser):
    """The browser, whose pages are closed after each test: what nobody looks at is drawn, too, and takes its time."""
    yield running_browser
    for context in running_browser.contexts:
        context.close()


@pytest.fixture(scope="module")
def lighthouse():
    """A point in the middle of the lighthouse."""
    scene = formats.read(sample.SCENE)
    points = scene.means[np.load(sample.SELECTION)]
    return np.median(points, axis=0).astype(float)


@pytest.fixture
def app(tmp_path):
    from gaussian_trimmer.app.serving import serving

    with serving(sample.SCENE, sample.CAMERAS, port=0, most=SHOWN, state=tmp_path / "state") as running:
        yield running


def click(tab, point, **options):
    x, y = tab.place(point)
    tab.page.mouse.click(x, y, **options)


def drag(tab, *places):
    """Press at the first place of the page, move over the others, and let go."""
    tab.page.mouse.move(*places[0])
    tab.page.mouse.down()
    for place in places[1:]:
        tab.page.mouse.move(*place, steps=4)
    tab.page.mouse.up()


def around(tab, point, size):
    """The corners of a square around a point, in pixels of the page."""
    x, y = tab.place(point)
    return [(x - size, y - size), (x + size, y - size), (x + size, y + size), (x - size, y + size)]


def marked(tab, lighthouse):
    """Mark the lighthouse by a click."""
    if tab.app.controller.panels.tool.value != "Click":
        tab.press("Click")
        tab.wait("Click on the object")
    tab.until_said(lambda: click(tab, lighthouse), "an object that stands on a surface")


def finish(app):
    until(lambda: not app.controller.jobs.worker.busy, "the program to finish")


@pytest.mark.smoke
def test_who_sees_the_app_for_the_first_time_cuts_the_sample_out(browser, lighthouse, tmp_path):
    """Only with what the page itself says: open, click, cut out, and download."""
    from gaussian_trimmer.app.serving import serving

    with serving(None, None, port=0, most=SHOWN, state=tmp_path) as app:
        tab = Tab(browser, app, *SMALL)
        tab.wait("Cut one object out of a splat scene.")
        tab.press("Open the sample")
        tab.wait("and click on the object that you want")
        marked(tab, lighthouse)
        tab.press("Cut out")
        tab.wait("is cut out:")
        assert app.controller.panels.showing.part == "Object"
        with tab.page.expect_download() as download:
            tab.press("Download: Object")
        download.value.save_as(tmp_path / "object.ply")
        assert len(formats.read(tmp_path / "object.ply")) == len(app.controller.session.now.object.fresh.object)
        assert tab.errors == []


@pytest.mark.slow
def test_an_object_is_cut_out_corrected_where_it_is_seen_and_saved(browser, app, lighthouse, tmp_path):
    panels, session = app.controller.panels, app.controller.session
    tab = Tab(browser, app, 1280, 720)
    tab.wait("59,472 Gaussians")
    below = lighthouse - 0.4 * UP  # where no handle of the box is
    before = tab.until_colour(below, lambda colour: colour.max() > 50)
    marked(tab, lighthouse)
    tinted = tab.until_colour(below, lambda colour: np.abs(colour - before).max() > 25)

    tab.page.keyboard.press("t")
    tab.page.locator("[role=status]").get_by_text("Cancel").evaluate("button => button.click()")
    tab.wait("Cancelled")
    assert session.now.object.fresh is None

    tab.page.keyboard.press("x")  # the box hides nothing behind it
    until(lambda: panels.tool.value == "3D box", "the box")
    finish(app)
    tab.until_colour(below, lambda colour: np.abs(colour - tinted).max() < 40)
    tab.page.keyboard.press("t")
    tab.wait("is cut out:")
    tab.until_colour(below, lambda colour: colour[2] <= colour[0])  # in its own colours, and not in blue
    beside = lighthouse + 0.2 * np.array(tab.evaluate("canvas.pose().right"))
    tab.until_colour(beside, lambda colour: colour.max() < 10)
    tab.press("White")
    tab.until_colour(beside, lambda colour: colour.min() > 245)

    first = session.now.object.fresh
    tab.press("Brush")
    tab.wait("Paint.")
    x, y = tab.place(lighthouse)
    until(lambda: not tab.page.locator("#gesture-overlay .handle").count(), "the box to be gone")
    tab.page.mouse.move(x, y)
    assert float(tab.page.locator("#gesture-overlay .ring").get_attribute("r")) == panels.brush.value
    tab.page.keyboard.down("Control")
    drag(tab, (x - 30, y), (x + 30, y))
    tab.page.keyboard.up("Control")
    until(lambda: session.now.object.fresh not in (None, first), "the corrected object")
    assert len(session.now.object.fresh.object) < len(first.object)

    tab.press("Scene without it")
    tab.until_colour(beside, lambda colour: colour.min() < 230)
    finish(app)
    without = tab.colour(lighthouse)
    tab.page.keyboard.down("Space")  # keys work after a button was pressed
    tab.page.locator(".gt-compared").get_by_text("With it").wait_for()
    tab.until_colour(lighthouse, lambda colour: np.abs(colour - without).max() > 40)
    tab.page.keyboard.up("Space")
    tab.page.reload()
    tab.wait("Scene without it")
    assert session.now.object.fresh is not None  # nothing is lost

    tab.until_said(lambda: tab.page.keyboard.press("Control+z"), "Undone: mark (brush).")
    tab.page.keyboard.press("Control+Shift+z")
    tab.wait("Done again: mark (brush).")
    tab.write("Folder", str(tmp_path / "by app"))
    tab.press("Save in this folder")
    tab.wait("Saved in")
    line, picture = (tab.page.locator(which).first.bounding_box() for which in ("[role=status]", "canvas"))
    assert line["x"] < picture["x"] + 40 and line["x"] + line["width"] < picture["x"] + picture["width"]
    assert line["y"] + line["height"] < 0.4 * picture["height"]
    assert str(tmp_path / "by app" / "report.json") in tab.page.locator("textarea").first.input_value()
    assert tab.errors == []


@pytest.mark.slow
def test_box_lasso_polygon_and_up_by_points(browser, app, lighthouse):
    session = app.controller.session
    tab = Tab(browser, app, *SMALL)
    tab.wait("59,472 Gaussians")
    tab.press("Box")
    tab.wait("Drag a box")
    x, y = tab.place(lighthouse)
    size = abs(tab.place(lighthouse + UP)[1] - y)
    drag(tab, (x - 0.6 * size, y - 1.1 * size), (x + 0.6 * size, y + 1.1 * size))
    tab.wait("Gaussians selected")
    by_box = session.now.object.n_selected

    tab.press("Lasso")
    tab.wait("Draw around")
    tab.page.keyboard.down("Control")
    drag(tab, *around(tab, lighthouse, 0.2 * size))
    tab.page.keyboard.up("Control")
    until(lambda: session.now.object.n_selected < by_box, "what the lasso removes")
    by_lasso = session.now.object.n_selected

    tab.press("Polygon")
    tab.wait("Click corners")
    for corner in around(tab, lighthouse, 0.3 * size):
        tab.page.mouse.click(*corner)
    tab.page.keyboard.press("Enter")
    until(lambda: session.now.object.n_selected > by_lasso, "what the polygon adds")
    assert [type(mark).__name__ for mark in session.now.object.marks] == ["Box", "Rows", "Rows"]

    tab.panel("File")
    tab.press("Up by three clicks on the ground")
    tab.wait("Click three points on the ground.")
    for step, said in (([0.1, 0.0], "2 more"), ([0.4, 0.1], "1 more"), ([0.3, -0.3], "Up is")):
        place = [*(lighthouse[:2] + step), 0.0]
        tab.until_said(lambda place=place: click(tab, place), said)
    until(lambda: session.now.up.source == "given", "the up vector")
    assert session.now.up.direction[2] > 0.98
    assert tab.errors == []


DROP = """([name, data, where]) => {
    const bytes = Uint8Array.from(atob(data), (character) => character.charCodeAt(0));
    const transfer = new DataTransfer();
    transfer.items.add(new File([bytes], name));
    const facts = { dataTransfer: transfer, cancelable: true, bubbles: true };
    document.querySelector(where).dispatchEvent(new DragEvent("drop", facts));
}"""


def drop(tab, path, where="html"):
    """Drop a file on a part of the page."""
    tab.page.evaluate(DROP, [path.name, base64.b64encode(path.read_bytes()).decode(), where])


@pytest.mark.slow
def test_files_are_dropped_and_work_is_back_after_the_program_ended(browser, tmp_path):
    from gaussian_trimmer.app.serving import serving

    for said in ("and click on the object that you want", "Your work is back"):
        with serving(None, None, port=0, most=SHOWN, state=tmp_path) as app:
            tab = Tab(browser, app, *SMALL)
            tab.wait("Cut one object out of a splat scene.")
            drop(tab, sample.SCENE)
            tab.wait(said)
            finish(app)
            if "back" not in said:
                drop(tab, sample.SELECTION)
                tab.wait("Gaussians selected")
                n = app.controller.session.now.object.n_selected
            assert app.controller.session.now.object.n_selected in (0, n)
    assert n == np.load(sample.SELECTION).sum()


@pytest.mark.slow
def test_the_address_alone_opens_the_app_and_esc_and_enter_leave_fields(browser, app):
    tab, panels = Tab(browser, app, *SMALL), app.controller.panels
    tab.wait("59,472 Gaussians")
    stranger = browser.new_page()
    assert stranger.goto(app.address.rsplit("/", 2)[0] + "/").status == 403
    tab.page.reload()  # the tab keeps the key
    tab.wait("59,472 Gaussians")
    tab.page.keyboard.press("c")
    until(lambda: panels.tool.value == "Click", "the keyboard to be the app's")
    for key, left in (("Enter", "b"), ("Escape", "l")):
        name = tab.field("Name")
        name.dblclick()
        name.fill(f"bottle {key}")
        name.press(key)
        tab.page.keyboard.press(left)  # the tool, not a letter of the name
        until(lambda left=left: panels.tool.value.lower().startswith(left), "the key to be the tool's")
        until(lambda key=key: app.controller.session.now.object.name == f"bottle {key}", "the name")
    assert tab.errors == []


@pytest.mark.slow
def test_what_goes_wrong_is_a_message_and_the_page_goes_on(browser, app, lighthouse, tmp_path):
    tab = Tab(browser, app, *SMALL)
    tab.wait("59,472 Gaussians")
    (tmp_path / "broken.ply").write_bytes(b"ply\nno more")
    for path in (tmp_path / "broken.ply", tmp_path / "none.ply"):
        tab.panel("File")
        tab.write("Scene", str(path))
        tab.press("Open")
        tab.wait(path.name)
    tab.page.keyboard.press("t")
    tab.wait("Nothing is selected; mark an object first.")
    assert tab.page.get_by_role("button", name="Save in this folder").is_disabled()

    other = Tab(browser, app, *SMALL)
    other.wait("All tabs show and change the same scene.")
    marked(other, lighthouse)
    tab.wait("an object that stands on a surface")
    assert states(other)[2] == states(tab)[2] > 0

    tab.evaluate("link.socket.close()")
    until(lambda: len(app.controller.jobs.page.tabs) == 1, "the tab to be gone")
    until(lambda: len(app.controller.jobs.page.tabs) == 2, "the tab to come back")
    other.page.close()
    tab.until_said(lambda: tab.page.keyboard.press("Control+Shift+a"), "Cleared.")
    marked(tab, lighthouse)
    assert tab.errors == []


def states(tab):
    """How many splats the page has, how many it draws, and how many are selected."""
    return tab.page.evaluate("""() => {
        const { canvas } = gaussianTrimmer;
        let selected = 0;
        for (let i = 0; i < canvas.total; i++) selected += canvas.states[4 * i] > 0;
        return [canvas.count, canvas.counters.instances, selected];
    }""")


NEXT_FRAME = """([x, y]) => new Promise((done) => {
    const { canvas } = gaussianTrimmer, before = { ...canvas.counters };
    canvas.followers.push(() => {
        done(["frames", "draws", "lines"].map((name) => canvas.counters[name] - before[name]));
        canvas.followers.pop();
    });
    const where = { pointerId: 1, buttons: 1, clientX: x, clientY: y };
    window.dispatchEvent(new PointerEvent("pointermove", where));
})"""
LIVE = "[...gaussianTrimmer.canvas.states].filter((value, i) => i % 4 === 3 && value).length"


@pytest.mark.slow
def test_a_stroke_is_seen_in_the_next_frame_and_nothing_but_bits_crosses_the_socket(browser, lighthouse, tmp_path):
    from gaussian_trimmer.app.serving import serving

    with serving(sample.SCENE, sample.CAMERAS, port=0, state=tmp_path) as app:
        session, tab = app.controller.session, Tab(browser, app, 700, 500)
        tab.wait("59,472 Gaussians")
        until(lambda: tab.evaluate("canvas.order.length") == 59_472, "all Gaussians to be sorted")
        assert tab.evaluate("link.counters.received") < 20_000  # what is drawn comes by HTTP
        masks = [session.now.object.selected.mask]
        for tool, how in (("Brush", "Footprint"), ("Lasso", "Centres")):
            for button in (tool, how, "Through"):
                tab.press(button)
            x, y = tab.place(lighthouse)
            tab.page.mouse.move(x - 60, y)
            tab.page.mouse.down()
            tab.page.mouse.move(x + 60, y, steps=3)
            until(lambda: tab.evaluate("canvas.drawing") == 0, "the picture")
            frames, draws, lines = tab.page.evaluate(NEXT_FRAME, [x + 80, y + 160])
            assert (frames, draws) == (1, 1) and lines > 0
            live = tab.page.evaluate(LIVE)
            tab.page.mouse.up()
            until(lambda: (session.now.object.selected.mask != masks[-1]).any(), "the mark")
            finish(app)
            assert tab.evaluate("link.counters.lastSent") < 4096
            masks.append(session.now.object.selected.mask)
            changed = int((masks[-1] != masks[-2]).sum())
            assert changed > 100
            if how == "Centres":
                assert set(np.flatnonzero(masks[-1] & ~masks[-2])) and changed <= live
            until(lambda: states(tab)[2] == session.now.object.n_selected, "the page to know")
            assert tab.page.evaluate(LIVE) == 0
        assert tab.errors == []


@pytest.mark.slow
def test_a_tab_comes_back_to_a_program_that_was_started_again(browser, lighthouse, tmp_path):
    from gaussian_trimmer.app.serving import serving

    with serving(sample.SCENE, sample.CAMERAS, port=8765, most=SHOWN, state=tmp_path) as app:
        tab = Tab(browser, app, *SMALL)
        tab.wait("59,472 Gaussians")
        marked(tab, lighthouse)
        finish(app)
    tab.wait("The program is gone.")
    assert "lost" in tab.page.locator("#gt-picture").get_attribute("class")
    with serving(sample.SCENE, sample.CAMERAS, port=8765, most=SHOWN, state=tmp_path) as again:
        assert again.address == app.address
        tab.wait("Your work is back")
        until(lambda: states(tab)[2] > 0, "the marks")
        assert "lost" not in tab.page.locator("#gt-picture").get_attribute("class")


READING = """() => {
    const rgb = (text) => text.match(/[\\d.]+/g).map(Number);
    const linear = (each) => each <= 0.03928 ? each / 12.92 : ((each + 0.055) / 1.055) ** 2.4;
    const light = ([r, g, b]) => 0.2126 * linear(r / 255) + 0.7152 * linear(g / 255) + 0.0722 * linear(b / 255);
    const behind = (element) => {
        for (let each = element; each; each = each.parentElement) {
            const colour = rgb(getComputedStyle(each).backgroundColor);
            if ((colour[3] ?? 1) > 0.5) return colour;
        }
        return [0, 0, 0];
    };
    const faults = [];
    for (const each of document.querySelectorAll("button, input, select, textarea, [role]")) {
        if (!each.checkVisibility()) continue;
        const name = each.ariaLabel || each.textContent || each.title || each.closest("label")?.textContent || "";
        if (!name.trim()) faults.push(`no name: ${each.outerHTML.slice(0, 80)}`);
        const { width, height } = each.getBoundingClientRect();
        if (each.matches("button") && (width < 14 || height < 14)) faults.push(`too small: ${name}`);
    }
    for (const each of document.querySelectorAll("button, span, label, small, td, summary, h2, option")) {
        if (!each.checkVisibility() || !each.textContent.trim() || each.disabled || each.children.length) continue;
        const [a, b] = [light(rgb(getComputedStyle(each).color)), light(behind(each))].sort((x, y) => y - x);
        if ((a + 0.05) / (b + 0.05) < 4.5) faults.push(`hard to read: ${each.textContent.slice(0, 40)}`);
    }
    return faults;
}"""


@pytest.mark.slow
@pytest.mark.parametrize(("width", "height"), [(1280, 720), (390, 844)])
def test_everything_has_a_name_can_be_read_and_covers_nothing(browser, app, lighthouse, width, height):
    tab = Tab(browser, app, width, height)
    tab.wait("59,472 Gaussians")
    tab.page.keyboard.press("c")
    marked(tab, lighthouse)
    tab.page.keyboard.press("t")
    tab.wait("is cut out:")
    finish(app)
    if width < 700:
        panel = tab.page.locator("#gt-panel").bounding_box()
        assert panel["height"] < 50 and tab.page.locator("#gt-canvas").bounding_box()["width"] == width
        tab.press("Objects and files")
        assert 0.4 * height < tab.page.locator("#gt-panel").bounding_box()["height"] < 0.7 * height
    for part in ("File", "Options", "Keys"):
        tab.panel(part)
    assert tab.page.evaluate(READING) == []
    assert tab.page.evaluate("document.documentElement.scrollWidth") <= width
    picture = tab.page.locator("#gt-canvas").bounding_box()
    for part in (".gt-bar", ".gt-high", "[role=status]"):
        box = tab.page.locator(part).bounding_box()
        assert box["x"] >= picture["x"] and box["x"] + box["width"] <= picture["x"] + picture["width"]
    assert tab.errors == []


@pytest.mark.slow
def test_the_keyboard_alone_reaches_all_and_renames(browser, app):
    tab, session = Tab(browser, app, *SMALL), app.controller.session
    tab.wait("59,472 Gaussians")
    tab.panel("File")
    tab.press("New object")
    until(lambda: len(session.now.objects) == 2, "another object")
    tab.page.locator(".gt-object").nth(1).focus()
    reached = []
    while "object 1" not in reached:  # once around, to the first object
        tab.page.keyboard.press("Tab")
        reached.append(tab.page.evaluate("document.activeElement.ariaLabel || document.activeElement.classList[0]"))
        assert len(reached) < 150
    assert {"Look", "Click", "Find objects", "Everything", "Download the project"} <= set(reached)
    tab.page.keyboard.press("Enter")
    until(lambda: session.now.active == 0, "the first object to be chosen")
    tab.page.locator(".gt-object.active:first-child").wait_for()
    tab.page.keyboard.press("F2")
    tab.page.keyboard.type("mug")
    tab.page.keyboard.press("Enter")
    until(lambda: session.now.object.name == "mug", "the name")
    assert tab.errors == []


@pytest.mark.slow
def test_the_page_says_that_the_program_has_ended(browser, tmp_path):
    from gaussian_trimmer.app.serving import serving

    with serving(None, None, port=0, state=tmp_path) as app:
        tab = Tab(browser, app, *SMALL)
        tab.wait("Cut one object out")
        assert not tab.page.locator("#gt-panel.lost").count()
    tab.wait("The program has ended")
    tab.page.locator("#gt-panel.lost").wait_for()
    tab.wait("The program is gone")


@pytest.fixture
def ball_tab(browser, ball, tmp_path):
    """A tab that shows the ball on its floor, which is marked."""
    from gaussian_trimmer.app.serving import serving

    with serving(ball[0] / "scene.ply", ball[0] / "cameras.json", port=0, state=tmp_path / "state") as app:
        tab, jobs = Tab(browser, app, *SMALL), app.controller.jobs
        tab.wait("and click on the object that you want")
        jobs.do("Marking", lambda: jobs.session.do(edits.mark, toy.BALL), Event.MARKED)
        tab.wait("Gaussians selected")
        yield tab
        assert tab.errors == []


def foot(tab, moved=None):
    """Pixels at which the ball's foot shows where it was moved to."""
    place = tab.app.controller.jobs.view.frame.to_scene(tab.evaluate("link.state.placing.foot"))
    if moved is not None:
        place = moved.scale * moved.rotation @ place + moved.to
    return np.array(tab.place(place))


@pytest.mark.slow
def test_handles_move_turn_and_scale_by_dragging_and_by_keys(ball_tab):
    tab, session, keys = ball_tab, ball_tab.app.controller.session, ball_tab.page.keyboard

    def handle(kind):
        return tab.page.locator(f"#gesture-overlay {kind}.gizmo.handle")

    def middle(element):
        box = until(element.bounding_box, "a handle that is not being drawn anew")
        return np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])

    def moved_from(before):
        until(lambda: session.now.object.moved not in (None, before), "the object to be elsewhere")
        finish(tab.app)
        return session.now.object.moved

    keys.press("1")
    handle("rect").wait_for()
    start, aside = middle(handle("rect")), np.array([60, -30])
    drag(tab, start, start + aside)
    there = moved_from(None)
    assert np.allclose(foot(tab, there) - foot(tab), aside, atol=6) and there.scale == 1
    until(lambda: np.allclose(middle(handle("rect")), start + aside, atol=6), "the handles to follow")
    for _ in range(3):  # one step
        keys.press("ArrowLeft")
    back = moved_from(there)
    assert foot(tab, back)[0] < foot(tab, there)[0] - 15
    keys.press("Control+z")
    until(lambda: session.now.object.moved == there, "the keys to be undone")

    keys.press("2")
    handle("polyline.z").wait_for()
    ring = [tuple(map(float, place.split(","))) for place in handle("polyline.z").get_attribute("points").split()]
    drag(tab, ring[4], ring[8])
    turned = moved_from(there)
    axis = turned.rotation - np.eye(3)
    assert np.abs(axis @ toy.UP).max() < 1e-4 and np.abs(axis).max() > 0.2  # about the axis that is up
    assert np.allclose(foot(tab, turned), foot(tab, there), atol=2)  # on its foot
    keys.press("ArrowRight")
    assert not np.allclose(moved_from(turned).rotation, turned.rotation)

    keys.press("3")
    handle("circle").wait_for()
    before, (x, y) = session.now.object.moved, foot(tab, session.now.object.moved)
    end = middle(handle("circle"))
    drag(tab, end, 2 * end - (x, y))
    assert moved_from(before).scale == pytest.approx(2, rel=0.1)
    larger = session.now.object.moved
    keys.press("ArrowDown")
    assert moved_from(larger).scale < larger.scale
    tab.press("Put it back")
    until(lambda: session.now.object.moved is None, "the object to be back")
    tab.press("Scene without it")
    until(lambda: not handle("circle").count(), "no handles of what is not seen")


@pytest.mark.slow
def test_a_colour_is_picked_where_it_is_clicked(ball_tab):
    tab, session = ball_tab, ball_tab.app.controller.session
    tab.press("New object")
    until(lambda: len(session.now.objects) == 2, "another object")
    tab.page.keyboard.press("o")
    tab.wait("Click on a colour")
    place = np.array([-2.5, -0.5, -0.05])  # on the floor
    tab.until_said(lambda: click(tab, place), "colour")
    until(lambda: session.now.object.n_selected, "what has this colour")
    scene, mask = session.document.scene, session.now.object.selected.mask
    own = scene.sh_dc[np.argmin(np.linalg.norm(scene.means - place, axis=1))]
    near = np.abs(scene.sh_dc - own).max(axis=1) < 0.3
    assert near[mask].all() and mask.sum() > 50 and not (mask & session.now.objects[0].mask).any()


@pytest.mark.slow
def test_a_scene_that_is_dropped_on_the_panel_stands_beside_the_first(ball_tab, tmp_path):
    tab, session = ball_tab, ball_tab.app.controller.session
    tab.page.keyboard.press("c")  # so that the program knows from where the page looks
    n = len(session.document.scene)
    scene, is_ball = toy.ball_on_floor()
    formats.write(scene.select(is_ball), tmp_path / "lamp.ply")
    drop(tab, tmp_path / "lamp.ply", "#gt-panel")
    tab.wait("lamp stands beside the scene")
    tab.page.get_by_role("listitem", name="lamp").wait_for()
    until(lambda: tab.evaluate("canvas.count") == n + is_ball.sum(), "both to be drawn")
    until(lambda: tab.page.locator("#gesture-overlay .gizmo").count(), "the handles")
    assert tab.app.controller.panels.tool.value == "Move"
    until(lambda: (foot(tab) > 0).all() and (foot(tab) < SMALL).all(), "it to be seen")


@pytest.mark.slow
def test_what_is_typed_is_entered_when_a_button_is_pressed(ball_tab, tmp_path):
    tab = ball_tab
    tab.page.keyboard.press("t")
    tab.wait("is cut out:")
    finish(tab.app)
    tab.field("Folder").fill(str(tmp_path / "typed"))
    tab.press("Save in this folder")
    tab.wait("Saved in")
    assert (tmp_path / "typed" / "report.json").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 390])
def test_axe_finds_no_fault(ball_tab, width):
    package = pytest.importorskip("axe_playwright_python", reason="needs axe-playwright-python, which brings axe-core")
    tab = ball_tab
    tab.page.set_viewport_size({"width": width, "height": 720})
    tab.page.keyboard.press("b")
    for part in ("File", "Options", "Keys"):
        tab.panel(part)
    tab.page.evaluate(Path(package.__file__).with_name("axe.min.js").read_text(encoding="utf-8"))
    found = tab.page.evaluate("axe.run()")["violations"]
    assert [f"{each['id']}: {each['nodes'][0]['html'][:200]}" for each in found] == []
