"""How long does the app take from a mark to new colours, and how much longer than the trimmer alone to trim?

    python benchmarks/app.py SCENE [--objects NAME ...] [--runs 3]

SCENE is a benchmark scene (see benchmark_scenes.py). The app runs as it does for a browser, but
nobody looks: times end when the new colours have been handed to the connection, the drawing in the browser is not in
them. Marks are made in the training view whose mask of the object is largest: a click on the pixel farthest from the
mask's edge, the mask's bounding box, a second click that takes something away, and at the clicked point a dab of the
brush and a box in space. A trim is timed in pairs, by the app and by the library alone.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import tyro

from gaussian_trimmer.app.controller import Controller
from gaussian_trimmer.app.serving import serving
from gaussian_trimmer.app.viewpoints import surface_points
from gaussian_trimmer.geometry.distances import distance_to_outside
from gaussian_trimmer.selecting.marks import Box, Box3D, Click, Mark, Sphere, Viewpoint
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.views import bounding_box

_RADIUS = 0.03
"""Radius of the brush, relative to the distance from the camera."""


@dataclass(frozen=True)
class Arguments:
    """Measure how fast the app answers."""

    scene: tyro.conf.Positional[Path]
    """Folder of a benchmark scene."""
    objects: tuple[str, ...] = ()
    """Only these objects."""
    runs: int = 3
    """Repetitions, of which the median is taken; one more warms up."""


def main() -> None:
    """Time marks and trims for each object."""
    arguments = tyro.cli(Arguments)
    names = arguments.objects or tuple(sorted(path.name for path in (arguments.scene / "masks").iterdir()))
    load = os.getloadavg()[0]
    print(
        f"{len(os.sched_getaffinity(0))} processors, load {load:.1f} at the start; seconds, median of {arguments.runs}"
    )
    print(
        f"{'object':10s} {'click':>7s} {'box':>7s} {'again':>7s} {'brush':>7s} {'box 3d':>7s} {'app':>7s} {'trim':>7s}"
    )
    paths = arguments.scene / "scene.ply", arguments.scene / "cameras.json"
    with TemporaryDirectory() as state, serving(*paths, port=0, state=Path(state)) as app:
        _wait(app.controller)
        for name in names:
            marks = _marks(app.controller, arguments.scene, name)
            times = {kind: _marking(app.controller, before, mark, arguments.runs) for kind, before, mark in marks}
            of_app, alone = _trimming(app.controller, marks[0][2], arguments.runs)
            row = [*times.values(), of_app, alone]
            print(f"{name:10s} " + " ".join(f"{value:7.3f}" for value in row), flush=True)


def _marks(controller: Controller, folder: Path, name: str) -> list[tuple[str, list[Mark], Mark]]:
    """Kinds of marks, with the marks that come before them."""
    document = controller.session.document
    assert document.cameras is not None
    cameras = {camera.name: camera for camera in document.cameras.cameras}
    masks = _masks(folder / "masks" / name)
    view = max(masks, key=lambda view: np.count_nonzero(masks[view]))
    camera, mask = cameras[view], masks[view]
    y, x = np.unravel_index(np.argmax(distance_to_outside(mask)), mask.shape)
    viewpoint = Viewpoint(camera)
    click = Click(int(x), int(y), viewpoint)
    box = Box(*bounding_box(mask), viewpoint)
    place = [(x + 0.5) / camera.width, (y + 0.5) / camera.height]
    (point,) = surface_points(document.scene, viewpoint, [place], document.renderer)
    assert point is not None
    radius = _RADIUS * float(np.linalg.norm(np.array(point) - camera.centre))
    low, high = (np.array(point) + side * 3 * radius for side in (-1, 1))
    cube = Box3D((low[0], low[1], low[2]), (high[0], high[1], high[2]))
    ball = Sphere(point, radius)
    return [
        ("click", [], click), ("box", [], box), ("again", [cube], Click(int(x), int(y), viewpoint, "remove")),
        ("brush", [click], ball), ("box3d", [], cube),
    ]  # fmt: skip


def _masks(folder: Path) -> dict[str, np.ndarray[tuple[int, ...], np.dtype[np.bool_]]]:
    return {
        path.name: np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)) > 127 for path in sorted(folder.iterdir())
    }


def _marking(controller: Controller, before: list[Mark], mark: Mark, runs: int) -> float:
    """Median time from a mark to new colours."""
    times = []
    for _ in range(runs + 1):
        controller.session.clear()
        if before:
            controller.session.mark(*before)
        _do(controller, lambda: "")
        times.append(_do(controller, lambda: controller.session.mark(mark)))
    return median(times[1:])


def _trimming(controller: Controller, mark: Mark, runs: int) -> tuple[float, float]:
    """Median times of a trim by the app, with its colours, and by the library alone, in turn."""
    session = controller.session
    session.clear()
    session.mark(mark)
    _do(controller, lambda: "")
    document, mask = session.document, session.now.object.selected.mask
    by_app, alone = [], []
    for _ in range(runs + 1):
        start = time.perf_counter()
        controller.do("Trimming", controller.trim)
        _wait(controller)
        by_app.append(time.perf_counter() - start)
        start = time.perf_counter()
        trim(document.scene, mask, cameras=document.cameras)
        alone.append(time.perf_counter() - start)
        session.undo()
    return median(by_app[1:]), median(alone[1:])


def _do(controller: Controller, work: Callable[[], str]) -> float:
    """Have the app do something; returns the time until what came of it was handed to the connection."""
    start = time.perf_counter()
    controller.do("Marking", work)
    _wait(controller)
    return time.perf_counter() - start


def _wait(controller: Controller) -> None:
    """Wait until all that was given to the app is done."""
    done = threading.Event()
    controller.worker.submit(done.set)
    done.wait()


if __name__ == "__main__":
    main()
