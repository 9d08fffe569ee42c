"""The pictures of `docs/report.md`: its pages of the sample scene, as Chromium shows them.

    pip install playwright && python docs/site/page_pictures.py

They replace those in `docs/images`. Chromium must be on the path.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from gaussian_trimmer.cli import main

FOLDER = Path(__file__).parents[1] / "images"
FLAGS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
SIZE = {"width": 1280, "height": 760}


def draw(folder: Path) -> None:
    """Trim the sample, open its report, and take a picture of where one looks first."""
    assert main(["demo", "--quiet", "--output", str(folder / "demo")]) == 0
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport=SIZE)
        page.goto((folder / "demo" / "report.html").as_uri())
        page.locator(".pair input").first.fill("60")
        page.wait_for_timeout(1000)
        page.screenshot(path=FOLDER / "report.jpg", type="jpeg", quality=80)
        browser.close()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        draw(Path(folder))
