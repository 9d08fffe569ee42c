"""`gaussian-trimmer evaluate removal`: a scene without its object, against pictures of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np

from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.commands.tables import Findings, TableOptions
from gaussian_trimmer.errors import clip_name
from gaussian_trimmer.evaluation.ground_truth import TestView, check_folders, find_picture, read_photograph, views_in
from gaussian_trimmer.evaluation.provenance import made_by
from gaussian_trimmer.evaluation.removal import IGNORED, INPAINT_RADIUS, covered, inpaint, likeness
from gaussian_trimmer.evaluation.results import read_background
from gaussian_trimmer.evaluation.tables import Cell, ScoreTable
from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.masks.mask_files import cameras_with_masks
from gaussian_trimmer.options import Positional, arg
from gaussian_trimmer.rendering import render
from gaussian_trimmer.settings import Range, check_settings

_COLUMNS = ("PSNR (dB)", "SSIM")


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
    quiet: bool = False
    """Print nothing but errors."""
    tables: Annotated[TableOptions, arg(name="")] = field(default_factory=TableOptions)

    def run(self) -> None:
        """Measure, print the table, and write it if asked to.

        Raises:
            InputError: something that the user gave cannot be used.
        """
        check_settings(self)
        self.tables.publish(self._measure, open_console(quiet=self.quiet))

    def _measure(self) -> Findings:
        background = read_background(self.result)
        cameras = read_cameras_of(self.result, self.cameras, trust_paths=self.trust_paths).pinhole_cameras()
        check_folders(self.images)
        pictured = cameras_with_masks(cameras, self.without)
        found, views = views_in(pictured, self.masks, self.without, self.ignore, ignored_above=IGNORED)
        rows: list[list[Cell]] = []
        for view in views:
            region = covered(view, self.grow)
            counted = region & view.alone.counted
            pictures = [render(background, view.camera).rgb, *self._inpainted(view, region)]
            scores = [likeness(picture, view, counted) or (None, None) for picture in pictures]
            rows.append([clip_name(view.camera.name), int(np.count_nonzero(counted)), *(c for s in scores for c in s)])
        rows.append(["mean", None, *map(_mean, list(zip(*rows, strict=True))[2:])])
        names = [*_COLUMNS, *(f"inpainting, {name}" for name in _COLUMNS if self.images)]
        ignored = f", where no mask to ignore exceeds {IGNORED:g}" if self.ignore else ""
        notes = [
            f"pixels of the object's mask > 0.5, grown by {self.grow}{ignored}",
            f"views: {len(found)}, those of {len(cameras)} cameras with a picture and a mask; mean over views",
            "SSIM in a window of 11 pixels",
            *([f"inpainting: OpenCV's after Telea, radius {INPAINT_RADIUS:g}"] if self.images else []),
            made_by(),
        ]
        title = f"{clip_name(self.result.name)}: the scene without the object, where it was"
        return Findings({"removal": ScoreTable(title, ["view", "pixels", *names], rows, notes, digits=3)})

    def _inpainted(self, view: TestView, region: BoolArray) -> Iterator[FloatArray]:
        """Yield the photograph with the object painted over, if photographs are given."""
        if self.images is not None:
            path = find_picture(self.images, view.camera)
            yield inpaint(read_photograph(path, view.camera.width, view.camera.height), region)


def _mean(column: tuple[Cell, ...]) -> float | None:
    """Return the mean of the numbers in a column, or None if it has none."""
    numbers = [cell for cell in column if isinstance(cell, float)]
    return float(np.mean(numbers)) if numbers else None
