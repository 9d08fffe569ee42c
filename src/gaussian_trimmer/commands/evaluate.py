"""`gaussian-trimmer evaluate`: a trim, or any other tool's objects, against ground-truth masks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.commands.tables import Findings, TableOptions
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.evaluation.clip_iqa import ClipScorer
from gaussian_trimmer.evaluation.ground_truth import at_size, read_mask, views_in
from gaussian_trimmer.evaluation.layouts import folders_in
from gaussian_trimmer.evaluation.panoptic import FOUND_IOU, PanopticScores, compare_objects
from gaussian_trimmer.evaluation.provenance import made_by
from gaussian_trimmer.evaluation.results import StoredResult, cut_by, read_objects, read_result
from gaussian_trimmer.evaluation.scoring import Cut, Judge, Scores, mean_scores
from gaussian_trimmer.evaluation.tables import Cell, ScoreTable, heading, known_metrics, score_cells
from gaussian_trimmer.gaussians import FloatArray, Gaussians
from gaussian_trimmer.masks.mask_files import cameras_with_masks, find_mask
from gaussian_trimmer.options import Positional, arg
from gaussian_trimmer.rendering import render
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import Share, check_settings


@dataclass(frozen=True)
class RuleOptions:
    """The rules of a comparison with ground truth."""

    threshold: Share = 0.5
    """Opacity above which a rendered pixel belongs to the object."""
    clip: Annotated[str | None, arg(metavar="MODEL")] = None
    """Also score the object's look by CLIP-IQA, with this CLIP model: a folder, or a name on the Hugging Face hub."""

    def judge(self) -> Judge:
        """A judge by these rules.

        Raises:
            InputError: a rule is not possible, or what it needs is missing.
        """
        check_settings(self)
        return Judge(self.threshold, ClipScorer(self.clip) if self.clip else None)


@dataclass(frozen=True)
class Evaluate:
    """Compare a trim, or any other tool's objects, with ground-truth masks of held-out pictures.

    RESULT is a folder that `trim` wrote, a splat file of the object, or a selection file. A mask belongs to the picture
    with the same name; it may have another size, and the view is then rendered at the mask's. Scores are of the object
    rendered alone, and of its share of the whole scene, where what stands before it hides it. If --masks holds a folder
    of masks for each of several objects, RESULT may hold several, too: which of them were found, missed, split or
    merged. Published data sets have commands of their own, such as evaluate nvos, and evaluate removal measures the
    scene without the object.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "gaussian-trimmer evaluate scene.ply trimmed --masks test_masks --cameras sparse/0",
        "gaussian-trimmer evaluate scene.ply object.ply --before rough.npy --masks test_masks --cameras sparse/0",
        "gaussian-trimmer evaluate scene.ply labels.npz --masks masks_of_objects --cameras sparse/0",
    )

    scene: Annotated[Positional[Path], arg(metavar="SCENE")]
    """Splat file of the scene."""
    result: Annotated[Positional[Path], arg(metavar="RESULT")]
    """What to score: a folder of `trim`, a splat file of the object, or a selection file."""
    masks: Annotated[Path, arg(metavar="DIR")]
    """Folder of ground-truth masks, in which the object is bright, or of a folder of them for each object."""
    cameras: Annotated[Path, arg(metavar="PATH")]
    """Cameras of the masks: a COLMAP folder, transforms.json or cameras.json."""
    images: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder of the photographs of the masked views, for the extraction PSNR."""
    ignore: Annotated[tuple[Path, ...], arg(metavar="DIR [DIR ...]")] = ()
    """Folders of masks of pixels that do not count, such as those where others stand before the object."""
    before: Annotated[Path | None, arg(metavar="FILE")] = None
    """Selection or object before the trim. A folder of `trim` holds it already."""
    objects: Annotated[tuple[int, ...], arg(metavar="ID ...")] = ()
    """Of several objects, which ones of RESULT count; without it, all."""
    trust_paths: bool = False
    """Open pictures that a transforms.json names outside its folder, if it does not say their size."""
    quiet: bool = False
    """Print nothing but errors."""
    rules: Annotated[RuleOptions, arg(name="")] = field(default_factory=RuleOptions)
    tables: Annotated[TableOptions, arg(name="")] = field(default_factory=TableOptions)
    selection_options: Annotated[SelectionOptions, arg(name="selection")] = field(default_factory=SelectionOptions)
    """How RESULT and the file before are read if they are selection files."""

    def run(self) -> None:
        """Measure, print the tables, and write them if asked to.

        Raises:
            InputError: something that the user gave cannot be used.
        """
        check_settings(self.selection_options, "selection")
        self.tables.publish(self._measure, open_console(quiet=self.quiet))

    def _measure(self) -> Findings:
        judge, scene = self.rules.judge(), formats.read(self.scene)
        cameras = read_cameras_of(self.scene, self.cameras, trust_paths=self.trust_paths).pinhole_cameras()
        title = f"{clip_name(self.result.name)} in {clip_name(self.scene.name)}"
        folders = folders_in(self.masks)
        if folders and not any(find_mask(self.masks, camera) for camera in cameras):
            return self._measure_several(judge, scene, cameras, folders, title)
        if self.objects:
            raise InputError("--objects is for several objects, each with a folder of masks in --masks.")
        found, views = views_in(cameras, self.masks, self.images, self.ignore)
        result = read_result(self.result, scene, self.selection_options)
        before = self._before(result, scene)
        scored: list[tuple[str, Scores, Scores]] = []
        for view in views:
            then = judge.score(judge.show(before, view.camera), view) if before else {}
            now = judge.score(judge.show(result.cut, view.camera), view)
            if result.cut.background is not None:
                now |= judge.fidelity(result.cut, view.camera, render(scene, view.camera).rgb)
            scored.append((clip_name(view.camera.name), then, now))
        notes = [judge.describe(), f"views: {len(found)}, those of {len(cameras)} cameras with a mask; mean over views"]
        notes.append(made_by())
        if result.unknown_background:
            notes.append(
                f"without scores in scene and fidelity, which need the background: {result.unknown_background}"
            )
        return Findings({"scores": table_of_views(title, scored, notes)})

    def _before(self, result: StoredResult, scene: Gaussians) -> Cut | None:
        if self.before is not None:
            return read_result(self.before, scene, self.selection_options).cut
        if result.before is not None:
            return cut_by(scene, result.before)
        if self.result.is_dir():
            raise InputError(
                f"'{self.result}' does not say which Gaussians were selected before the trim; give the selection with "
                "--before FILE."
            )
        return None

    def _measure_several(
        self, judge: Judge, scene: Gaussians, cameras: Sequence[Camera], folders: Sequence[Path], title: str
    ) -> Findings:
        """Measure several objects against a folder of masks for each."""
        if (
            self.images
            or self.ignore
            or self.before
            or self.rules.clip
            or self.rules.threshold != RuleOptions.threshold
        ):
            raise InputError(
                f"--images, --ignore, --before, --clip and --threshold are for one object; '{self.masks}' has a folder "
                "of masks for each of several."
            )
        seen = {camera.name for folder in folders for camera in cameras_with_masks(cameras, folder)}
        views = [camera for camera in cameras if camera.name in seen]
        found = read_objects(self.result, scene, self.objects, self.selection_options)
        scores = compare_objects(scene, list(found.values()), _truths(views, folders))
        counts = scores.counts()
        notes = [
            f"found: IoU of at least {100 * FOUND_IOU:.0f}, over the pixels of all views together",
            f"views: {len(views)}, those of {len(cameras)} cameras with a mask; {judge.tools()}", made_by(),
        ]  # fmt: skip
        summary = ScoreTable(title, list(counts), [list(counts.values())], notes)
        names = [clip_name(folder.name) for folder in folders]
        return Findings({"scores": summary, "objects": table_of_objects(title, names, list(found), scores)})


def _truths(cameras: Sequence[Camera], folders: Sequence[Path]) -> Iterator[tuple[Camera, list[FloatArray]]]:
    """Yield the cameras at the size of their masks, and the coverage of each true object."""
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


def table_of_views(title: str, scored: list[tuple[str, Scores, Scores]], notes: list[str]) -> ScoreTable:
    """Return a row for each view, by its name and scores before and after, and one of their mean."""
    mean = mean_scores(then for _, then, _ in scored), mean_scores(now for _, _, now in scored)
    metrics = known_metrics(mean[1])
    rows: list[list[Cell]] = [
        [view, *score_cells(metrics, then or None, now)] for view, then, now in [*scored, ("mean", *mean)]
    ]
    return ScoreTable(title, ["view", *map(heading, metrics)], rows, notes)


def table_of_objects(title: str, names: Sequence[str], numbers: Sequence[int], scores: PanopticScores) -> ScoreTable:
    """Return a row for each true object, then one for each false one, by the ids of those that were found."""
    rows: list[list[Cell]] = []
    for name, ious, best, state in zip(names, scores.ious, scores.best, scores.states(), strict=True):
        rows.append([name, numbers[int(ious.argmax())] if best > 0 else None, 100 * float(best), state])
    rows += [["-", numbers[place], 0.0, "false"] for place in np.flatnonzero(scores.false).tolist()]
    return ScoreTable(f"objects of {title}", ["true object", "found as", "IoU (%)", "state"], rows)
