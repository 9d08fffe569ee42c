"""The pages in a browser, opened from files: moved through, and compared with what is rendered here."""

from dataclasses import replace

import numpy as np
import pytest
import toy
from browser import chromium, differ, opened, picture_of, screenshot, wait_until

from gaussian_trimmer import formats, sample
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera, look_at, up_frame
from gaussian_trimmer.output.html.report_page import report_page
from gaussian_trimmer.output.html.viewer import first_view, viewer_page
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.trimming.trim import trim

pytestmark = [pytest.mark.needs("browser"), pytest.mark.slow]
RENDERER = get_renderer("numba")
HOSTILE = "\"'><img src=x onerror=alert(1)><script>alert(1)</script>.ply"


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def result(browser):
    scene, selection = formats.read(sample.SCENE), np.load(sample.SELECTION)
    return trim(scene, selection, cameras=read_camera_set(sample.CAMERAS))


@pytest.fixture(scope="module")
def report(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("pages") / "report.html"
    doubtful = replace(result, objects=(replace(result.only, warnings=(HOSTILE,)),))
    path.write_text(report_page(doubtful, {**doubtful.report, "inputs": {"scene": HOSTILE}}), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def viewer(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("pages") / "viewer.html"
    parts = {"object": result.object, "background": result.background}
    path.write_text(viewer_page(parts, result.up.direction, HOSTILE, result.bounds), encoding="utf-8")
    return path


def test_sliders_of_the_report_move_by_mouse_and_by_keys(browser, report):
    with opened(browser, report) as page:
        pair = page.locator(".pair").first
        slider = pair.locator("input")
        box = slider.bounding_box()
        shown = []
        for share in (0.02, 0.98):
            page.mouse.click(box["x"] + share * box["width"], box["y"] + box["height"] / 2)
            shown.append(screenshot(pair))
        assert differ(*shown) > 0.005, "before and after are different pictures"
        slider.focus()
        before = float(slider.input_value())
        page.keyboard.press("ArrowLeft")
        assert float(slider.input_value()) == before - 1
        assert float(pair.evaluate("pair => pair.style.getPropertyValue('--at')")) == before - 1


def test_other_pictures_can_be_compared(browser, report):
    with opened(browser, report) as page:
        views = page.locator("#views")
        shown = []
        for choice in views.locator("fieldset input").all():
            choice.check()
            visible = views.locator("figure").first.locator("img:visible")
            shown.append([image.get_attribute("data-layer") for image in visible.all()])
            names = views.locator("figure").first.locator(".name").all_text_contents()
            assert set(names) == set(shown[-1])
        assert shown == [["selection", "trimmed object"], ["trimmed object", "outlines"]]


def test_the_report_shows_hostile_names_as_text(browser, report):
    with opened(browser, report, color_scheme="dark") as page:
        assert page.locator(".doubts").text_content() == HOSTILE
        assert page.locator("img[src=x]").count() == 0
        dark = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert max(int(part) for part in dark[4:-1].split(",")) < 60


def drawn(page):
    """The canvas, BGRA."""
    wait_until(page, "order !== null && !asked && !drawing")
    return picture_of(page.evaluate("(() => { draw(); return canvas.toDataURL(); })()"))


def camera_of(result, width, height):
    view, axes = first_view(result.bounds), result.bounds.axes
    level = np.cos(view["yaw"]) * axes[0] + np.sin(view["yaw"]) * axes[1]
    outward = np.cos(view["pitch"]) * level + np.sin(view["pitch"]) * axes[2]
    focal = min(width, height) / (2 * np.tan(view["fov"] / 2))
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    centre = result.bounds.centre
    pose = look_at(centre + view["distance"] * outward, centre, axes[2])
    return Camera(pose, K, width, height, near=view["near"])


def test_the_viewer_draws_what_the_renderer_does(browser, viewer, result):
    with opened(browser, viewer, width=640, height=480) as page:
        whole = drawn(page)
        page.locator("input[name=part][value=object]").check()
        alone = drawn(page)
        page.locator("input[name=part][value=background]").check()
        without = drawn(page)
    height, width = alone.shape[:2]
    camera = camera_of(result, width, height)
    expected = RENDERER.render(result.object, camera)
    assert toy.jaccard(alone[..., 3] > 127, expected.alpha > 0.5) > 0.97
    # Colours of the constant term alone, as the page has them.
    for part, picture in ((result.object, alone), (result.scene, whole), (result.background, without)):
        flat = part.replace(sh_rest=np.zeros((len(part), 3, 0), np.float32))
        rgb = np.clip(RENDERER.render(flat, camera).rgb, 0, 1)
        ours = picture[..., 2::-1].astype(np.float32) / 255 * (picture[..., 3:].astype(np.float32) / 255)
        assert np.abs(ours - rgb).mean() < 0.02, np.abs(ours - rgb).mean()
    assert differ(whole[..., :3], without[..., :3]) > 0.02


def test_the_viewer_turns_zooms_moves_and_begins_anew(browser, viewer):
    with opened(browser, viewer, width=640, height=480) as page:
        page.locator("input[name=part][value=object]").check()
        first = drawn(page)
        canvas = page.locator("#canvas")
        box = canvas.bounding_box()
        middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(*middle)
        page.mouse.down()
        page.mouse.move(middle[0] + 120, middle[1] + 30, steps=4)
        page.mouse.up()
        assert differ(drawn(page)[..., :3], first[..., :3]) > 0.01
        page.locator("#reset").click()
        np.testing.assert_array_equal(drawn(page), first)
        page.mouse.move(*middle)
        page.mouse.wheel(0, -400)
        assert np.count_nonzero(drawn(page)[..., 3] > 127) > 1.2 * np.count_nonzero(first[..., 3] > 127)
        canvas.focus()
        page.keyboard.press("Home")
        for key in ("ArrowRight", "ArrowUp", "Shift+ArrowLeft", "-"):
            earlier = drawn(page)
            page.keyboard.press(key)
            assert differ(drawn(page), earlier) > 0.002, key
        page.keyboard.press("Home")
        page.keyboard.press(" ")
        wait_until(page, "view.yaw > start.yaw + 0.05")
        page.keyboard.press(" ")
        assert page.locator("#turn").get_attribute("aria-pressed") == "false"
        assert page.locator("h1").text_content() == HOSTILE


def test_the_backdrops_of_the_viewer_show(browser, viewer):
    with opened(browser, viewer, width=640, height=480) as page:
        page.locator("input[name=part][value=object]").check()
        drawn(page)
        corners = []
        for backdrop in ("light", "dark", "checker"):
            page.locator(f"input[name=backdrop][value={backdrop}]").check()
            page.wait_for_timeout(300)
            corners.append(screenshot(page.locator("#stage"))[:100, :100])
        assert corners[0].min() > 200 > 60 > corners[1].max()
        assert corners[2].std() > 5


def test_fingers_turn_and_zoom(browser, viewer):
    with opened(browser, viewer, width=640, height=480, has_touch=True) as page:
        page.locator("input[name=part][value=object]").check()
        first = drawn(page)
        touch = page.context.new_cdp_session(page)

        def fingers(kind, *places):
            points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(places)]
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        fingers("touchStart", (320, 200))
        fingers("touchMove", (420, 200))
        fingers("touchEnd")
        assert differ(drawn(page)[..., :3], first[..., :3]) > 0.01
        page.locator("#reset").click()
        fingers("touchStart", (300, 200), (340, 200))
        fingers("touchMove", (240, 200), (400, 200))
        fingers("touchEnd")
        assert np.count_nonzero(drawn(page)[..., 3] > 127) > 1.5 * np.count_nonzero(first[..., 3] > 127)


def test_outliers_do_not_spoil_the_order(browser, tmp_path):
    """A red wall before a green one, and one Gaussian a million units away: the nearer wall still hides the other."""
    side = np.linspace(-1, 1, 24)
    wall = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    walls = [np.column_stack([np.full(len(wall), depth), wall]) for depth in (0.01, -0.01)]
    colours = np.repeat([[1.0, 0, 0], [0, 1.0, 0]], len(wall), axis=0)
    order = np.random.default_rng(0).permutation(len(colours))
    means, colours = np.concatenate(walls)[order], colours[order]
    scene = toy.gaussians([*means, [1e6, 0, 0]], [0.001, 0.06, 0.06], [*colours, [0, 0, 1]], 0.99)
    path = tmp_path / "walls.html"
    path.write_text(viewer_page({"walls": scene}, toy.UP, "walls"), encoding="utf-8")
    side_axis, other_axis, _ = up_frame(toy.UP)
    from_x = np.arctan2(other_axis[0], side_axis[0])
    with opened(browser, path, width=320, height=320) as page:
        for yaw, channel in ((from_x, 2), (from_x + np.pi, 1)):
            page.evaluate(f"view.yaw = {yaw}; view.pitch = 0; refresh()")
            picture = drawn(page)
            centre = picture[picture.shape[0] // 2, picture.shape[1] // 2].astype(int)
            assert centre[channel] > 200 > 60 > max(centre[i] for i in range(3) if i != channel)


def test_a_browser_without_webgl_says_so(browser, viewer):
    context = browser.new_context()
    context.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    page = context.new_page()
    page.goto(viewer.as_uri())
    assert "needs WebGL 2" in page.locator("#message").text_content()
    assert page.locator("#message").is_visible()
    context.close()
