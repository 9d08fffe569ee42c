"""What people wait for: the command, trims, clicks, batches, each in a process of its own; see `speed.py`.

Times of another commit are taken in turn with those of this one, from its sources in a worktree of their own, so that
both meet the same machine. Ratios of such pairs hold where seconds change from hour to hour.

Only the package's public names and what has stood for long are used here, so that old commits can be measured, too.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
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
_WARM_RUNS = 3
_MILLION, _LARGE = 1_000_000, 3_000_000
_COPIES = 4


@dataclass(frozen=True)
class Wait:
    """What is measured, and on what."""

    task: str
    root: str
    """Folder of a benchmark scene."""
    object: str
    """One of its objects."""
    folder: str
    """Where files may be made; what one process leaves there another one finds."""

    def scene(self) -> Any:
        return gt.read(Path(self.root) / "scene.ply")

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


def _warm(work: Callable[[], Any], before: Callable[[], Any] = lambda: None) -> float:
    """Median seconds of some work that was done once already, each time after something that does not count."""
    seconds = []
    for _ in range(_WARM_RUNS + 1):
        before()
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return median(seconds[1:])


def _run(*command: Any, **environment: str) -> float:
    start = time.perf_counter()
    words = [sys.executable, "-m", "gaussian_trimmer", *map(str, command)]
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL, env={**os.environ, **environment})
    return time.perf_counter() - start


def help_page(wait: Wait) -> float:
    return _run("--help")


def first_run(wait: Wait) -> float:
    """The demo where no kernel has been compiled yet."""
    with tempfile.TemporaryDirectory(dir=wait.folder) as empty:
        return _run("demo", "--output", f"{empty}/demo", "--quiet", NUMBA_CACHE_DIR=empty)


def command(wait: Wait) -> float:
    selection = wait.file(f"{wait.object}.npy", partial(_save_selection, wait, ""))
    root, output = Path(wait.root), Path(wait.folder) / "trimmed"
    return _run("trim", root / "scene.ply", selection, "--cameras", root / "cameras.json", "--output", output,
                "--overwrite", "--quiet")  # fmt: skip


def trim(wait: Wait, **settings: Any) -> float:
    scene, selection, cameras = wait.scene(), wait.selection(), wait.cameras()
    return _warm(lambda: gt.trim(scene, selection, cameras=cameras, config=gt.TrimConfig(**settings)))


def trim_alone(wait: Wait) -> float:
    return trim(wait, refine="off", background="exact")


def large_scene(wait: Wait) -> float:
    """The trim with copies of the scene beside it, three million Gaussians in all."""
    from synthetic_scenes import tiled

    scene, selection = tiled(wait.scene(), wait.selection(), _LARGE)
    cameras = wait.cameras()
    return _warm(lambda: gt.trim(scene, selection, cameras=cameras))


def objects_together(wait: Wait) -> float:
    """Objects of the scene together, relative to the slowest of them alone."""
    scene, cameras = wait.scene(), wait.cameras()
    selections = {name: wait.selection(name) for name in wait.objects[:5]}
    alone = [_warm(lambda s=s: gt.trim(scene, s, cameras=cameras)) for s in selections.values()]  # type: ignore[misc]
    return _warm(lambda: gt.trim_objects(scene, selections, cameras=cameras)) / max(alone)


def click(wait: Wait, path: Path | None = None) -> float:
    """A click in the app's session, in the view that shows most of the object, where it is thickest."""
    from gaussian_trimmer.app import edits
    from gaussian_trimmer.app.session import Session
    from gaussian_trimmer.cameras import Viewpoint
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
    mark = Click(int(x), int(y), Viewpoint(camera))
    return _warm(lambda: session.do(edits.mark, mark), lambda: session.do(edits.clear))


def click_in_a_million(wait: Wait) -> float:
    from synthetic_scenes import tiled

    def make(path: Path) -> None:
        gt.write(tiled(wait.scene(), wait.selection(), _MILLION)[0], path)

    return click(wait, wait.file("million.ply", make))


def batch(wait: Wait, *options: str) -> float:
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
        return _run(*words) / (len(rows) - 1)


def _save_selection(wait: Wait, name: str, path: Path) -> None:
    np.save(path, wait.selection(name))


TASKS: dict[str, Callable[[Wait], float]] = {
    "first run": first_run,
    "--help": help_page,
    "command": command,
    "trim": trim,
    "trim without fit and background": trim_alone,
    "trim in a scene of 3 million": large_scene,
    "up to five objects together, in trims of the slowest": objects_together,
    "click": click,
    "click in a scene of 1 million": click_in_a_million,
    "batch, an item on two processes": batch,
    "batch without backgrounds": lambda wait: batch(wait, "--options", "--no-write-background"),
}
OF_AN_OBJECT = ("command", "trim", "trim without fit and background", "trim in a scene of 3 million", "click")
"""Tasks that are measured for each object."""


def measure(
    root: Path, objects: Sequence[str], runs: int, against: str, left_out: Sequence[str]
) -> Iterator[dict[str, Any]]:
    """A record for each task: medians in seconds of this version and the other, and of the ratios of pairs."""
    with tempfile.TemporaryDirectory(prefix="waits-") as folder, sources_of(against) as before:
        versions = {"before": before, "now": SOURCES} if before else {"now": SOURCES}
        for sources in versions.values():  # compiles the kernels, and those of large objects
            for task in ("command", "click"):
                _seconds_of(Wait(task, str(root.absolute()), objects[-1], folder), sources)
        for task in TASKS:
            for name in objects if task in OF_AN_OBJECT else objects[:1]:
                if task in left_out:
                    continue
                wait = Wait(task, str(root.absolute()), name, folder)
                times: dict[str, list[float]] = {version: [] for version in versions}
                for _ in range(runs):
                    for version, sources in versions.items():
                        times[version].append(_seconds_of(wait, sources))
                record: dict[str, Any] = {"task": f"{task}, {name}" if task in OF_AN_OBJECT else task}
                record |= {version: median(seconds) for version, seconds in times.items()}
                if before:
                    pairs = zip(times["now"], times["before"], strict=True)
                    record["ratio"] = median(now / then for now, then in pairs)
                yield record


@contextmanager
def sources_of(commit: str) -> Iterator[Path | None]:
    """A folder with the sources of a commit; None for no commit."""
    if not commit:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="before-") as folder:
        git = ["git", "-C", str(SOURCES), "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", f"{folder}/sources", commit], check=True)
        try:
            yield Path(folder) / "sources"
        finally:
            subprocess.run([*git, "remove", "--force", f"{folder}/sources"], check=True)


def said_in_process(script: str, wait: Any, sources: Path, **environment: str) -> str | None:
    """The last line that a script says of a wait, with a version's sources; None where an old one lacks the task."""
    path = os.pathsep.join([str(sources / "src"), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": path, **environment}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    command = [sys.executable, script, json.dumps(asdict(wait))]
    done = subprocess.run(command, env=environment, capture_output=True, check=False)
    if done.returncode and sources == SOURCES:
        raise RuntimeError(f"'{wait.task}' ended with code {done.returncode}: {done.stderr.decode()[-2000:]}")
    return None if done.returncode else done.stdout.decode().splitlines()[-1]


def _seconds_of(wait: Wait, sources: Path) -> float:
    return float(said_in_process(__file__, wait, sources) or "nan")


if __name__ == "__main__":
    asked = Wait(**json.loads(sys.argv[1]))
    print(TASKS[asked.task](asked))
