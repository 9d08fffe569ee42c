"""Masks that a method has rendered itself, scored as its own evaluation does, without cameras or Gaussians."""

from __future__ import annotations

import glob
import re
from pathlib import Path

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.evaluation.ground_truth import Truth, read_coverage, read_mask
from gaussian_trimmer.evaluation.layouts.layout import PICTURES, LayoutTask, Target, pictures_in
from gaussian_trimmer.evaluation.protocols import Protocol
from gaussian_trimmer.evaluation.runs import Run
from gaussian_trimmer.evaluation.scoring import Judge, mean_scores
from gaussian_trimmer.io.reading import path_inside

_GREY = 128 / 255
"""Above this share of white, a pixel of a rendered mask is object."""
_NAMED = (
    "{scene}/{folder}/{object}", "{scene}/{view}/{object}", "{scene}/{object}/{view}", "{object}/{view}",
    "{scene}/{view}/chosen_{object}", "{scene}/{number}/chosen_{object}", "{object}",
    "{scene}/*/ours_*/renders_cluster_silhouette/{view}_{object}",
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
        name = _filled(pattern, task, task.targets[0])
        for place in sorted(folder.glob(name)) if path_inside(folder, name) else ():
            if len(listed := pictures_in(place)) == len(task.targets):
                return listed
    raise InputError(
        f"'{folder}' has no rendered masks of the {len(task.targets)} views of '{task.name}', such as "
        f"'{clip_name(task.object)}/{clip_name(task.targets[0].view)}.png', nor as many pictures in a folder of its "
        "own."
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
    """The pattern with the words of a task and a target, in which `*` alone keeps its meaning."""
    number = re.search(r"\d*$", target.view)
    words = {"scene": task.scene, "object": task.object, "view": target.view, "folder": target.mask.parent.name}
    words["number"] = number[0] if number else ""
    return pattern.format(**{name: glob.escape(word) for name, word in words.items()})


def _one(folder: Path, name: str) -> Path | None:
    if path_inside(folder, name) is None:  # a name in a file of polygons may be any text
        return None
    found = [path for path in folder.glob(f"{name}.*") if path.suffix.lower() in PICTURES and path.is_file()]
    return found[0] if len(found) == 1 else None
