"""Masks that a method has rendered itself, scored as its own evaluation does, without cameras or Gaussians."""

from __future__ import annotations

import glob
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.evaluation.ground_truth import Truth, read_coverage, read_mask
from gaussian_trimmer.evaluation.layouts import PICTURES, DatasetTask, MaskedPicture, pictures_in
from gaussian_trimmer.evaluation.predictions import last_iteration
from gaussian_trimmer.evaluation.protocols import Protocol
from gaussian_trimmer.evaluation.runs import Run
from gaussian_trimmer.evaluation.scoring import Judge, mean_scores
from gaussian_trimmer.io.reading import path_inside

_NAMED = (
    "{scene}/{folder}/{object}", "{scene}/{view}/{object}", "{scene}/{object}/{view}", "{object}/{view}",
    "{scene}/test/ours_*_text/test_mask/{folder}/{object}", "{scene}/{view}/chosen_{object}",
    "{scene}/{number}/chosen_{object}", "{object}", "{scene}/*/ours_*/renders_cluster_silhouette/{view}_{object}",
)  # fmt: skip
"""Where the mask of one view may lie, without its ending; several tasks may have the same scene and view."""
_IN_ORDER = (
    "{scene}/test/ours_*/mask_renders/{object}", "{object}/test/ours_*/mask_renders/*", "{object}/test/ours_*/mask",
    "{object}/fine_gc_*/select/masks", "{scene}/{object}", "{object}",
)  # fmt: skip
"""Folders in which the masks of a task may lie in the order of their views."""
_COB_GS_FIRST = "00000"
"""COB-GS scores the first of its renderings, however many there are."""


def score_rendered(
    folder: Path, tasks: Sequence[DatasetTask], method: str, judge: Judge, protocol: Protocol
) -> list[Run]:
    """Score the rendered masks of tasks, as runs in which nothing is trimmed.

    Raises:
        InputError: a mask is missing or cannot be read.
    """
    found = [find_rendered(folder, task, protocol) for task in tasks]
    if not any(path for paths in found for path in paths):
        raise _nothing_found(folder, tasks[0])
    runs = []
    for task, paths in zip(tasks, found, strict=True):
        scores = []
        for picture, path in zip(task.pictures, paths, strict=True):
            truth = protocol.truth(read_coverage(picture.mask, picture.category))
            white = read_mask(path) if path else np.zeros(truth.shape, np.float32)
            mask = (white > protocol.masks_above).astype(np.float32)
            scores.append(judge.score_mask(mask, Truth(truth, np.ones(truth.shape, np.bool_))))
        runs.append(Run(task.scene, task.object, method, "masks", len(scores), mean_scores(scores), {}, 0.0, "", {}))
    return runs


def find_rendered(folder: Path, task: DatasetTask, protocol: Protocol) -> list[Path | None]:
    """Return the rendered mask of each picture of a task: by name, or else all in a folder in the order of their names.

    Args:
        folder: the method's output, or that of the task's scene.
        task: the task.
        protocol: says whether masks may be missing, which are None.

    Raises:
        InputError: there are none, or not as many as pictures.
    """
    roots, place = [(folder, "")], folder.resolve()
    roots += [(place.parent, "{scene}/")] if place.name == task.scene else []
    partly: list[Path | None] = [None] * len(task.pictures)
    for root, start in roots:
        for pattern in (pattern for pattern in _NAMED if pattern.startswith(start)):
            found = [_one(root, _filled(pattern, task, picture)) for picture in task.pictures]
            if all(found) and (len(task.pictures) == 1 or len(set(found)) > 1):
                return found
            if pattern != "{object}" and sum(map(bool, found)) > sum(map(bool, partly)):
                partly = found
    for root, start in roots:
        for pattern in (pattern for pattern in _IN_ORDER if pattern.startswith(start)):
            if listed := _in_order(root, _filled(pattern, task, task.pictures[0]), len(task.pictures)):
                return listed
    if not protocol.missing_is_empty:
        raise _nothing_found(folder, task)
    return partly


def _in_order(folder: Path, name: str, count: int) -> list[Path | None]:
    """Return the masks in a folder of that name, if there are as many; of COB-GS's the first."""
    places = last_iteration(sorted(folder.glob(name))) if path_inside(folder, name) else []
    for place in places if len(places) == 1 else ():
        listed = pictures_in(place)
        first = [path for path in listed if path.stem == _COB_GS_FIRST]
        if count == 1 and place.parent.name == "mask_renders" and first:
            return [first[0]]
        if len(listed) == count:
            return [*listed]
    return []


def _nothing_found(folder: Path, task: DatasetTask) -> InputError:
    return InputError(
        f"'{folder}' has no rendered masks of the {len(task.pictures)} views of '{task.name}', such as "
        f"'{clip_name(task.object)}/{clip_name(task.pictures[0].view)}.png', nor as many pictures in a folder of "
        "its own."
    )


def _filled(pattern: str, task: DatasetTask, picture: MaskedPicture) -> str:
    """Return the pattern with the words of a task and a picture, in which `*` alone keeps its meaning."""
    number = re.search(r"\d*$", picture.view)
    words = {"scene": task.scene, "object": task.object, "view": picture.view, "folder": picture.mask.parent.name}
    words["number"] = number[0] if number else ""
    return pattern.format(**{name: glob.escape(word) for name, word in words.items()})


def _one(folder: Path, name: str) -> Path | None:
    if path_inside(folder, name) is None:  # a name in a file of polygons may be any text
        return None
    paths = [path for path in folder.glob(f"{name}.*") if path.suffix.lower() in PICTURES and path.is_file()]
    found = last_iteration(paths)
    return found[0] if len(found) == 1 else None
