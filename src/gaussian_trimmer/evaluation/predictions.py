"""The files of a segmentation method: its scenes, selections and cameras, task by task.

A file is looked for by patterns below the method's folder; {scene} and {object} stand for the task's names. The first
pattern that matches counts, and of several training iterations the last.
"""

from __future__ import annotations

import glob
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.layouts import DatasetTask
from gaussian_trimmer.formats.identify import FORMATS, METHOD_FILES, SELECTION_SUFFIXES
from gaussian_trimmer.options import arg

_TASK_FOLDERS, _SCENE_FOLDER = ("{scene}/{object}", "{object}"), "{scene}"
"""Folders of one task, and that of a scene, which several tasks may share."""
_POINT_CLOUDS = ("scene_point_cloud.ply", "point_cloud.ply")
_SCENES = (
    *(f"scene{ending}" for ending in FORMATS),
    *(f"point_cloud/iteration_*/{name}" for name in _POINT_CLOUDS),
    *_POINT_CLOUDS,
)
_OF_METHODS = tuple(file.pattern for file in METHOD_FILES)
_WITH_IDS = tuple(file.pattern for file in METHOD_FILES if file.needs.startswith("--selection.object-id"))
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


@dataclass(frozen=True)
class PredictionPatterns:
    """Where the files of a task are, relative to the folder of predictions; {scene} and {object} are the task's."""

    scenes: str | None = None
    """Pattern of the splat files; without it the usual places are searched."""
    selections: str | None = None
    """Pattern of the selections or objects; without it the usual places are searched."""
    cameras: str | None = None
    """Pattern of the cameras; without it the usual places are searched, also in the data set."""
    ids: Annotated[Path | None, arg(metavar="FILE")] = None
    """CSV file with the id of each task's object, or several: rows of task and ids, such as 'ramen/yellow bowl,12 45'.
    The tasks of a scene may then share a selection file. Or OpenGaussian's text_features.json."""


@dataclass(frozen=True)
class Prediction:
    """The files of one task."""

    scene: Path
    selection: Path
    cameras: Path


def find_predictions(
    tasks: Sequence[DatasetTask], folder: Path, patterns: PredictionPatterns, root: Path
) -> list[Prediction]:
    """Return the files of every task, found before any is read.

    Args:
        tasks: the tasks.
        folder: the method's output.
        patterns: where to look.
        root: the data set, which may have the cameras.

    Raises:
        InputError: the folder does not exist, a file of a task is missing, or a pattern matches several.
    """
    if not folder.is_dir():
        raise InputError(f"There is no folder '{folder}' of predictions.")
    return [_find_prediction(folder, task, patterns, root) for task in tasks]


def _find_prediction(folder: Path, task: DatasetTask, patterns: PredictionPatterns, root: Path) -> Prediction:
    own = [f"{home}/" for home in _TASK_FOLDERS]
    homes = [*own, f"{_SCENE_FOLDER}/"]
    # In a folder that tasks share, a selection must bear the task's name, unless its ids are known.
    named = [home + name for home in (f"{_SCENE_FOLDER}/", "") for name in _SELECTIONS if "{object}" in name]
    named += [f"{_SCENE_FOLDER}/{name}" for name in (_WITH_IDS if patterns.ids is not None else ())]
    usual = {
        "--scenes": [(folder, home + name) for home in homes for name in _SCENES],
        "--selections": [(folder, name) for name in [*(home + name for home in own for name in _SELECTIONS), *named]],
        "--cameras": [(place, home + name) for place in (folder, root) for home in homes for name in _CAMERAS],
    }

    def find(what: str, option: str, pattern: str | None) -> Path:
        return _find(task, what, option, usual[option] if pattern is None else [(folder, pattern)])

    selection = find("selection", "--selections", patterns.selections)
    if patterns.scenes is None and selection.name.startswith("chkpnt"):  # it holds Gaussians that the method has split
        scene = selection
    else:
        scene = find("splat file", "--scenes", patterns.scenes)
    return Prediction(scene, selection, find("cameras", "--cameras", patterns.cameras))


def _find(task: DatasetTask, what: str, option: str, places: Sequence[tuple[Path, str]]) -> Path:
    """Return the file or folder that the first pattern matches that matches any."""

    def filled(pattern: str, quote: Callable[[str], str] = str) -> str:
        return pattern.replace("{scene}", quote(task.scene)).replace("{object}", quote(task.object))

    for folder, pattern in places:
        found = last_iteration(_matches(folder, filled(pattern, glob.escape)))
        if len(found) > 1:
            raise InputError(
                f"The task '{task.name}' has {len(found)} files that may be its {what} ({found[0]}, {found[1]} ...); "
                f"name one with {option} PATTERN, in which {_PLACEHOLDERS}."
            )
        if found:
            return found[0]
    folder, pattern = places[0]
    ids = "; or say with --ids FILE which objects a file of several holds" if option == "--selections" else ""
    raise InputError(
        f"There is no {what} of the task '{task.name}', such as '{folder / filled(pattern)}'; name it with {option} "
        f"PATTERN, in which {_PLACEHOLDERS}{ids}."
    )


def _matches(folder: Path, pattern: str) -> list[Path]:
    """Return files and folders that match a pattern below a folder, or an absolute one, by name."""
    if Path(pattern).is_absolute():
        folder = Path(Path(pattern).anchor)
        pattern = str(Path(pattern).relative_to(folder))
    return sorted(folder.glob(pattern))


def last_iteration(paths: Sequence[Path]) -> list[Path]:
    """Return the paths of the highest iteration; all of them if none is of an iteration."""
    numbers = [max((int(n) for n in _ITERATION.findall(str(path))), default=-1) for path in paths]
    return [path for path, number in zip(paths, numbers, strict=True) if number == max(numbers)]
