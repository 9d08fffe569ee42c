"""All pictures of the documentation, made by the program from its sample and benchmark scenes.

    pip install ".[test,app]" playwright && python docs/site/pictures.py

Chromium, which draws pages and app, must be on the path. The parts run by themselves, too: `figures.py`, `walk.py` and
`app_pictures.py`.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

import app_pictures
import cv2
import figures
import numpy as np
import walk
from PIL import Image
from playwright.sync_api import sync_playwright

import gaussian_trimmer as gt
from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.cli import main as run
from gaussian_trimmer.finding.plan import draw_plan
from gaussian_trimmer.output.pictures import BACKDROP, as_picture, captioned
from gaussian_trimmer.planning.virtual_cameras import PlanConfig, plan_cameras
from gaussian_trimmer.rendering import get_renderer

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "images"
ROBOT = ROOT / "tests" / "fixtures" / "playbot" / "lod-meta.json"
FLAT = 3, 400_000
"""Seed of the flat whose furniture is found, and about how many Gaussians it has."""
FLAGS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
SIZE = {"width": 1280, "height": 760}
CELL, STEP, LINE, WIDTH = 320, 324, 26, 3 * 320
CAPTIONS = ("rough selection", "trimmed object", "the scene without it")
EMPTIED = ("armchair", "table", "plant")
"""What leaves the furnished room."""
UP = np.array([0.0, 0.0, 1.0])
STEPS = 48
"""Pictures of one turn around the sample."""


def main() -> None:
    """Make every picture anew."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    figures.main(figures.FOLDER)
    walk.main(walk.FOLDER)
    with tempfile.TemporaryDirectory() as folder:
        assert run(["demo", "--quiet", "--output", f"{folder}/demo"]) == 0
        _draw_turning(Path(folder) / "demo")
        _draw_report(Path(folder) / "demo")
        _draw_found(Path(folder))
    _draw_emptied()
    app_pictures.main()


def _draw_turning(folder: Path) -> None:
    """Walk around the sample: its rough selection, the object and the scene without it, in one moving picture."""
    scene, rough = (files("gaussian_trimmer") / "sample" / name for name in ("scene.ply", "lighthouse_rough.npy"))
    gaussians = gt.read(str(scene))
    selected = gaussians.select(gt.read_selection(str(rough), gaussians))
    shown = [selected, gt.read(folder / "object.ply"), gt.read(folder / "background.ply")]
    plan = PlanConfig(views=STEPS, size=CELL, pitch_degrees=20)
    cameras, renderer = plan_cameras(shown[1], UP, plan)[0], get_renderer("auto")
    frames = []
    for camera in cameras:
        pictures = [as_picture(renderer.render(gaussians, camera, background=BACKDROP).rgb) for gaussians in shown]
        cells = [captioned(*cell) for cell in zip(CAPTIONS, pictures, strict=True)]
        frames.append(Image.fromarray(np.hstack(cells)[..., ::-1]))
    how = {"save_all": True, "append_images": frames[1:], "duration": 100, "loop": 0, "quality": 70, "method": 6}
    frames[0].save(FOLDER / "turning.webp", **how)


def _draw_found(folder: Path) -> None:
    """Click on the robot of a file that others made, and find the furniture of a flat."""
    robot = ["select", str(ROBOT), "--view-index", "5", "--click", "335", "290", "--output", f"{folder}/robot.npy"]
    assert run([*robot, "--trim", f"{folder}/robot", "--quiet"]) == 0
    _write("robot.jpg", front_picture(cv2.imread(f"{folder}/robot/before_after.png"), (2,)))
    from flats import make_flat

    found = gt.find_objects(make_flat(*FLAT).gaussians, up="z")
    _write("plan.jpg", draw_plan(found, get_renderer("auto")))


def _draw_emptied() -> None:
    """Take furniture out of a room that is made of Gaussians, and look at it from eye height."""
    from rooms import make_room

    room, lens = make_room("furnished"), intrinsics(np.radians(64), WIDTH // 2, 400)
    eye, target = np.array([-1.9, 3.2, 1.55]), np.array([0.4, 0.4, 0.8])
    camera, renderer = Camera(look_at(eye, target, UP), lens, WIDTH // 2, 400), get_renderer("auto")
    things = {name: room.labels[:, room.names.index(name)] > 0 for name in EMPTIED}
    result = gt.trim_objects(room.gaussians, things, cameras=room.training, up="z")
    scenes = {"the room": room.gaussians, f"without {', '.join(EMPTIED)}": result.background}
    cells = [captioned(name, as_picture(renderer.render(scene, camera).rgb)) for name, scene in scenes.items()]
    _write("emptied.jpg", np.hstack(cells))


def _write(name: str, picture: np.ndarray) -> None:
    scale = min(1, WIDTH / picture.shape[1])
    picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(FOLDER / name), picture, [cv2.IMWRITE_JPEG_QUALITY, 85])


def front_picture(before_after: np.ndarray, columns: Sequence[int]) -> np.ndarray:
    """Selection, object and scene side by side, large enough to be read on the front page."""
    rows = [before_after[2 * LINE + i * (CELL + LINE) :][:CELL] for i in range(len(CAPTIONS))]
    cells = [np.vstack([row[:, STEP * column : STEP * column + CELL] for column in columns]) for row in rows]
    heads = [np.full((36, CELL, 3), 32, np.uint8) for _ in CAPTIONS]
    for head, caption in zip(heads, CAPTIONS, strict=True):
        cv2.putText(head, caption, (10, 25), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (235, 235, 235), 1, cv2.LINE_AA)
    return np.hstack([np.vstack([head, cell]) for head, cell in zip(heads, cells, strict=True)])


def _draw_report(folder: Path) -> None:
    """Open the report of a trim, and take a picture of where one looks first."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport=SIZE)
        page.goto((folder / "report.html").as_uri())
        page.locator(".pair input").first.fill("60")
        page.wait_for_timeout(1000)
        page.screenshot(path=FOLDER / "report.jpg", type="jpeg", quality=80)
        browser.close()


if __name__ == "__main__":
    main()
