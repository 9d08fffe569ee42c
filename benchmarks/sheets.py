"""Sheets of pictures: photograph, object before and after, and outlines or errors, a row for each view.

    python benchmarks/sheets.py SCENE RESULT --cameras PATH --images DIR [--masks DIR] [--before FILE] [--output FILE]

RESULT is a folder of `gaussian-trimmer trim`, a splat file of the object, or a selection. With --masks the views are
those that have a mask, and errors are drawn: red is too much, green is missing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tyro
from tyro.conf import Positional

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.ground_truth import TestView, at_size, find_picture, read_picture, views_in
from gaussian_trimmer.evaluation.results import cut_by, read_result
from gaussian_trimmer.evaluation.scoring import Cut, Judge, ObjectRender
from gaussian_trimmer.gaussians import FloatArray
from gaussian_trimmer.output.pictures import Picture, as_picture, captioned, write_picture
from gaussian_trimmer.views.view import HALF, Box, bounding_box

CELL = 280
"""Side of a picture on a sheet, in pixels."""
GREY = np.float32(0.35)
MARGIN = 0.15
"""What is added around the object, as a share of its box's larger side."""
OUTLINES = {"before": (1.0, 0.6, 0.1), "after": (0.1, 0.9, 1.0)}
TOO_MUCH, MISSING = (1.0, 0.1, 0.1), (0.1, 1.0, 0.1)


@dataclass(frozen=True)
class Sheet:
    """Draw a result in the views of photographs."""

    scene: Positional[Path]
    """Splat file of the scene."""
    result: Positional[Path]
    """What is drawn."""
    cameras: Path
    """Cameras of the photographs."""
    images: Path
    """Folder of the photographs."""
    masks: Path | None = None
    """Folder of ground-truth masks."""
    before: Path | None = None
    """Selection before the trim; a folder of `trim` holds it already."""
    rows: int = 6
    """Number of views, evenly spread."""
    output: Path = Path("sheet.png")
    """The picture to write."""

    def run(self) -> None:
        scene = formats.read(self.scene)
        result = read_result(self.result, scene)
        cuts = {"after": result.cut}
        if self.before is not None:
            cuts = {"before": read_result(self.before, scene).cut, **cuts}
        elif result.before is not None:
            cuts = {"before": cut_by(scene, result.before), **cuts}
        drawn = [self._row(camera, cuts) for camera in self._chosen()]
        write_picture(np.vstack(drawn), self.output)

    def _chosen(self) -> list[Camera]:
        cameras = list(read_cameras_of(self.scene, self.cameras).pinhole_cameras())
        if self.masks is not None:
            cameras, _ = views_in(cameras, self.masks)
        if not cameras:
            raise InputError(f"'{self.cameras}' lists no cameras.")
        n = min(self.rows, len(cameras))
        return [cameras[i * len(cameras) // n] for i in range(n)]

    def _row(self, camera: Camera, cuts: Mapping[str, Cut]) -> Picture:
        view, judge = None, Judge()
        if self.masks is not None:
            _, views = views_in([camera], self.masks, self.images)
            view = next(views)
            camera, photograph = view.camera, view.image
        else:
            path = find_picture(self.images, camera)
            photograph = read_picture(path)
            camera = at_size(camera, photograph.shape[1], photograph.shape[0], path)
        assert photograph is not None, "views are read with their photographs"
        shown = {name: judge.show(cut, camera) for name, cut in cuts.items()}
        cells = {"photograph": photograph, **{name: over_grey(one) for name, one in shown.items()}}
        if view is None:
            cells["outlines"] = outlined(photograph, shown)
        else:
            cells |= {f"errors {name}": errors(one.alpha, view) for name, one in shown.items()}
        box = square_about(np.any([one.alpha > HALF for one in shown.values()], axis=0))
        return np.hstack([captioned(name, as_picture(cut_out(cell, box))) for name, cell in cells.items()])


def over_grey(shown: ObjectRender) -> FloatArray:
    """The object over grey, (H, W, 3)."""
    return np.asarray(np.clip(shown.rgb + GREY * (1 - np.clip(shown.alpha, 0, 1))[..., None], 0, 1))


def outlined(photograph: FloatArray, shown: Mapping[str, ObjectRender]) -> FloatArray:
    """The photograph with the outlines before (orange) and after (blue)."""
    picture = photograph.copy()
    for name, one in shown.items():
        contours, _ = cv2.findContours((one.alpha > HALF).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(picture, contours, -1, OUTLINES[name], 1, cv2.LINE_AA)
    return picture


def errors(alpha: FloatArray, view: TestView) -> FloatArray:
    """Where the object alone is wrong, over the photograph in grey; pixels that do not count are dark."""
    assert view.image is not None, "views are read with their photographs"
    ours, truth, counted = alpha > HALF, view.alone.coverage > HALF, view.alone.counted
    picture = np.repeat(np.float32(0.6) * view.image.mean(axis=2, keepdims=True), 3, axis=2)
    picture[ours & ~truth & counted] = TOO_MUCH
    picture[~ours & truth & counted] = MISSING
    picture[~counted] *= 0.5
    return np.asarray(picture)


def square_about(mask: np.ndarray) -> Box:
    """A square box about a mask (H, W), a little wider; it may reach out of the picture."""
    x0, y0, x1, y1 = bounding_box(mask)
    half = max(1, round((1 + MARGIN) * max(x1 - x0, y1 - y0) / 2))
    x, y = (x0 + x1) // 2, (y0 + y1) // 2
    return x - half, y - half, x + half, y + half


def cut_out(picture: FloatArray, box: Box) -> FloatArray:
    """What of a picture (H, W, 3) lies in a box, at the size of a cell; grey outside of the picture."""
    (x0, y0, x1, y1), (height, width) = box, picture.shape[:2]
    padding = ((max(0, -y0), max(0, y1 - height)), (max(0, -x0), max(0, x1 - width)), (0, 0))
    square = np.pad(picture[max(0, y0) : y1, max(0, x0) : x1], padding, constant_values=GREY)
    return np.asarray(cv2.resize(square, (CELL, CELL), interpolation=cv2.INTER_AREA))


if __name__ == "__main__":
    tyro.cli(Sheet).run()
