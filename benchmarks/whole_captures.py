"""What people wait for in whole captures, and in larger ones made of copies of them; see `speed.py`.

Each task runs in a process of its own. A task's figures are those of the work alone, without reading the file, but for
peak memory, which is that of the process.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from waits import SOURCES, said_in_process, sources_of

import gaussian_trimmer as gt

SIZES = (1_500_000, 3_000_000, 12_000_000)
"""Numbers of Gaussians of copies of a capture side by side."""
_SMALL_REACH = 4
"""The small scene is what lies so many times as far from the thing as its own half size."""
_OBJECTS_REMOVED = 20
_FIELD_OF_VIEW = np.radians(60)
_WIDTH, _HEIGHT = 640, 480
_STAND_OFF = 3.0
"""Distance of the camera from the thing, in half sizes of it."""
_FIGURES = ("seconds", "processor", "peak_bytes")
_ONCE = ("objects", "background without 20 objects")


@dataclass(frozen=True)
class Wait:
    """What is measured, and on what."""

    task: str
    scene: str
    at: tuple[float, float, float]
    """Middle of a thing."""
    reach: float
    """Half its size, in scene units."""
    up: tuple[float, float, float]
    found: str
    """Where the labels of found objects are kept between the processes."""

    def view(self) -> Any:
        """A view of the thing, obliquely from above, in which only its surroundings are drawn."""
        from gaussian_trimmer.cameras import Camera, Viewpoint, intrinsics, look_at

        up, at = np.array(self.up), np.array(self.at)
        level = np.linalg.svd(up[None])[2][1]
        position = at + _STAND_OFF * self.reach * (level + up) / np.sqrt(2)
        pinhole = intrinsics(_FIELD_OF_VIEW, _WIDTH, _HEIGHT)
        camera = Camera(look_at(position, at, up), pinhole, _WIDTH, _HEIGHT, near=0.02 * self.reach)
        return Viewpoint(camera, self.at, 0.95 * _STAND_OFF * self.reach)


def _measured(work: Callable[[], Any], warm_runs: int = 0) -> dict[str, float]:
    """Seconds and processor seconds of the first run, or medians of later ones."""
    figures = []
    for _ in range(warm_runs + 1):
        start, processor_start = time.perf_counter(), time.process_time()
        work()
        figures.append((time.perf_counter() - start, time.process_time() - processor_start))
    seconds, processor = (median(column[min(warm_runs, 1) :]) for column in zip(*figures, strict=True))
    return {"seconds": seconds, "processor": processor}


def read(wait: Wait) -> dict[str, float]:
    return _measured(lambda: gt.read(wait.scene))


def click(wait: Wait) -> dict[str, float]:
    scene = gt.read(wait.scene)
    mark = gt.marks.Click(_WIDTH // 2, _HEIGHT // 2, wait.view())
    return _measured(lambda: gt.select(scene, [mark], up=wait.up), warm_runs=3)


def box(wait: Wait) -> dict[str, float]:
    scene = gt.read(wait.scene)
    half = int(0.5 * _HEIGHT / np.tan(_FIELD_OF_VIEW / 2) / _STAND_OFF)
    x, y = _WIDTH // 2, _HEIGHT // 2
    mark = gt.marks.Box(x - half, y - half, x + half, y + half, wait.view())
    return _measured(lambda: gt.select(scene, [mark], up=wait.up), warm_runs=3)


def _near(scene: Any, wait: Wait, reach: float) -> Any:
    return np.linalg.norm(scene.means - np.array(wait.at, np.float32), axis=1) < reach


def trim(wait: Wait) -> dict[str, float]:
    """A warm trim of a ball around the thing."""
    scene = gt.read(wait.scene)
    selection = _near(scene, wait, wait.reach)
    return _measured(lambda: gt.trim(scene, selection, up=wait.up), warm_runs=3)


def trim_in_surroundings(wait: Wait) -> dict[str, float]:
    """The same trim in a scene of the surroundings alone, which the whole one is held against."""
    whole = gt.read(wait.scene)
    scene = whole.select(np.flatnonzero(_near(whole, wait, _SMALL_REACH * wait.reach)))
    selection = _near(scene, wait, wait.reach)
    return _measured(lambda: gt.trim(scene, selection, up=wait.up), warm_runs=3)


def objects(wait: Wait) -> dict[str, float]:
    scene, found = gt.read(wait.scene), []
    figures = _measured(lambda: found.append(gt.find_objects(scene, up=wait.up)))
    if not Path(wait.found).exists():
        chosen = [each.id for each in found[0].objects if each.kind == "object"][:_OBJECTS_REMOVED]
        np.save(wait.found, np.where(np.isin(found[0].labels, chosen), found[0].labels, 0))
    return figures


def empty(wait: Wait) -> dict[str, float]:
    """Trim found objects together and fill one background in which all of them are gone."""
    scene, labels = gt.read(wait.scene), np.load(wait.found)
    selections = {str(number): labels == number for number in np.unique(labels[labels > 0])}
    return _measured(lambda: gt.trim_objects(scene, selections, up=wait.up))


TASKS: dict[str, Callable[[Wait], dict[str, float]]] = {
    "read": read,
    "click": click,
    "box": box,
    "trim": trim,
    "trim in its surroundings alone": trim_in_surroundings,
    "objects": objects,
    "background without 20 objects": empty,
}


def measure(
    capture: Path,
    at: tuple[float, float, float],
    reach: float,
    up: tuple[float, float, float],
    sizes: tuple[int, ...],
    runs: int,
    against: str,
) -> Iterator[dict[str, Any]]:
    """A record for each task and size: medians of this version, and seconds and their ratio to another's in turn.

    Finding is measured once, and where nothing was copied: what it takes grows with what there is to find. A size below
    the capture's own stands for the capture itself.
    """
    with tempfile.TemporaryDirectory(prefix="captures-") as folder, sources_of(against) as before:
        versions = {"before": before, "now": SOURCES} if before else {"now": SOURCES}
        for number, size in enumerate(sizes):
            made = Path(folder) / "capture.ply"
            subprocess.run([sys.executable, __file__, "enlarge", capture.absolute(), made, str(size)], check=True)
            for task in TASKS:
                if task in _ONCE and number:
                    continue
                wait = Wait(task, str(made), at, reach, up, f"{folder}/found.npy")
                figures: dict[str, list[dict[str, float]]] = {version: [] for version in versions}
                for _ in range(1 if task in _ONCE else runs):
                    for version in reversed(versions):
                        figures[version].append(_in_process(wait, versions[version]))
                yield _record(task, size, figures)


def _record(task: str, size: int, figures: dict[str, list[dict[str, float]]]) -> dict[str, Any]:
    now = figures["now"]
    record: dict[str, Any] = {"task": task, "million": size / 1e6}
    record |= {name: median(each[name] for each in now) for name in _FIGURES}
    if "before" in figures:
        before = [each["seconds"] for each in figures["before"]]
        record["before"] = median(before)
        record["ratio"] = median(each["seconds"] / then for each, then in zip(now, before, strict=True))
    return record


def _in_process(wait: Wait, sources: Path) -> dict[str, float]:
    said = said_in_process(__file__, wait, sources, OPENBLAS_NUM_THREADS="1")
    if said is None:
        return dict.fromkeys(_FIGURES, float("nan"))
    figures: dict[str, float] = json.loads(said)
    return figures


def _enlarge(capture: Path, made: Path, size: int) -> None:
    from synthetic_scenes import copied

    scene = gt.read(capture)
    gt.write(copied(scene, np.ones(len(scene), bool), size)[0], made)


if __name__ == "__main__":
    if sys.argv[1] == "enlarge":
        _enlarge(Path(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4]))
    else:
        asked = Wait(**json.loads(sys.argv[1]))
        measured = TASKS[asked.task](asked)
        peak_bytes = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(json.dumps(measured | {"peak_bytes": peak_bytes}))
