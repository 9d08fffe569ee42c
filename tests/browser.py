"""A headless Chromium, pages in it, and tabs with the app; tests that need it are marked `needs("browser")`."""

import shutil
import time
from contextlib import contextmanager

import cv2
import numpy as np

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PATIENCE = 200
"""Seconds: software rendering on a busy machine is slow."""
LOST = 40
"""Seconds after which what got no answer never arrived."""

FLAGS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]


def installed():
    """Path of the browser; None where there is none."""
    return next((path for path in map(shutil.which, NAMES) if path), None)


@contextmanager
def chromium():
    """The browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=installed(), args=FLAGS)
        yield browser
        browser.close()


@contextmanager
def opened(browser, path, *, width=1366, height=768, **options):
    """A page from a file, without a network; it must not have complained of anything, or asked for anything else."""
    complaints, asked = [], []
    context = browser.new_context(viewport={"width": width, "height": height}, offline=True, **options)
    page = context.new_page()
    page.set_default_timeout(20_000)
    page.on("console", lambda message: complaints.append(message.text) if message.type in ("error", "warning") else 0)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("dialog", lambda dialog: (complaints.append(f"dialog: {dialog.message}"), dialog.dismiss()))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(path.as_uri())
    yield page
    context.close()
    assert complaints == []
    assert [url for url in asked if not url.startswith(("data:", "blob:"))] == [path.as_uri()]


def screenshot(element, **options):
    """What an element or a page shows, BGR (H, W, 3)."""
    return cv2.imdecode(np.frombuffer(element.screenshot(**options), np.uint8), cv2.IMREAD_COLOR)


def differ(a, b):
    """Share of the pixels in which two pictures differ visibly."""
    return float((np.abs(a.astype(int) - b).max(axis=2) > 24).mean())


class Tab:
    """One tab with the app. The page must not complain of anything."""

    def __init__(self, browser, app, width=1366, height=768):
        self.app = app
        self.page = browser.new_page(viewport={"width": width, "height": height})
        self.page.set_default_timeout(1000 * PATIENCE)
        self.errors = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda message: self.errors.append(message.text))
        self.page.goto(app.address)

    def wait(self, text):
        """Until the page shows a text."""
        self.page.get_by_text(text).first.wait_for()

    def until_said(self, act, text):
        """Do something again and again until the page shows a text.

        The browser shows that it waits for a click or a key a moment before it does, and longer on a busy machine.
        """
        from playwright.sync_api import TimeoutError as Late

        for seconds in (LOST, LOST, PATIENCE):
            act()
            try:
                self.page.get_by_text(text).first.wait_for(timeout=1000 * seconds)
            except Late:
                continue
            return
        raise AssertionError(f"the page never said '{text}'")

    def panel(self, name):
        """Open a part of the panel."""
        self.page.locator("#gt-panel details", has=self.page.locator(f"summary:text-is('{name}')")).evaluate(
            "part => (part.open = true)"
        )

    def press(self, button):
        """Press a button by its label."""
        self.page.get_by_role("button", name=button, exact=True).click()

    def write(self, label, text):
        """Write into the field with this label."""
        field = self.field(label)
        field.fill(text)
        field.blur()

    def field(self, label):
        """The field with this label."""
        return self.page.get_by_role("textbox", name=label, exact=True)

    def place(self, point):
        """Pixels of the page at which a point of the scene shows."""
        shown = self.app.controller.jobs.view.frame.to_viewer(np.array(point, np.float64))
        where = self.evaluate(f"canvas.project({shown.tolist()})")
        return where["x"], where["y"]

    def evaluate(self, what):
        """What something of the page's own is."""
        return self.page.evaluate(f"gaussianTrimmer.{what}")

    def colour(self, point, half=3):
        """Mean colour of the page around a point of the scene, (3,), 0 to 255."""
        x, y = self.place(point)
        return self.picture(x - half, y - half, 2 * half, 2 * half).mean(axis=(0, 1))

    def picture(self, x, y, width, height):
        """A part of the page, (H, W, 3)."""
        return screenshot(self.page, clip={"x": x, "y": y, "width": width, "height": height})[..., ::-1]

    def until_colour(self, point, test):
        """Wait until the colour at a point passes a test; returns it."""
        until(lambda: test(self.colour(point)), lambda: f"another colour than {self.colour(point)}")
        return self.colour(point)


def until(happened, what):
    """What a function returns once it is true."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        found = happened()
        if found:
            return found
        time.sleep(0.2)
    raise AssertionError(f"waited in vain for {what() if callable(what) else what}")
