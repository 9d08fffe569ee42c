"""The page of views turns clicks and boxes into a command, in a browser."""

import cv2
import numpy as np
import pytest
from browser import chromium

from gaussian_trimmer.cameras import Camera, intrinsics
from gaussian_trimmer.output.view_listing import page

pytestmark = pytest.mark.needs("browser")


@pytest.fixture(scope="module")
def listing(tmp_path_factory):
    folder = tmp_path_factory.mktemp("views")
    assert cv2.imwrite(str(folder / "000.png"), np.zeros((100, 200, 3), np.uint8))
    camera = Camera(np.eye(4), intrinsics(1.0, 200, 100), 200, 100)
    text = page([camera], range(1), ["gaussian-trimmer", "select", "my scene.ply", "--trim", "trimmed/my scene"])
    (folder / "index.html").write_text(text, encoding="utf-8")
    with chromium() as browser:
        yield browser.new_page(), (folder / "index.html").as_uri()


@pytest.mark.parametrize(
    ("held", "ticked", "mark"),
    [
        ([], False, "--click"),
        (["Shift"], False, "--click"),
        (["Control"], False, "--remove-click"),
        (["Meta"], False, "--remove-click"),
        ([], True, "--remove-click"),
        (["Shift"], True, "--click"),
    ],
)
def test_control_removes_and_shift_adds(listing, held, ticked, mark):
    tab, address = listing
    tab.goto(address)
    tab.set_checked("#remove", ticked)
    box = tab.locator(".view").bounding_box()
    tab.locator(".view").click(position={"x": 0.5025 * box["width"], "y": 0.255 * box["height"]}, modifiers=held)
    command = tab.input_value("#command")
    start = "gaussian-trimmer select 'my scene.ply' --trim 'trimmed/my scene' --view-index 0 "
    assert command == f"{start}{mark} 100 25"
