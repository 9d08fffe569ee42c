"""The pages in a browser, opened from files: moved through, and compared with what is rendered here."""

from dataclasses import replace

import numpy as np
import pytest
from browser import chromium, differ, opened, screenshot

from gaussian_trimmer import formats, sample
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.output.pages import report_page
from gaussian_trimmer.output.report import describe
from gaussian_trimmer.trimming.trim import trim

pytestmark = [pytest.mark.needs("browser"), pytest.mark.slow]
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
    doubtful = replace(result, objects=(replace(result.objects[0], warnings=(HOSTILE,)),))
    path.write_text(report_page(doubtful, {**describe(doubtful), "inputs": {"scene": HOSTILE}}), encoding="utf-8")
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
        views = page.locator("#object-1")
        shown = []
        for choice in views.locator("fieldset input").all():
            choice.check()
            visible = views.locator("figure").first.locator("img:visible")
            shown.append([image.get_attribute("data-layer") for image in visible.all()])
            names = views.locator("figure").first.locator(".name").all_text_contents()
            assert set(names) == set(shown[-1])
        pairs = [["selection", "trimmed object"], ["trimmed object", "outlines"], ["scene", "scene without the object"]]
        assert [sorted(pair) for pair in shown] == [*map(sorted, pairs), ["selection", "what was done"]]


def test_the_report_shows_hostile_names_as_text(browser, report):
    with opened(browser, report, color_scheme="dark") as page:
        assert page.locator(".doubts").text_content() == HOSTILE
        assert page.locator("img[src=x]").count() == 0
        dark = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert max(int(part) for part in dark[4:-1].split(",")) < 60
