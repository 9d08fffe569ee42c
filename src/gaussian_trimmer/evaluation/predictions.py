"""Where a segmentation method has left its scenes, selections and cameras, task by task.

A file is looked for by patterns below the method's folder, in which {scene} and {object} stand for the task's names;
the first pattern that matches a file counts. Of training iterations the last is taken.
"""

from __future__ import annotations

import glob
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.layouts.tasks import LayoutTask
from gaussian_trimmer.formats import FORMATS
from gaussian_trimmer.selection_files.selection_file import SUFFIXES

_OWN, _SHARED = ("{scene}/{object}", "{object}"), "{scene}"
"""Folders of one task, and that of a scene, which several tasks may share."""
_POINT_CLOUDS = ("scene_point_cloud.ply", "point_cloud.ply")
_SCENES = (
    *(f"scene{ending}" for ending in FORMATS),
    *(f"point_cloud/iteration_*/{name}" for name in _POINT_CLOUDS),
    *_POINT_CLOUDS,
)
_ENDINGS = (*SUFFIXES, *FORMATS)
_SELECTIONS = (
    *(f"selection{ending}" for ending in _ENDINGS),
    "segmentation_res/{object}.pt", "segmentation_res/*.pt", "final_mask.pt", "seg_point_cloud.ply",
    "point_cloud_seg.ply", *(f"object{ending}" for ending in FORMATS), *(f"{{object}}{ending}" for ending in _ENDINGS),
)  # fmt: skip
_CAMERAS = ("cameras.json", "transforms.json", "sparse/0", "sparse")
_ITERATION = re.compile(r"iteration_(\d+)")
_LISTED = 4
_Place = tuple[Path, Sequence[str]]
"""A folder, and patterns below it."""


@dataclass(frozen=True)
class PredictionPatterns:
    """Where the files of a task are, relative to the folder of predictions; {scene} and {object} are the task's."""

    scenes: str = ""
    """Pattern of the splat files; if it is not given, the usual places are searched."""
    selections: str = ""
    """Pattern of the selections or objects; if it is not given, the usual places are searched."""
    cameras: str = ""
    """Pattern of the cameras; if it is not given, the usual places are searched, also in the data set."""


@dataclass(frozen=True)
class Prediction:
    """The files of one task."""

    scene: Path
    selection: Path
    cameras: Path


def find_prediction(folder: Path, task: LayoutTask, patterns: PredictionPatterns, root: Path) -> Prediction:
    """The files of a task.

    Args:
        folder: what the method left.
        task: the task.
        patterns: where to look.
        root: the data set, which may have the cameras.

    Raises:
        InputError: a file is missing, or a pattern matches several.
    """
    own = [f"{home}/" for home in _OWN]
    homes = [*own, f"{_SHARED}/"]
    scenes = [home + name for home in homes for name in _SCENES]
    # What lies in a folder that tasks share must bear the task's name.
    named = [home + name for home in (f"{_SHARED}/", "") for name in _SELECTIONS if "{object}" in name]
    selections = [home + name for home in own for name in _SELECTIONS] + named
    cameras = [home + name for home in homes for name in _CAMERAS]
    in_data = [f"{_SHARED}/{name}" for name in _CAMERAS]
    return Prediction(
        _find("splat file", "--scenes", _places(patterns.scenes, (folder, scenes)), task),
        _find("selection", "--selections", _places(patterns.selections, (folder, selections)), task),
        _find("cameras", "--cameras", _places(patterns.cameras, (folder, cameras), (root, in_data)), task),
    )


def _places(given: str, *usual: _Place) -> Sequence[_Place]:
    """Where to look: by the pattern that the user gave, or else in the usual places."""
    return [(usual[0][0], [given])] if given else usual


def _find(what: str, option: str, places: Sequence[_Place], task: LayoutTask) -> Path:
    """The file that the first matching pattern below a folder matches."""
    for folder, patterns in places:
        for pattern in patterns:
            found = _last_iteration(_matches(folder, _filled(pattern, task, glob.escape)))
            if len(found) > 1:
                names = ", ".join(str(path) for path in found[:_LISTED])
                raise InputError(
                    f"The task '{task.name}' has {len(found)} files that may be its {what} ({names}); name one with "
                    f"{option} PATTERN, in which {{scene}} and {{object}} stand for the task's."
                )
            if found:
                return found[0]
    folder, patterns = places[0]
    raise InputError(
        f"There is no {what} of the task '{task.name}', such as '{folder / _filled(patterns[0], task, str)}'; name "
        f"it with {option} PATTERN, in which {{scene}} and {{object}} stand for the task's."
    )


def _filled(pattern: str, task: LayoutTask, quote: Callable[[str], str]) -> str:
    return pattern.replace("{scene}", quote(task.scene)).replace("{object}", quote(task.object))


def _matches(folder: Path, pattern: str) -> list[Path]:
    """Files and folders that match a pattern below a folder, or an absolute one, by name."""
    if Path(pattern).is_absolute():
        anchor = Path(Path(pattern).anchor)
        folder, pattern = anchor, str(Path(pattern).relative_to(anchor))
    return sorted(folder.glob(pattern))


def _last_iteration(paths: Sequence[Path]) -> list[Path]:
    """The paths of the highest iteration; all of them if none is of an iteration."""
    numbers = [max((int(n) for n in _ITERATION.findall(str(path))), default=-1) for path in paths]
    return [path for path, number in zip(paths, numbers, strict=True) if number == max(numbers)]
