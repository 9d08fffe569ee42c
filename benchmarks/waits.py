"""What people wait for: the command, trims, clicks, batches, and tasks in whole captures; see `speed.py`.

Each task runs in a process of its own; its figures are those of the work alone, but for peak memory, which is that of
the process. Times of another commit are taken in turn with those of this one, from its sources in a worktree of their
own, so that both meet the same machine. Ratios of such pairs hold where seconds change from hour to hour.

Only the package's public names and what has stood for long are used here, so that old commits can be measured, too.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np

import gaussian_trimmer as gt

SOURCES = Path(__file__).parents[1]
_MARKS: Any = gt.marks
"""Here every commit has its viewpoints, wherever they are defined."""
SIZES = (1_500_000, 3_000_000, 12_000_000)
"""Numbers of Gaussians of copies of a capture side by side."""
_WARM_RUNS = 3
_MILLION, _LARGE = 1_000_000, 3_000_000
_COPIES = 4
_SMALL_REACH = 4
"""The small scene is what lies so many times as far from the thing as its own half size."""
_OBJECTS_REMOVED = 20
_FIELD_OF_VIEW = np.radians(60)
_WIDTH, _HEIGHT = 640, 480
_STAND_OFF = 3.0
"""Distance of the camera from the thing, in half sizes of it."""
Figures = dict[str, float]
"""Seconds, processor seconds and peak memory in bytes, by name."""
_FIGURES = ("seconds", "processor", "peak_bytes")


@dataclass(frozen=True)
class Wait:
    """What is measured, and on what."""

    task: str
    folder: str
    """Where files may be made; what one process leaves there another one finds."""
    root: str = ""
    """Folder of a benchmark scene, or a splat file of a whole capture."""
    object: str = ""
    """One of the benchmark scene's objects."""
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Middle of a thing in the capture."""
    reach: float = 0.0
    """Half the thing's size, in scene units."""
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Up vector of the capture."""

    def scene(self) -> Any:
        root = Path(self.root)
        return gt.read(root / "scene.ply" if root.is_dir() else root)

    def cameras(self) -> Any:
        return gt.read_cameras(Path(self.root) / "cameras.json")

    @property
    def objects(self) -> list[str]:
        return sorted({path.name.removesuffix(".npz") for path in (Path(self.root) / "coarse").iterdir()})

    def selection(self, name: str = "") -> Any:
        place = Path(self.root) / "coarse" / (name or self.object)
        packed = place.with_suffix(".npz")
        return np.load(packed)["dilated"] if packed.exists() else np.load(place / "dilated.npy")

    def file(self, name: str, make: Callable[[Path], None]) -> Path:
        """A file of the folder, made if it is not there yet."""
        path = Path(self.folder) / name
        if not path.exists():
            make(path)
        return path

    def view(self) -> Any:
        """A view of the thing, obliquely from above, in which only its surroundings are drawn."""
        from gaussian_trimmer.cameras import Camera, intrinsics, look_at

        up, at = np.array(self.up), np.array(self.at)
        level = np.linalg.svd(up[None])[2][1]
        position = at + _STAND_OFF * self.reach * (level + up) / np.sqrt(2)
        pinhole = intrinsics(_FIELD_OF_VIEW, _WIDTH, _HEIGHT)
        camera = Camera(look_at(position, at, up), pinhole, _WIDTH, _HEIGHT, near=0.02 * self.reach)
        return _MARKS.Viewpoint(camera, self.at, 0.95 * _STAND_OFF * self.reach)


def _measured(work: Callable[[], Any], before: Callable[[], Any] = lambda: None, warm_runs: int = 0) -> Figures:
    """Seconds and processor seconds of the first run, or medians of later ones; what is done before does not count."""
    figures = []
    for _ in range(warm_runs + 1):
        before()
        start, processor_start = time.perf_counter(), _processor_seconds()
        work()
        figures.append((time.perf_counter() - start, _processor_seconds() - processor_start))
    seconds, processor = (median(column[min(warm_runs, 1) :]) for column in zip(*figures, strict=True))
    return {"seconds": seconds, "processor": processor}


def _processor_seconds() -> float:
    """Return what this process and those that it has waited for have used."""
    return sum(os.times()[:4])


_warm = partial(_measured, warm_runs=_WARM_RUNS)


def _run(*command: Any, **environment: str) -> Figures:
    words = [sys.executable, "-m", "gaussian_trimmer", *map(str, command)]
    return _measured(
        lambda: subprocess.run(words, check=True, stdout=subprocess.DEVNULL, env={**os.environ, **environment})
    )


def help_page(wait: Wait) -> Figures:
    return _run("--help")


def first_run(wait: Wait) -> Figures:
    """The demo where no kernel has been compiled yet."""
    with tempfile.TemporaryDirectory(dir=wait.folder) as empty:
        return _run("demo", "--output", f"{empty}/demo", "--quiet", NUMBA_CACHE_DIR=empty)


def command(wait: Wait) -> Figures:
    selection = wait.file(f"{wait.object}.npy", partial(_save_selection, wait, ""))
    root, output = Path(wait.root), Path(tempfile.mkdtemp(dir=wait.folder)) / "trimmed"
    return _run("trim", root / "scene.ply", selection, "--cameras", root / "cameras.json", "--output", output,
                "--quiet")  # fmt: skip


def trim(wait: Wait) -> Figures:
    """A trim, and the scene without the object."""
    return _warm(partial(_background, wait.scene(), wait.selection(), cameras=wait.cameras()))


def trim_alone(wait: Wait) -> Figures:
    """A trim by whoever wants the object alone; old commits make the background all the same."""
    scene, selection, cameras = wait.scene(), wait.selection(), wait.cameras()
    return _warm(lambda: gt.trim(scene, selection, cameras=cameras).object)


def _background(scene: Any, selection: Any, **given: Any) -> Any:
    return gt.trim(scene, selection, **given).background


def large_scene(wait: Wait) -> Figures:
    """The trim with copies of the scene beside it, three million Gaussians in all."""
    from synthetic_scenes import tiled

    scene, selection = tiled(wait.scene(), wait.selection(), _LARGE)
    return _warm(partial(_background, scene, selection, cameras=wait.cameras()))


def objects_together(wait: Wait) -> Figures:
    """Objects of the scene together, relative to the slowest of them alone."""
    scene, cameras = wait.scene(), wait.cameras()
    selections = {name: wait.selection(name) for name in wait.objects[:5]}
    alone = [_warm(partial(_background, scene, selection, cameras=cameras)) for selection in selections.values()]
    together = _warm(lambda: gt.trim_objects(scene, selections, cameras=cameras).background)
    return {name: value / max(one[name] for one in alone) for name, value in together.items()}


def click(wait: Wait, path: Path | None = None) -> Figures:
    """A click in the app's session, in the view that shows most of the object, where it is thickest."""
    from gaussian_trimmer.app import edits
    from gaussian_trimmer.app.session import Session
    from gaussian_trimmer.selecting.marks import Click

    root, session = Path(wait.root), Session()
    session.open(path or root / "scene.ply", root / "cameras.json")
    masks = {
        path.name: cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in (root / "masks" / wait.object).iterdir()
    }
    name = max(masks, key=lambda name: int(np.count_nonzero(np.asarray(masks[name]) > 127)))
    depth = cv2.distanceTransform((np.asarray(masks[name]) > 127).astype(np.uint8), cv2.DIST_L2, 5)
    y, x = np.unravel_index(int(np.argmax(depth)), depth.shape)
    document = session.document
    assert document.cameras is not None
    camera = next(camera for camera in document.cameras.cameras if Path(camera.name).name == name)
    mark = Click(int(x), int(y), _MARKS.Viewpoint(camera))
    return _warm(lambda: session.do(edits.mark, mark), lambda: session.do(edits.clear))


def click_in_a_million(wait: Wait) -> Figures:
    from synthetic_scenes import tiled

    def make(path: Path) -> None:
        gt.write(tiled(wait.scene(), wait.selection(), _MILLION)[0], path)

    return click(wait, wait.file("million.ply", make))


def batch(wait: Wait, *options: str) -> Figures:
    """Seconds an item of a batch takes on two processes: the objects of copies of the scene."""
    root = Path(wait.root)

    def copy_scene(path: Path) -> None:
        shutil.copyfile(root / "scene.ply", path)

    rows = ["scene,selection,cameras,name"]
    for copy in range(_COPIES):
        scene = wait.file(f"copy{copy}.ply", copy_scene)
        for name in wait.objects:
            file = wait.file(f"{name}.npy", partial(_save_selection, wait, name))
            rows.append(f"{scene},{file},{root / 'cameras.json'},{name}{copy}")
    manifest = Path(wait.folder) / "manifest.csv"
    manifest.write_text("\n".join(rows) + "\n")
    with tempfile.TemporaryDirectory(dir=wait.folder) as output:
        words = ["batch", manifest, "--output", f"{output}/out", "--quiet", "--workers", 2, *options]
        return {name: value / (len(rows) - 1) for name, value in _run(*words).items()}


def _save_selection(wait: Wait, name: str, path: Path) -> None:
    np.save(path, wait.selection(name))


def read(wait: Wait) -> Figures:
    return _measured(wait.scene)


def click_thing(wait: Wait) -> Figures:
    scene = wait.scene()
    mark = gt.marks.Click(_WIDTH // 2, _HEIGHT // 2, wait.view())
    return _warm(lambda: gt.select(scene, [mark], up=wait.up))


def box_thing(wait: Wait) -> Figures:
    scene = wait.scene()
    half = int(0.5 * _HEIGHT / np.tan(_FIELD_OF_VIEW / 2) / _STAND_OFF)
    x, y = _WIDTH // 2, _HEIGHT // 2
    mark = gt.marks.Box(x - half, y - half, x + half, y + half, wait.view())
    return _warm(lambda: gt.select(scene, [mark], up=wait.up))


def _near(scene: Any, wait: Wait, reach: float) -> Any:
    return np.linalg.norm(scene.means - np.array(wait.at, np.float32), axis=1) < reach


def trim_thing(wait: Wait) -> Figures:
    """A warm trim of a ball around the thing."""
    scene = wait.scene()
    selection = _near(scene, wait, wait.reach)
    return _warm(partial(_background, scene, selection, up=wait.up))


def trim_in_surroundings(wait: Wait) -> Figures:
    """The same trim in a scene of the surroundings alone, which the whole one is held against."""
    whole = wait.scene()
    scene = whole.select(np.flatnonzero(_near(whole, wait, _SMALL_REACH * wait.reach)))
    selection = _near(scene, wait, wait.reach)
    return _warm(partial(_background, scene, selection, up=wait.up))


def objects(wait: Wait) -> Figures:
    scene, found = wait.scene(), []
    figures = _measured(lambda: found.append(gt.find_objects(scene, up=wait.up)))
    labels = Path(wait.folder) / "found.npy"
    if not labels.exists():
        chosen = [each.id for each in found[0].objects if each.kind == "object"][:_OBJECTS_REMOVED]
        np.save(labels, np.where(np.isin(found[0].labels, chosen), found[0].labels, 0))
    return figures


def empty(wait: Wait) -> Figures:
    """Trim found objects together and fill one background in which all of them are gone."""
    scene, labels = wait.scene(), np.load(Path(wait.folder) / "found.npy")
    selections = {str(number): labels == number for number in np.unique(labels[labels > 0])}
    return _measured(lambda: gt.trim_objects(scene, selections, up=wait.up).background)


TASKS: dict[str, Callable[[Wait], Figures]] = {
    "first run": first_run,
    "--help": help_page,
    "command": command,
    "trim": trim,
    "trim, the object alone": trim_alone,
    "trim in a scene of 3 million": large_scene,
    "up to five objects together, in trims of the slowest": objects_together,
    "click": click,
    "click in a scene of 1 million": click_in_a_million,
    "batch, an item on two processes": batch,
    "batch without backgrounds": lambda wait: batch(wait, "--options", "--no-write-background"),
}
OF_AN_OBJECT = ("command", "trim", "trim, the object alone", "trim in a scene of 3 million", "click")
"""Tasks that are measured for each object."""


OF_A_CAPTURE: dict[str, Callable[[Wait], Figures]] = {
    "read": read,
    "click": click_thing,
    "box": box_thing,
    "trim": trim_thing,
    "trim in its surroundings alone": trim_in_surroundings,
    "objects": objects,
    "background without 20 objects": empty,
}
_ONCE = ("objects", "background without 20 objects")


def measure(
    root: Path, objects: Sequence[str], runs: int, against: str, left_out: Sequence[str]
) -> Iterator[dict[str, Any]]:
    """A record for each task: medians in seconds of this version and the other, and of the ratios of pairs."""
    with tempfile.TemporaryDirectory(prefix="waits-") as folder, versions_with(against) as versions:
        place = str(root.absolute())
        for sources in versions.values():  # compiles the kernels, and those of large objects
            for task in ("command", "click"):
                _in_process(Wait(task, folder, place, objects[-1]), sources)
        for task in TASKS:
            for name in objects if task in OF_AN_OBJECT else objects[:1]:
                if task not in left_out:
                    named = f"{task}, {name}" if task in OF_AN_OBJECT else task
                    yield {"task": named, **_figures(Wait(task, folder, place, name), versions, runs)}


def measure_capture(
    capture: Path, thing: Mapping[str, Any], sizes: Sequence[int], runs: int, against: str
) -> Iterator[dict[str, Any]]:
    """A record for each task and size of a capture made of copies.

    Finding is measured once, and where nothing was copied: what it takes grows with what there is to find. A size below
    the capture's own stands for the capture itself.
    """
    with tempfile.TemporaryDirectory(prefix="captures-") as folder, versions_with(against) as versions:
        for number, size in enumerate(sizes):
            made = Path(folder) / "capture.ply"
            subprocess.run([sys.executable, __file__, "enlarge", capture.absolute(), made, str(size)], check=True)
            for task in OF_A_CAPTURE:
                if not (task in _ONCE and number):
                    wait = Wait(task, folder, str(made), **thing)
                    figures = _figures(wait, versions, 1 if task in _ONCE else runs)
                    yield {"task": task, "million": size / 1e6, **figures}


@contextmanager
def versions_with(commit: str) -> Iterator[dict[str, Path]]:
    """This version's sources, and beside them those of a commit, if one is given."""
    if not commit:
        yield {"now": SOURCES}
        return
    with tempfile.TemporaryDirectory(prefix="before-") as folder:
        git = ["git", "-C", str(SOURCES), "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", f"{folder}/sources", commit], check=True)
        try:
            yield {"now": SOURCES, "before": Path(folder) / "sources"}
        finally:
            subprocess.run([*git, "remove", "--force", f"{folder}/sources"], check=True)


def _figures(wait: Wait, versions: Mapping[str, Path], runs: int) -> Figures:
    """Medians of a task by this version, and seconds of the other in turn with the median of their ratios."""
    found: dict[str, list[Figures]] = {version: [] for version in versions}
    for _ in range(runs):
        for version in versions:
            found[version].append(_in_process(wait, versions[version]))
    record = {name: median(each[name] for each in found["now"]) for name in _FIGURES}
    if "before" in found:
        pairs = [(now["seconds"], then["seconds"]) for now, then in zip(found["now"], found["before"], strict=True)]
        record |= {"before": median(then for _, then in pairs), "ratio": median(now / then for now, then in pairs)}
    return record


def _in_process(wait: Wait, sources: Path) -> Figures:
    """The figures of a task, with a version's sources; those of an old one that lacks the task are no numbers."""
    path = os.pathsep.join([str(sources / "src"), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": path, **({} if wait.object else {"OPENBLAS_NUM_THREADS": "1"})}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    command = [sys.executable, __file__, json.dumps(asdict(wait))]
    done = subprocess.run(command, env=environment, capture_output=True, check=False)
    if done.returncode and sources == SOURCES:
        raise RuntimeError(f"'{wait.task}' ended with code {done.returncode}: {done.stderr.decode()[-2000:]}")
    if done.returncode:
        return dict.fromkeys(_FIGURES, float("nan"))
    return dict(json.loads(done.stdout.decode().splitlines()[-1]))


def _enlarge(capture: Path, made: Path, size: int) -> None:
    from synthetic_scenes import copied

    scene = gt.read(capture)
    gt.write(copied(scene, np.ones(len(scene), bool), size)[0], made)


if __name__ == "__main__":
    if sys.argv[1] == "enlarge":
        _enlarge(Path(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4]))
    else:
        asked = Wait(**json.loads(sys.argv[1]))
        measured = (TASKS if asked.object else OF_A_CAPTURE)[asked.task](asked)
        peak_bytes = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(json.dumps(measured | {"peak_bytes": peak_bytes}))
