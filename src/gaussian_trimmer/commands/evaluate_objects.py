"""`gaussian-trimmer evaluate objects`: the objects that were found in a scene, against ground-truth masks of each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.commands.tables import Findings, TableOptions
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.evaluation.ground_truth import at_size, read_mask
from gaussian_trimmer.evaluation.panoptic import (
    FOUND_IOU,
    PanopticScores,
    count_common_pixels,
    counts_of,
    panoptic_scores,
)
from gaussian_trimmer.evaluation.statistics import made_by
from gaussian_trimmer.evaluation.tables import Cell, ScoreTable
from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.options import Positional, arg
from gaussian_trimmer.rendering import DEFAULT_RENDERER, RENDERER_CHOICES, get_renderer
from gaussian_trimmer.segmentation.segmenters.mask_files import cameras_with_masks, find_mask
from gaussian_trimmer.selection_files.several import load_objects
from gaussian_trimmer.views import HALF


@dataclass(frozen=True)
class EvaluateObjects:
    """Compare the objects of a scene with ground-truth masks: which were found, missed, split or merged.

    LABELS has a number for each Gaussian, such as objects.npy of `objects` or labels.npz of a trim. The masks of each
    true object are in a folder of its own; a mask belongs to the picture with the same name, and an object without one
    is not in that picture.
    """

    scene: Annotated[Positional[Path], arg(metavar="SCENE")]
    """Splat file of the scene."""
    labels: Annotated[Positional[Path], arg(metavar="LABELS")]
    """What is measured: one id a Gaussian, 0 for the rest."""
    masks: Annotated[Path, arg(metavar="DIR")]
    """Folder with a folder of masks for each true object."""
    cameras: Annotated[Path, arg(metavar="PATH")]
    """Cameras of the masks: a COLMAP folder, transforms.json or cameras.json."""
    objects: Annotated[tuple[int, ...], arg(metavar="ID ...")] = ()
    """Which objects of LABELS count; without it, all."""
    trust_paths: bool = False
    """Open pictures outside its folder that a transforms.json names, if it does not say their size."""
    renderer: Annotated[str, arg(metavar="{" + ",".join(RENDERER_CHOICES) + "}")] = DEFAULT_RENDERER
    """What renders the views."""
    quiet: bool = False
    """Print nothing but errors."""
    tables: Annotated[TableOptions, arg(name="")] = field(default_factory=TableOptions)

    def run(self) -> None:
        """Measure, print the tables, and write them if asked to.

        Raises:
            InputError: something that the user gave cannot be used.
        """
        self.tables.publish(self._measure, open_console(quiet=self.quiet))

    def _measure(self) -> Findings:
        if not self.masks.is_dir():
            raise InputError(f"There is no folder '{self.masks}' with a folder of masks for each object.")
        folders = sorted(path for path in self.masks.iterdir() if path.is_dir())
        if not folders:
            raise InputError(f"'{self.masks}' has no folders; the masks of each object go into one with its name.")
        scene = formats.read(self.scene)
        cameras = read_cameras_of(self.scene, self.cameras, trust_paths=self.trust_paths).pinhole_cameras()
        found = load_objects(self.labels, scene, self.objects)
        seen = {camera.name for folder in folders for camera in cameras_with_masks(cameras, folder)}
        views = [camera for camera in cameras if camera.name in seen]
        common = count_common_pixels(scene, list(found.values()), _truths(views, folders), get_renderer(self.renderer))
        scores = panoptic_scores(common)
        notes = [f"views: {len(views)}, those of {len(cameras)} cameras with a mask", made_by()]
        title = f"{clip_name(self.labels.name)} in {clip_name(self.scene.name)}"
        return Findings(
            {
                "scores": _summary(title, scores, notes),
                "objects": _table(title, [folder.name for folder in folders], found, scores),
            }
        )


def _truths(cameras: Sequence[Camera], folders: Sequence[Path]) -> Iterator[tuple[Camera, list[FloatArray]]]:
    """The cameras at the size of their masks, and the coverage of each true object."""
    for camera in cameras:
        paths = [find_mask(folder, camera) for folder in folders]
        known = next(path for path in paths if path is not None)
        height, width = read_mask(known).shape
        coverages = [read_mask(path) if path else np.zeros((height, width), np.float32) for path in paths]
        if any(coverage.shape != (height, width) for coverage in coverages):
            raise InputError(
                f"The masks of the picture '{clip_name(camera.name)}' differ in size; they must have the same."
            )
        yield at_size(camera, width, height, known), coverages


def _summary(title: str, scores: PanopticScores, notes: Sequence[str]) -> ScoreTable:
    counts = counts_of(scores)
    rules = [f"found: IoU of at least {100 * FOUND_IOU:.0f}, over the pixels of all views together"]
    return ScoreTable(title, list(counts), [list(counts.values())], [*rules, *notes])


def _table(title: str, names: Sequence[str], found: dict[int, BoolArray], scores: PanopticScores) -> ScoreTable:
    """A row for each true object, then one for each false one."""
    numbers, rows = list(found), list[list[Cell]]()
    for place, name in enumerate(names):
        best = int(scores.ious[place].argmax()) if numbers else -1
        state = "found" if scores.found[place] else "missed" if scores.missed[place] else "poor"
        state += ", split" if scores.split[place] else ""
        if numbers and scores.merged[best] and scores.covered[place, best] > HALF:
            state += ", merged with others"
        rows.append([name, numbers[best] if scores.best[place] > 0 else None, 100 * float(scores.best[place]), state])
    rows += [["-", numbers[place], 0.0, "false"] for place in np.flatnonzero(scores.false).tolist()]
    return ScoreTable(f"objects of {title}", ["true object", "found as", "IoU (%)", "state"], rows)
