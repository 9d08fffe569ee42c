"""The app in a real browser. One short way through it is in every run; the others take minutes and are slow."""

import shlex

import numpy as np
import pytest
from app_tab import Tab, until
from browser import chromium
from command_line import run

from gaussian_trimmer import formats, sample
from gaussian_trimmer.selecting.marks import Box3D

pytestmark = pytest.mark.needs("browser", "viser")

UP = np.array([0, 0, 0.16])
SHOWN = 4000
"""Gaussians that are shown: software rendering of all of them takes seconds."""
LAPTOP, SMALL = (1366, 768), (1000, 640)


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
def app():
    from gaussian_trimmer.app.serving import serving

    with serving(sample.SCENE, sample.CAMERAS, port=0, most=SHOWN) as running:
        yield running


def orange(colour):
    return colour[0] > 1.4 * colour[2] and colour[0] > 90


def click(tab, point, **options):
    x, y = tab.place(point)
    tab.page.mouse.click(x, y, **options)


def marked(tab, lighthouse):
    """Mark the lighthouse by a click."""
    tab.panel("Mark")
    tab.page.keyboard.press("c")
    tab.wait("Click on the object")
    tab.until_said(lambda: click(tab, lighthouse), "an object that stands on a surface")


def finish(app):
    until(lambda: not app.controller.worker.busy, "the program to finish")


@pytest.mark.smoke
def test_a_click_and_a_trim(browser, app, lighthouse):
    tab = Tab(browser, app, *SMALL)
    tab.wait("59,472 Gaussians")
    marked(tab, lighthouse)
    tab.page.keyboard.press("t")
    tab.wait("views accepted")
    assert len(app.controller.session.now.object.result.object) > 1000
    assert tab.errors == []


@pytest.mark.slow
def test_from_opening_to_saved_files(browser, app, lighthouse, tmp_path, monkeypatch):
    panels = app.controller.panels
    tab = Tab(browser, app, *LAPTOP)
    tab.wait("59,472 Gaussians")
    before = tab.until_colour(lighthouse, lambda colour: colour.max() > 100)  # once it has faded in
    assert not orange(before) or before[1] < 80  # red and white, not orange
    marked(tab, lighthouse)
    tinted = tab.until_colour(lighthouse, lambda colour: np.abs(colour - before).max() > 25)
    assert tinted[0] > tinted[2] + 60

    for key, tool in (("x", "the box"), ("b", "the brush")):  # hides nothing behind it
        tab.page.keyboard.press(key)
        until(lambda key=key: panels.tool.value == {"x": "3D box", "b": "Brush"}[key], tool)
        finish(app)
        tab.until_colour(lighthouse, lambda colour: np.abs(colour - tinted).max() < 40)
    tab.page.keyboard.press("Escape")

    tab.page.keyboard.press("t")
    tab.wait("views accepted")
    tab.page.keyboard.press("3")  # the background alone
    tab.until_colour(lighthouse, lambda colour: np.abs(colour - tinted).max() > 40)
    tab.page.keyboard.press("2")  # the object alone, in its own colours
    tab.until_colour(lighthouse, lambda colour: 60 < colour[0] < colour[2] + 60)
    tab.page.keyboard.press("v")
    tab.until_colour(lighthouse, lambda colour: colour[0] > colour[2] + 60)

    tab.panel("Trim")
    for option, value in (("Before", "After"), ("Before", "After")):  # keys work after a button was pressed
        tab.switch(option)
        until(lambda option=option: panels.when.value == option, option)
        tab.page.keyboard.press("Space")
        until(lambda value=value: panels.when.value == value, value)
    tab.switch("Virtual cameras")
    tab.page.keyboard.press("1")
    until(lambda: panels.part.value == "Both", "both parts")

    tab.page.keyboard.press("Control+z")
    tab.wait("Undone: trim.")
    assert app.controller.session.now.object.result is None
    tab.page.keyboard.press("Control+Shift+z")
    tab.wait("Done again: trim.")

    tab.panel("Save")
    tab.write("Folder", str(tmp_path / "by app"))
    tab.press("Save the object")
    tab.wait("Saved in")
    command = tab.page.locator("textarea").first.input_value()
    monkeypatch.chdir(tmp_path)
    assert run(*shlex.split(command)[1:], "--quiet") == 0
    for file in sorted((tmp_path / "again").rglob("*")):
        if file.is_file() and file.name not in ("report.json", "manifest.json"):
            assert file.read_bytes() == (tmp_path / "by app" / file.relative_to(tmp_path / "again")).read_bytes(), file
    assert tab.errors == []


@pytest.mark.slow
def test_boxes_brush_and_up_by_points(browser, app, lighthouse):
    session = app.controller.session
    tab = Tab(browser, app, *SMALL)
    tab.wait("59,472 Gaussians")
    tab.panel("Mark")
    tab.page.keyboard.press("r")
    tab.wait("Drag a box")
    x, y = tab.place(lighthouse)
    corner = abs(tab.place(lighthouse + UP)[1] - y)
    tab.page.mouse.move(x - 0.6 * corner, y - 1.1 * corner)
    tab.page.mouse.down()
    tab.page.mouse.move(x, y, steps=4)
    tab.page.mouse.move(x + 0.6 * corner, y + corner, steps=4)
    tab.page.mouse.up()
    tab.wait("Gaussians selected")
    by_box = session.now.object.n_selected

    beside = np.array([lighthouse[0] + 0.3, lighthouse[1], 0])
    tab.switch("Brush")
    tab.wait("Click on a surface")
    finish(app)
    tab.until_said(lambda: click(tab, beside), "a sphere.")
    until(lambda: session.now.object.n_selected > by_box, "what the brush adds")
    with_brush = session.now.object.n_selected
    tab.page.keyboard.down("Control")
    x, y = tab.place(beside)
    tab.page.mouse.click(x, y + 20)
    tab.page.keyboard.up("Control")
    until(lambda: session.now.object.n_selected < with_brush, "what the brush removes")

    tab.page.keyboard.press("x")
    tab.wait("Move the box")
    finish(app)
    tab.press("Apply the box")
    until(lambda: isinstance(session.now.object.marks[-1], Box3D), "the box in space")

    tab.panel("Scene")
    tab.press("Up by three clicks on the ground")
    tab.wait("Click three points on the ground.")
    for step, said in (([0.1, 0.0], "2 more"), ([0.4, 0.1], "1 more"), ([0.3, -0.3], "Up is")):
        place = [*(lighthouse[:2] + step), 0.0]
        tab.until_said(lambda place=place: click(tab, place), said)
    until(lambda: session.now.up.source == "given", "the up vector")
    assert session.now.up.direction[2] > 0.98
    tab.press("-Z")
    camera = app.server.get_clients()[tab.client].camera
    until(lambda: camera.up_direction[2] < -0.98, "the view to turn")
    assert tab.errors == []


@pytest.mark.slow
def test_what_goes_wrong_is_a_message_and_the_page_goes_on(browser, app, lighthouse, tmp_path):
    tab = Tab(browser, app, *SMALL)
    tab.wait("59,472 Gaussians")
    (tmp_path / "broken.ply").write_bytes(b"ply\nno more")
    for path in (tmp_path / "broken.ply", tmp_path / "none.ply"):
        tab.write("Scene", str(path))
        tab.press("Open")
        tab.wait(path.name)
    tab.page.keyboard.press("t")
    tab.wait("Nothing is selected; mark an object first.")
    tab.panel("Save")
    tab.press("Save the object")
    tab.wait("has not been trimmed since it was marked")

    other = Tab(browser, app, *SMALL)
    other.wait("All tabs show and change the same scene.")
    marked(other, lighthouse)
    tab.wait("an object that stands on a surface")
    tab.panel("Scene")
    tab.press("Open")  # asks first
    tab.press("Keep working here")
    assert app.controller.session.now.has_work

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
def test_the_page_says_that_the_program_has_ended(browser):
    from gaussian_trimmer.app.serving import serving

    with serving(None, None, port=0) as app:
        tab = Tab(browser, app, *SMALL)
        tab.wait("Open a scene.")
    tab.wait("The program has ended")
