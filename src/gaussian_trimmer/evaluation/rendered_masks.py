"""Masks that a method has rendered itself, scored as its own evaluation does, without cameras or Gaussians."""

from __future__ import annotations

import re
from pathlib import Path

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.ground_truth import Truth, read_coverage, read_mask
from gaussian_trimmer.evaluation.layouts.layout import LayoutTask, Target, pictures_in
from gaussian_trimmer.evaluation.protocols import Protocol
from gaussian_trimmer.evaluation.runs import Run
from gaussian_trimmer.evaluation.scoring import Judge, mean_scores

_GREY = 128 / 255
"""Above this share of white, a pixel of a rendered mask is object."""
_NAMED = (
    "{scene}/{folder}/{object}", "{scene}/{view}/{object}", "{scene}/{object}/{view}", "{object}/{view}",
    "{scene}/{view}/chosen_{object}", "{scene}/{number}/chosen_{object}", "{object}",
)  # fmt: skip
"""Where the mask of one view may lie, without its ending; several tasks may have the same scene and view."""
_IN_ORDER = (
    "{scene}/test/ours_*/mask_renders/{object}", "{object}/test/ours_*/mask", "{object}/fine_gc_*/select/masks",
    "{scene}/{object}", "{object}",
)  # fmt: skip
"""Folders in which the masks of a task may lie in the order of their views."""


def find_rendered(folder: Path, task: LayoutTask) -> list[Path]:
    """The rendered mask of each target of a task, by name, or else all in a folder in the order of their names.

    Raises:
        InputError: there are none, or not as many as targets.
    """
    for pattern in _NAMED:
        found = [_one(folder, _filled(pattern, task, target)) for target in task.targets]
        if all(found) and (len(task.targets) == 1 or len(set(found)) > 1):
            return [path for path in found if path is not None]
    for pattern in _IN_ORDER:
        for place in sorted(folder.glob(_filled(pattern, task, task.targets[0]))):
            if len(listed := pictures_in(place)) == len(task.targets):
                return listed
    raise InputError(
        f"'{folder}' has no rendered masks of the {len(task.targets)} views of '{task.name}', such as "
        f"'{_filled(_NAMED[3], task, task.targets[0])}.png', nor as many pictures in a folder of its own."
    )


def score_rendered(folder: Path, task: LayoutTask, method: str, judge: Judge, protocol: Protocol) -> Run:
    """The scores of a task's rendered masks, as a run in which nothing is trimmed.

    Raises:
        InputError: a mask is missing or cannot be read.
    """
    scores = []
    for target, path in zip(task.targets, find_rendered(folder, task), strict=True):
        truth = protocol.truth(read_coverage(target.mask, target.category))
        mask = (read_mask(path) > _GREY).astype("float32")
        scores.append(judge.score_mask(mask, Truth(truth, truth >= 0)))
    return Run(task.scene, task.object, method, "masks", len(scores), mean_scores(scores), {}, 0.0, "", {})


def _filled(pattern: str, task: LayoutTask, target: Target) -> str:
    number = re.search(r"\d*$", target.view)
    words = {"scene": task.scene, "object": task.object, "view": target.view, "folder": target.mask.parent.name}
    return pattern.format(**words, number=number[0] if number else "")


def _one(folder: Path, name: str) -> Path | None:
    place = folder / name
    found = [path for path in pictures_in(place.parent) if path.stem == place.name]
    return found[0] if len(found) == 1 else None
