"""All pictures of the documentation, made by the program from its sample and benchmark scenes.

    pip install ".[test,app]" playwright && python docs/site/pictures.py seal.splat

The capture of a seal (MIT) is on github.com/quadjr/aframe-gaussian-splatting; without it, its picture stays. Chromium,
which draws pages and app, must be on the path. The parts run by themselves, too: `figures.py`, `walk.py` and
`app_pictures.py`.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
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
from gaussian_trimmer.finding.saving import draw_plan
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.output.pictures import Picture, as_picture, captioned, draw_gaussians
from gaussian_trimmer.rendering import render
from gaussian_trimmer.views.virtual_cameras import PlanConfig, plan_cameras

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "images"
ROBOT = ROOT / "tests" / "fixtures" / "playbot" / "lod-meta.json"
FLAT = 3, 400_000
"""Seed of the flat whose furniture is found, and about how many Gaussians it has."""
FLAGS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
SIZE = {"width": 1280, "height": 760}
CELL, WIDTH = 320, 3 * 320
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
    _draw_found()
    _draw_emptied()
    _draw_clicked("robot", str(ROBOT), 4, (320, 270))
    for seal in sys.argv[1:]:
        _draw_clicked("seal", seal, 4, (310, 340))
    app_pictures.main()


def _draw_turning(folder: Path) -> None:
    """Walk around the sample: its rough selection, the object and the scene without it, in one moving picture."""
    scene, rough = (files("gaussian_trimmer") / "sample" / name for name in ("scene.ply", "lighthouse_rough.npy"))
    gaussians = gt.read(str(scene))
    selected = gaussians.select(gt.read_selection(str(rough), gaussians))
    plan = PlanConfig(views=STEPS, size=CELL, pitch_degrees=20)
    rows = _draw_around(folder, UP, plan, "rough selection", selected)
    frames = [Image.fromarray(row[..., ::-1]) for row in rows]
    how = {"save_all": True, "append_images": frames[1:], "duration": 100, "loop": 0, "quality": 70, "method": 6}
    frames[0].save(FOLDER / "turning.webp", **how)


def _draw_clicked(name: str, capture: str, view: int, pixel: tuple[int, int]) -> None:
    """Click on an object of a file that others made, and trim it."""
    with tempfile.TemporaryDirectory() as folder:
        where = ["--view-index", str(view), "--click", *map(str, pixel)]
        trim = ["--output", f"{folder}/{name}.npy", "--trim", f"{folder}/{name}", "--format", "ply", "--quiet"]
        assert run(["select", capture, *where, *trim]) == 0
        up = json.loads((Path(folder) / name / "report.json").read_text())["objects"][0]["up"]["direction"]
        plan = PlanConfig(views=1, size=CELL, fill=0.5, yaw_range_degrees=(170, 190))
        (row,) = _draw_around(Path(folder) / name, np.array(up), plan, "the capture", gt.read(capture))
        _write(f"{name}.jpg", row)


def _draw_around(folder: Path, up: Float64Array, plan: PlanConfig, before: str, given: gt.Gaussians) -> list[Picture]:
    """What was given, the object of a trim and the scene without it, side by side from around the object."""
    trimmed, background = gt.read(folder / "object.ply"), gt.read(folder / "background.ply")
    shown = {before: given, "trimmed object": trimmed, "the scene without it": background}
    return [
        np.hstack([captioned(name, draw_gaussians(scene, camera)) for name, scene in shown.items()])
        for camera in plan_cameras(trimmed, up, plan)[0]
    ]


def _draw_found() -> None:
    """Find the furniture of a flat."""
    from flats import make_flat

    found = gt.find_objects(make_flat(*FLAT).gaussians, up="z")
    _write("plan.jpg", draw_plan(found))


def _draw_emptied() -> None:
    """Take furniture out of a room that is made of Gaussians, and look at it from eye height."""
    from rooms import make_room

    room, lens = make_room("furnished"), intrinsics(np.radians(64), WIDTH // 2, 400)
    eye, target = np.array([-1.9, 3.2, 1.55]), np.array([0.4, 0.4, 0.8])
    camera = Camera(look_at(eye, target, UP), lens, WIDTH // 2, 400)
    things = {name: room.labels[:, room.names.index(name)] > 0 for name in EMPTIED}
    result = gt.trim_objects(room.gaussians, things, cameras=room.training, up="z")
    scenes = {"the room": room.gaussians, f"without {', '.join(EMPTIED)}": result.background}
    cells = [captioned(name, as_picture(render(scene, camera).rgb)) for name, scene in scenes.items()]
    _write("emptied.jpg", np.hstack(cells))


def _write(name: str, picture: np.ndarray) -> None:
    scale = min(1, WIDTH / picture.shape[1])
    picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(FOLDER / name), picture, [cv2.IMWRITE_JPEG_QUALITY, 85])


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
