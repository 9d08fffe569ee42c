"""`gaussian-trimmer evaluate`: a trim, or any other tool's objects, against ground truth, and `evaluate removal`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from json import dumps
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.evaluation.clip_iqa import ClipScorer
from gaussian_trimmer.evaluation.datasets import folders_in
from gaussian_trimmer.evaluation.ground_truth import (
    check_folders,
    find_picture,
    read_photograph,
    view_of,
    views_in,
)
from gaussian_trimmer.evaluation.metrics import THRESHOLD
from gaussian_trimmer.evaluation.results import read_background, read_result
from gaussian_trimmer.evaluation.scoring import (
    IGNORED,
    INPAINT_RADIUS,
    Cut,
    Judge,
    Scores,
    cut_by,
    inpaint,
    ious_of,
    likeness,
    mean_scores,
    shared_pixels,
)
from gaussian_trimmer.evaluation.tables import (
    MADE_BY,
    Cell,
    ScoreTable,
    heading,
    known_metrics,
    score_cells,
    write_tables,
)
from gaussian_trimmer.evaluation.trials import Run
from gaussian_trimmer.gaussians import FloatArray, Gaussians
from gaussian_trimmer.io.writing import atomic_folder
from gaussian_trimmer.masks.mask_files import cameras_with_masks, find_mask
from gaussian_trimmer.options import Positional, arg
from gaussian_trimmer.rendering import render
from gaussian_trimmer.selection_files import SelectionOptions, load_objects
from gaussian_trimmer.settings import Range, Share, check_settings
from gaussian_trimmer.views.view import grown

Findings = tuple[Mapping[str, ScoreTable], Sequence[Run], Mapping[str, Any]]
"""Tables by the names of their files, runs, and everything that was set."""


@dataclass(frozen=True)
class RuleOptions:
    """The rules of a comparison with ground truth."""

    threshold: Share = THRESHOLD
    """Opacity above which a rendered pixel belongs to the object."""
    clip: Annotated[str | None, arg(metavar="MODEL")] = None
    """Also score the object's look by CLIP-IQA, with this CLIP model: a folder, or a name on the Hugging Face hub."""

    def judge(self) -> Judge:
        """Return a judge by these rules; InputError if a rule is not possible, or what it needs is missing."""
        check_settings(self)
        return Judge(self.threshold, ClipScorer(self.clip) if self.clip else None)


@dataclass(frozen=True)
class TableOptions:
    """Where tables go."""

    format: Literal["table", "csv", "latex"] = "table"
    """How to print tables."""
    json: bool = False
    """Print the tables as one JSON document instead."""
    output: Annotated[Path | None, arg(metavar="DIR")] = None
    """Also write all tables here, in every format."""
    overwrite: bool = False
    """Replace earlier results in the output folder."""
    quiet: bool = False
    """Print nothing but errors."""


def publish(
    measure: Callable[[], Findings],
    *,
    format: str = "table",
    json: bool = False,
    output: Path | None = None,
    overwrite: bool = False,
    quiet: bool = False,
) -> None:
    """Measure, print the tables, and write them if there is a folder, which then appears whole or not at all.

    Raises:
        InputError: the folder cannot be written to or may not be replaced, which is found before anything is measured;
            or what `measure` raises.
    """
    with atomic_folder(output, "evaluate", overwrite=overwrite) if output else nullcontext() as folder:
        tables, runs, settings = measure()
        if json:
            found = [table.as_dict() for table in tables.values()]
            text = dumps(found if len(found) > 1 else found[0], indent=1, allow_nan=False)
        else:  # where CSV is printed, the notes are only in the files
            text = "\n".join(table.text(format).rstrip("\n") + "\n" for table in tables.values())
        open_console(quiet=quiet).print(text)
        if folder is not None:
            write_tables(tables, runs, settings, folder)


@dataclass(frozen=True)
class Evaluate:
    """Compare a trim, or any other tool's objects, with ground-truth masks of held-out pictures.

    RESULT is a folder that `trim` wrote, a splat file of the object, or a selection file. A mask belongs to the picture
    with the same name; it may have another size, and the view is then rendered at the mask's. Scores are of the object
    rendered alone, and of its share of the whole scene, where what stands before it hides it. If --masks holds a folder
    of masks for each of several objects, RESULT may hold several, too: each true one is compared with the one that is
    most like it. Published data sets have commands of their own, such as evaluate nvos, and evaluate removal measures
    the scene without the object.
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
    rules: Annotated[RuleOptions, arg(name="")] = field(default_factory=RuleOptions)
    tables: Annotated[TableOptions, arg(name="")] = field(default_factory=TableOptions)
    selection_options: Annotated[SelectionOptions, arg(name="selection")] = field(default_factory=SelectionOptions)
    """How RESULT and the file before are read if they are selection files."""

    def run(self) -> None:
        """Measure, print the table, and write it if asked to.

        Raises:
            InputError: something that the user gave cannot be used.
        """
        check_settings(self.selection_options, "selection")
        publish(self._measure, **vars(self.tables))

    def _measure(self) -> Findings:
        judge, scene = self.rules.judge(), formats.read(self.scene)
        cameras = read_cameras_of(self.scene, self.cameras, trust_paths=self.trust_paths).pinhole_cameras()
        title = f"{clip_name(self.result.name)} in {clip_name(self.scene.name)}"
        folders = folders_in(self.masks)
        if folders and not any(find_mask(self.masks, camera) for camera in cameras):
            return {"scores": self._several(scene, cameras, folders, title)}, (), {}
        if self.objects:
            raise InputError("--objects is for several objects, each with a folder of masks in --masks.")
        found, views = views_in(cameras, self.masks, self.images, self.ignore)
        result = read_result(self.result, scene, self.selection_options)
        before = self._before(result, scene)
        rows: list[tuple[str, Scores, Scores]] = []
        for view in views:
            then = judge.score_views(before, [view])[0] if before else {}
            rows.append((clip_name(view.camera.name), then, judge.score_views(result, [view], scene)[0]))
        rows.append(("mean", mean_scores(then for _, then, _ in rows), mean_scores(now for _, _, now in rows)))
        metrics = known_metrics(rows[-1][2])
        cells = [[name, *score_cells(metrics, then or None, now)] for name, then, now in rows]
        notes = [judge.describe(), _views(found, cameras, "mask"), MADE_BY]
        if result.unknown:
            notes.append(f"without scores in scene and fidelity, which need the background: {result.unknown}")
        return {"scores": ScoreTable(title, ["view", *map(heading, metrics)], cells, notes)}, (), {}

    def _before(self, result: Cut, scene: Gaussians) -> Cut | None:
        if self.before is not None:
            return read_result(self.before, scene, self.selection_options)
        if result.before is not None:
            return cut_by(scene, result.before)
        if self.result.is_dir():
            raise InputError(
                f"'{self.result}' does not say which Gaussians were selected before the trim; give the selection with "
                "--before FILE."
            )
        return None

    def _several(self, scene: Gaussians, cameras: Sequence[Camera], folders: Sequence[Path], title: str) -> ScoreTable:
        """Return a row for each of several true objects, which have a folder of masks each."""
        if self.images or self.ignore or self.before or self.rules != RuleOptions():
            raise InputError(
                f"--images, --ignore, --before, --clip and --threshold are for one object; '{self.masks}' has a folder "
                "of masks for each of several."
            )
        seen = {camera.name for folder in folders for camera in cameras_with_masks(cameras, folder)}
        views = [camera for camera in cameras if camera.name in seen]
        file = self.result / "labels.npz" if self.result.is_dir() else self.result
        labels = load_objects(file, scene, self.objects, self.selection_options)
        numbers = [int(number) for number in (self.objects or np.unique(labels[labels > 0]))]
        found = [np.asarray(labels == number) for number in numbers]
        ious, rows = 100 * ious_of(shared_pixels(scene, found, _truths(views, folders))), list[list[Cell]]()
        for folder, of_true in zip(folders, ious, strict=True):
            number = numbers[int(of_true.argmax())] if of_true.any() else None
            rows.append([clip_name(folder.name), number, float(of_true.max(initial=0))])
        rows.append(["mean", None, float(ious.max(axis=1, initial=0).mean())])
        notes = ["IoU with the object that is most like it, over the pixels of all views together"]
        return ScoreTable(
            title, ["true object", "found as", "IoU (%)"], rows, [*notes, _views(views, cameras, "mask"), MADE_BY]
        )


def _truths(cameras: Sequence[Camera], folders: Sequence[Path]) -> Iterator[tuple[Camera, list[FloatArray]]]:
    """Yield the cameras at the size of their masks, and the coverage of each true object."""
    for camera in cameras:
        found = [view_of(camera, path) if (path := find_mask(folder, camera)) else None for folder in folders]
        first = next(view for view in found if view is not None)
        coverages = [view.coverage if view else np.zeros_like(first.coverage) for view in found]
        if any(coverage.shape != first.coverage.shape for coverage in coverages):
            raise InputError(
                f"The masks of the picture '{clip_name(camera.name)}' differ in size; they must have the same."
            )
        yield first.camera, coverages


def _views(found: Sequence[Camera], cameras: Sequence[Camera], what: str) -> str:
    return f"views: {len(found)}, those of {len(cameras)} cameras with a {what}; mean over views"


@dataclass(frozen=True)
class EvaluateRemoval:
    """Compare the scene without an object with pictures of it, where the object was.

    RESULT is a folder that `trim` wrote, or any splat file of the scene without the object. A picture or mask belongs
    to the camera whose picture has the same name; a view counts if it has both. Compared are the pixels of the mask,
    grown, without those of other objects.
    """

    result: Annotated[Positional[Path], arg(metavar="RESULT")]
    """What is measured."""
    without: Annotated[Path, arg(metavar="DIR")]
    """Folder of pictures of the scene without the object."""
    masks: Annotated[Path, arg(metavar="DIR")]
    """Folder of masks of the object in these views; the object is bright."""
    cameras: Annotated[Path, arg(metavar="PATH")]
    """Cameras of the pictures: a COLMAP folder, transforms.json or cameras.json."""
    images: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder of photographs with the object, to compare with: OpenCV's inpainting of each."""
    ignore: Annotated[tuple[Path, ...], arg(metavar="DIR [DIR ...]")] = ()
    """Folders of masks of other objects, whose pixels do not count."""
    grow: Annotated[int, Range(0, 100)] = 6
    """By how many pixels the masks are grown."""
    trust_paths: bool = False
    """Open pictures outside its folder that a transforms.json names, if it does not say their size."""
    tables: Annotated[TableOptions, arg(name="")] = field(default_factory=TableOptions)

    def run(self) -> None:
        """Measure, print the table, and write it if asked to.

        Raises:
            InputError: something that the user gave cannot be used.
        """
        check_settings(self)
        publish(self._measure, **vars(self.tables))

    def _measure(self) -> Findings:
        background = read_background(self.result)
        cameras = read_cameras_of(self.result, self.cameras, trust_paths=self.trust_paths).pinhole_cameras()
        check_folders(self.images)
        pictured = cameras_with_masks(cameras, self.without)
        found, views = views_in(pictured, self.masks, self.without, self.ignore, ignored_above=IGNORED)
        rows: list[list[Cell]] = []
        for view in views:
            assert view.image is not None, "views without the object have their picture"
            region = grown(view.coverage > THRESHOLD, self.grow)
            pictures, counted = [render(background, view.camera).rgb], region & view.counted
            if self.images is not None:
                size = view.camera.width, view.camera.height
                pictures.append(inpaint(read_photograph(find_picture(self.images, view.camera), *size), region))
            scores = [likeness(picture, view.image, counted) or (None, None) for picture in pictures]
            rows.append([clip_name(view.camera.name), int(np.count_nonzero(counted)), *(c for s in scores for c in s)])
        numbers = [[cell for cell in column if isinstance(cell, float)] for column in zip(*rows, strict=True)]
        rows.append(["mean", None, *(float(np.mean(column)) if column else None for column in numbers[2:])])
        names = ["PSNR (dB)", "SSIM", *(["inpainting, PSNR (dB)", "inpainting, SSIM"] if self.images else [])]
        ignored = f", where no mask to ignore exceeds {IGNORED:g}" if self.ignore else ""
        notes = [
            f"pixels of the object's mask > 0.5, grown by {self.grow}{ignored}",
            _views(found, cameras, "picture and a mask"),
            "SSIM in a window of 11 pixels",
            *([f"inpainting: OpenCV's after Telea, radius {INPAINT_RADIUS:g}"] if self.images else []),
            MADE_BY,
        ]
        title = f"{clip_name(self.result.name)}: the scene without the object, where it was"
        return {"removal": ScoreTable(title, ["view", "pixels", *names], rows, notes, digits=3)}, (), {}
