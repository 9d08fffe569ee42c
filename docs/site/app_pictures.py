"""Makes the pictures of docs/app.md: python docs/site/app_pictures.py

It walks through the app on the sample scene in headless Chromium, as tests/test_app_browser.py does. On a machine
without a graphics card that takes some minutes.
"""

import os
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from browser import Tab, chromium, until  # noqa: E402

from gaussian_trimmer import formats, sample  # noqa: E402
from gaussian_trimmer.app.serving import serving  # noqa: E402

FOLDER = ROOT / "docs" / "images" / "app"
SIZE = (1280, 720)
QUALITY = 85
SHOWN = 60_000
DRAWING = 4_000
"""Milliseconds that software rendering may take until what is shown is drawn."""


def main() -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    scene = formats.read(sample.SCENE)
    lighthouse = np.median(scene.means[np.load(sample.SELECTION)], axis=0).astype(float)
    with TemporaryDirectory() as folder, chromium() as browser:
        for path in (sample.SCENE, sample.CAMERAS):
            shutil.copy(path, folder)
        os.chdir(folder)  # so that the pictures show no machine's paths
        walk(browser, lighthouse, Path(folder) / "state")
        os.chdir(ROOT)


def walk(browser: Any, lighthouse: Any, state: Path) -> None:
    """From opening to the object elsewhere."""
    with serving(Path(sample.SCENE.name), Path(sample.CAMERAS.name), port=0, most=SHOWN, state=state) as app:
        tab = Tab(browser, app, *SIZE)
        tab.wait("59,472 Gaussians")
        save(tab, "open")

        tab.press("Click")
        tab.wait("Click on the object")
        tab.page.mouse.click(*tab.place(lighthouse))
        tab.wait("an object that stands on a surface")
        save(tab, "marked")

        tab.press("Cut out")
        tab.wait("is cut out:")
        tab.press("Checker")
        tab.press("Brush")
        x, y = tab.place(lighthouse)
        tab.page.mouse.move(x, y)
        save(tab, "cut_out")

        tab.press("Scene without it")
        tab.press("Changes")
        save(tab, "without")

        tab.press("Black")
        tab.page.keyboard.press("Home")
        tab.page.keyboard.press("1")
        handle = tab.page.locator("#gesture-overlay circle.gizmo.handle.y").bounding_box()
        drag(tab, (handle["x"] + 8, handle["y"] + 8), (handle["x"] + 8, handle["y"] + 28))  # along the table
        tab.wait("lies here")
        save(tab, "moved")


def drag(tab: Tab, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Press at a place of the page, and let go at another one."""
    tab.page.mouse.move(*start)
    tab.page.mouse.down()
    tab.page.mouse.move(*end, steps=4)
    tab.page.mouse.up()


def save(tab: Tab, name: str) -> None:
    """Write what the page shows, once it is drawn."""
    until(lambda: not tab.app.controller.jobs.worker.busy, "the program to finish")
    tab.page.wait_for_timeout(DRAWING)
    picture = tab.picture(0, 0, *SIZE)[..., ::-1]
    assert cv2.imwrite(str(FOLDER / f"{name}.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


if __name__ == "__main__":
    main()
