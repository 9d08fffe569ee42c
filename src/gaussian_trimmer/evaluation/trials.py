"""Trials: selections to trim beside their ground truth, from the files of a segmentation method; and their trims.

A file of a method is looked for by patterns below its folder; {scene} and {object} stand for the task's names. The
first pattern that matches counts, and of several training iterations the last.
"""

from __future__ import annotations

import csv
import glob
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import CameraSet, only_training, training_cameras
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.evaluation.datasets import Protocol, Task, camera_of
from gaussian_trimmer.evaluation.ground_truth import TestView, view_of
from gaussian_trimmer.evaluation.scoring import Cut, Judge, Scores, mean_scores, read_result
from gaussian_trimmer.formats.identify import BY_ID, FORMATS, METHOD_FILES, SELECTION_SUFFIXES
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.io.reading import file_bytes, reading
from gaussian_trimmer.masks.sam import SamModel, draw_masks
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.surface.visible_surface import evenly_spread
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.result import TrimResult
from gaussian_trimmer.trimming.trim import trim

LOSS = 0.3
"""Points of foreground IoU; a trim that loses more has done harm."""
_TASK_FOLDERS, _SCENE_FOLDER = ("{scene}/{object}/", "{object}/"), "{scene}/"
"""Folders of one task, and that of a scene, which several tasks may share."""
_POINT_CLOUDS = ("scene_point_cloud.ply", "point_cloud.ply")
_SCENES = (
    *(f"scene{ending}" for ending in FORMATS),
    *(f"point_cloud/iteration_*/{name}" for name in _POINT_CLOUDS),
    *_POINT_CLOUDS,
)
_OF_METHODS = tuple(file.pattern for file in METHOD_FILES)
_WITH_IDS = tuple(file.pattern for file in METHOD_FILES if file.needs == BY_ID)
_SELECTIONS = (
    *(f"selection{ending}" for ending in (*SELECTION_SUFFIXES, *FORMATS)),
    *_OF_METHODS,
    *(pattern.replace("{object}", "*") for pattern in _OF_METHODS if "{object}" in pattern),
    *(f"object{ending}" for ending in FORMATS),
    *(f"{{object}}{ending}" for ending in (*SELECTION_SUFFIXES, *FORMATS)),
)
_CAMERAS = ("cameras.json", "transforms.json", "sparse/0", "sparse")
_ITERATION = re.compile(r"(?:iteration_|chkpnt|ours_)(\d+)")
_PLACEHOLDERS = "{scene} and {object} stand for the task's names"
_ID = re.compile(r"-?\d{1,10}")
_MAX_CSV_BYTES = 1 << 20


@dataclass(frozen=True, eq=False)
class Trial:
    """A selection, and the ground truth of its object."""

    scene: str
    """Name of the scene."""
    object: str
    """Name of the object."""
    kind: str
    """Where the selection comes from."""
    gaussians: Gaussians
    """The scene, N Gaussians."""
    before: Cut
    """The scene cut by the selection."""
    views: Sequence[TestView]
    """Ground truth."""
    cameras: CameraSet | None
    """Training cameras, which the trimmer gets; the ground truth's are not among them."""
    up: tuple[float, float, float] | None = None
    """Up vector, which the trimmer gets."""


Way = Callable[[Trial], TrimResult]
"""One way of trimming."""


@dataclass(frozen=True)
class Run:
    """One trim and its scores, means over the views."""

    scene: str
    object: str
    kind: str
    variant: str
    views: int
    """Number of views with ground truth."""
    before: Scores
    after: Scores
    seconds: float
    """Time that the trim took."""
    refused: str
    """Why nothing was trimmed; empty if something was."""

    def gain(self, metric: str = "iou") -> float:
        """Return the points of a metric that the trim gained."""
        return self.after[metric] - self.before[metric]

    def loses(self, metric: str = "iou") -> bool:
        """Return whether the trim did harm."""
        return self.gain(metric) < -LOSS

    def __str__(self) -> str:
        """Return what is printed of the trim as soon as it is measured."""
        metrics = [name for name in ("iou", "iou_in_scene", "boundary_iou", "psnr") if name in self.before]
        changes = "  ".join(f"{name} {self.before[name]:5.1f} -> {self.after[name]:5.1f}" for name in metrics)
        kept = f"  fidelity {self.after['fidelity']:4.1f}" if "fidelity" in self.after else ""
        tail = f"{self.seconds:4.1f} s{'  LOSS' if self.loses() else ''} {self.refused}".rstrip()
        return f"{self.variant:18s} {self.kind:12s} {self.scene}/{self.object:12s} {changes}{kept}  {tail}"


def way_of(
    config: TrimConfig | None = None, *, sam: SamModel | None = None, paper: bool = False, training_views: int = 0
) -> Way:
    """Return a way of trimming: with some settings, by masks that a model draws or that are drawn as in the paper, and
    if asked for with training cameras in place of virtual ones."""
    given = config or TrimConfig()

    def trim_it(trial: Trial) -> TrimResult:
        views = evenly_spread(training_cameras(trial.cameras), training_views) if training_views else None
        chosen = given if trial.up is None else replace(given, up=trial.up)
        assert trial.before.selection is not None, "trials begin with a selection"
        known: dict[str, Any] = {"config": chosen, "cameras": trial.cameras, "view_cameras": views}
        masks = draw_masks(trial.gaussians, trial.before.selection, sam=sam, paper=paper, **known)
        return trim(trial.gaussians, trial.before.selection, masks=masks, **known)

    return trim_it


def measure(trial: Trial, ways: Mapping[str, Way], judge: Judge, *, fidelity: bool = True) -> Iterator[Run]:
    """Trim a selection in every way, and compare each result with ground truth.

    Args:
        trial: what is trimmed.
        ways: ways of trimming, by name.
        judge: the rules of the comparison.
        fidelity: also compare object and background together with the untouched scene.

    Raises:
        InputError: no view shows the object.
    """
    before = mean_scores(judge.score_views(trial.before, trial.views))
    if "iou" not in before:
        raise InputError(
            f"No mask of '{trial.scene}/{trial.object}' shows the object; give masks in which it is bright."
        )
    for name, way in ways.items():
        start = time.perf_counter()
        result = way(trial)
        seconds = time.perf_counter() - start
        cut = Cut(result.object, result.background)
        after = mean_scores(judge.score_views(cut, trial.views, trial.gaussians if fidelity else None))
        where = trial.scene, trial.object, trial.kind, name
        yield Run(*where, len(trial.views), before, after, seconds, result.objects[0].refused or "")


def trials_of(
    tasks: Sequence[Task],
    files: Sequence[Mapping[str, Path]],
    method: str,
    options: SelectionOptions,
    protocol: Protocol,
    ids: Mapping[str, tuple[int, ...]],
) -> Iterator[Trial]:
    """Yield what is measured, read task by task; a scene that the next task shares is kept.

    Args:
        tasks: the tasks.
        files: the scene, selection and cameras of each.
        method: name of the method.
        options: how selection files are read.
        protocol: how views are rendered and compared.
        ids: ids of the objects by the names of tasks, if selection files hold several.

    Raises:
        InputError: a file cannot be used, a picture has no camera of its name, or a result is not of the scene's rows.
    """
    path, scene = None, None
    for task, own in zip(tasks, files, strict=True):
        if scene is None or path != own["scene"]:
            path, scene = own["scene"], formats.read(own["scene"])
        if ids:
            options = replace(options, object_id=ids[task.name])
        listed = read_camera_set(own["cameras"])
        cameras, views = listed.pinhole_cameras(), []
        for picture in task.pictures:
            camera = camera_of(picture, cameras, f"'{own['cameras']}'")
            truth = view_of(camera, picture.mask, picture.image, category=picture.category)
            views.append(protocol.view(truth, camera))
        found = read_result(own["selection"], scene, options)
        if found.selection is None:
            raise InputError(f"The trimmer cannot start from '{own['selection']}': {found.unknown}")
        given = only_training(listed) if training_cameras(listed) else None
        yield Trial(task.scene, task.object, method, scene, found, views, given)


def find_files(
    task: Task, folder: Path, root: Path, patterns: Mapping[str, str | None], with_ids: bool = False
) -> dict[str, Path]:
    """Return the scene, selection and cameras of a task.

    Args:
        task: the task.
        folder: the method's output.
        root: the data set, which may have the cameras.
        patterns: where scene, selection and cameras are; the usual places of those that are not given are searched.
        with_ids: whether a file of several objects is one's selection, since its id is known.

    Raises:
        InputError: a file is missing, or a pattern matches several.
    """
    homes = [*_TASK_FOLDERS, _SCENE_FOLDER]
    # In a folder that tasks share, a selection must bear the task's name, unless its ids are known.
    named = [home + name for home in (_SCENE_FOLDER, "") for name in _SELECTIONS if "{object}" in name]
    named += [_SCENE_FOLDER + name for name in (_WITH_IDS if with_ids else ())]
    usual = {
        "selection": [(folder, name) for name in [*(h + n for h in _TASK_FOLDERS for n in _SELECTIONS), *named]],
        "scene": [(folder, home + name) for home in homes for name in _SCENES],
        "cameras": [(place, home + name) for place in (folder, root) for home in homes for name in _CAMERAS],
    }
    found: dict[str, Path] = {}
    for what, places in usual.items():
        pattern = patterns.get(what)
        if what == "scene" and pattern is None and found["selection"].name.startswith("chkpnt"):
            found[what] = found["selection"]  # it holds Gaussians that the method has split
        else:
            found[what] = _find(task, what, places if pattern is None else [(folder, pattern)])
    return found


def _find(task: Task, what: str, places: Sequence[tuple[Path, str]]) -> Path:
    """Return the file or folder that the first pattern matches that matches any."""
    option = f"--{what.rstrip('s')}s"

    def filled(pattern: str, quote: Callable[[str], str] = str) -> str:
        return pattern.replace("{scene}", quote(task.scene)).replace("{object}", quote(task.object))

    for folder, pattern in places:
        below = Path(filled(pattern, glob.escape))
        start = Path(below.anchor) if below.is_absolute() else folder
        matches = sorted(start.glob(str(below.relative_to(below.anchor))))
        found = [path for path in matches if _iteration(path) == max(map(_iteration, matches))]
        if len(found) > 1:
            raise InputError(
                f"The task '{task.name}' has {len(found)} files that may be its {what} ({found[0]}, {found[1]} ...); "
                f"name one with {option} PATTERN, in which {_PLACEHOLDERS}."
            )
        if found:
            return found[0]
    folder, pattern = places[0]
    ids = "; or say with --ids FILE which objects a file of several holds" if what == "selection" else ""
    raise InputError(
        f"There is no {what} of the task '{task.name}', such as '{folder / filled(pattern)}'; name it with {option} "
        f"PATTERN, in which {_PLACEHOLDERS}{ids}."
    )


def _iteration(path: Path) -> int:
    """Return the iteration of the training that a path is of, or -1."""
    return max((int(number) for number in _ITERATION.findall(str(path))), default=-1)


def read_ids(file: Path, tasks: Sequence[Task]) -> dict[str, tuple[int, ...]]:
    """Return the ids of the tasks' objects, by the tasks' names, from a CSV file with rows of a task and its ids.

    Raises:
        InputError: the file cannot be read, or lacks a task.
    """
    with reading(file):
        text = file_bytes(file, _MAX_CSV_BYTES).decode("utf-8-sig", "replace")
    rows = [[word.strip() for word in row] for row in csv.reader(text.splitlines()) if any(row)]
    if rows and rows[0][0].lower() == "task":
        del rows[0]
    found: dict[str, tuple[int, ...]] = {}
    for task, *words in rows:
        numbers = " ".join(words).replace(";", " ").split()
        if not numbers or not all(_ID.fullmatch(number) for number in numbers):
            raise InputError(f"'{file}' has a row '{clip_name(task)}' without ids; rows are a task and its ids.")
        found[task] = tuple(map(int, numbers))
    if missing := [task.name for task in tasks if task.name not in found]:
        raise InputError(f"'{file}' has no row of the task '{clip_name(missing[0])}'.")
    return found
