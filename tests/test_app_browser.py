"""The app in a real browser. One short way through it is in every run; the others take minutes and are slow."""

import base64

import numpy as np
import pytest
from browser import Tab, chromium, until

from gaussian_trimmer import formats, sample

pytestmark = pytest.mark.needs("browser", "viser")

UP = np.array([0, 0, 0.16])
SHOWN = 4000
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
    before = tab.until_colour(lighthouse, lambda colour: colour.max() > 100)  # once it has faded in
    marked(tab, lighthouse)
    tinted = tab.until_colour(lighthouse, lambda colour: np.abs(colour - before).max() > 25)

    tab.page.keyboard.press("t")
    tab.page.locator("[role=status]").get_by_text("Cancel").evaluate("button => button.click()")
    tab.wait("Cancelled")
    assert session.now.object.fresh is None

    tab.page.keyboard.press("x")  # the box hides nothing behind it
    until(lambda: panels.tool.value == "3D box", "the box")
    finish(app)
    tab.until_colour(lighthouse, lambda colour: np.abs(colour - tinted).max() < 40)
    tab.page.keyboard.press("t")
    tab.wait("is cut out:")
    tab.until_colour(lighthouse, lambda colour: np.abs(colour - before).max() < 60)  # in its own colours
    view = app.controller.jobs.view.viewpoint(app.server.get_clients()[tab.client])
    beside = lighthouse + 0.2 * view.camera.rotation[0]
    tab.until_colour(beside, lambda colour: colour.max() < 10)
    tab.press("White")
    tab.until_colour(beside, lambda colour: colour.min() > 245)

    first = session.now.object.fresh
    tab.press("Brush")
    tab.wait("Paint.")
    x, y = tab.place(lighthouse)
    tab.page.mouse.move(x, y)
    assert float(tab.page.locator("#gesture-overlay circle").first.get_attribute("r")) == panels.brush.value
    tab.page.keyboard.down("Control")
    drag(tab, (x - 30, y), (x + 30, y))
    tab.page.keyboard.up("Control")
    until(lambda: session.now.object.fresh not in (None, first), "the corrected object")
    assert len(session.now.object.fresh.object) < len(first.object)

    tab.press("Scene without it")
    tab.until_colour(beside, lambda colour: colour.min() < 200)
    finish(app)
    without = tab.colour(lighthouse)
    tab.page.keyboard.down("Space")  # keys work after a button was pressed
    tab.page.locator(".gt-compared").get_by_text("With it").wait_for()
    tab.until_colour(lighthouse, lambda colour: np.abs(colour - without).max() > 40)
    tab.page.keyboard.up("Space")
    tab.page.reload()
    tab.wait("Scene without it")
    (tab.client,) = until(lambda: list(app.server.get_clients()), "the page to come back")
    assert session.now.object.fresh is not None  # nothing is lost

    tab.until_said(lambda: tab.page.keyboard.press("Control+z"), "Undone: mark (brush).")
    tab.page.keyboard.press("Control+Shift+z")
    tab.wait("Done again: mark (brush).")
    tab.write("Folder", str(tmp_path / "by app"))
    tab.press("Save in this folder")
    tab.wait("Saved in")
    line, picture = (tab.page.locator(which).first.bounding_box() for which in ("[role=status]", "canvas"))
    assert line["x"] < picture["x"] + 40 and line["x"] + line["width"] < picture["x"] + picture["width"]
    assert 0.75 * picture["height"] < line["y"] + line["height"] < picture["height"]  # it is never scrolled away
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


DROP = """([name, data]) => {
    const bytes = Uint8Array.from(atob(data), (character) => character.charCodeAt(0));
    const transfer = new DataTransfer();
    transfer.items.add(new File([bytes], name));
    window.dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, cancelable: true }));
}"""


@pytest.mark.slow
def test_files_are_dropped_and_work_is_back_after_the_program_ended(browser, tmp_path):
    from gaussian_trimmer.app.serving import serving

    def drop(tab, path):
        data = base64.b64encode(path.read_bytes()).decode()
        tab.page.evaluate(DROP, [path.name, data])

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

    lost = set(app.server.get_clients())
    app.server._websock_server.disconnect_all_clients()
    until(lambda: len(set(app.server.get_clients()) - lost) == 2, "both tabs to come back")
    other.page.close()
    until(lambda: len(app.server.get_clients()) == 1, "one tab")
    (tab.client,) = app.server.get_clients()
    tab.until_said(lambda: tab.page.keyboard.press("Control+Shift+a"), "Cleared.")
    marked(tab, lighthouse)
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
