"""Sheets of pictures: ground truth, the object before and after, and where both are wrong, a row for each view."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.ground_truth import TestView, at_size, find_picture, read_picture
from gaussian_trimmer.evaluation.scoring import Cut, Judge, Shown
from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.output.pictures import Picture, captioned
from gaussian_trimmer.planning.observed_angles import cameras_that_see
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.views import HALF, Box, bounding_box

_GREY = np.float32(0.35)
CELL = 280
"""Side of a picture on a sheet, in pixels."""
TRUTH = "ground truth"
_SELECTED, _TRIMMED = (1.0, 0.6, 0.1), (0.1, 0.9, 1.0)
_TOO_MUCH, _MISSING = (1.0, 0.1, 0.1), (0.1, 1.0, 0.1)


def comparison_sheet(
    views: Sequence[TestView], before: Sequence[Shown] | None, after: Sequence[Shown], threshold: float
) -> Picture:
    """Ground truth, before, after and their errors about the object, a row for each view.

    Red is too much, green is missing, dark pixels do not count.

    Args:
        before: what the views show before, or None: then its columns are left out.
        threshold: opacity above which a pixel belongs to the object.
    """
    rows = []
    for i, view in enumerate(views):
        cells = cells_of_view(view, before[i] if before is not None else None, after[i], threshold)
        rows.append(row_of_pictures(cells, captions=i == 0))
    return np.vstack(rows)


def cells_of_view(
    view: TestView, before: Shown | None, after: Shown, threshold: float, size: int = CELL
) -> list[tuple[str, FloatArray]]:
    """What a sheet shows of one view, by name: squares about the object, (size, size, 3).

    Without a `before`, what comes after is named "object".
    """
    shown = {"object": after} if before is None else {"before": before, "after": after}
    grey = _GREY * (1 - view.coverage[..., None])
    photograph = view.image if view.image is not None else np.full((*view.coverage.shape, 3), 0.8, np.float32)
    cells: list[tuple[str, FloatArray]] = [(TRUTH, photograph * view.coverage[..., None] + grey)]
    cells += [(name, over_grey(side)) for name, side in shown.items()]
    cells += [(f"errors {name}", _errors(side.alpha, view, threshold)) for name, side in shown.items()]
    box = square_about(np.any([view.coverage > HALF, *(side.alpha > threshold for side in shown.values())], axis=0))
    return [(name, cut_out(picture, box, size)) for name, picture in cells]


def capture_sheet(
    cameras: Sequence[Camera], images: Path, before: Cut, after: Cut, bounds: Bounds, renderer: Renderer, rows: int
) -> Picture:
    """Photograph, selection, trim, and both outlines in the photograph, a row for each of some training cameras.

    The cameras are evenly spread over those that have the object in the picture.

    Args:
        images: folder of the photographs, of whatever size.
        before: what was selected.
        after: what the trim made of it.
        bounds: bounds of the object.

    Raises:
        InputError: no camera has the object in its picture, or a photograph is missing.
    """
    seeing = cameras_that_see(cameras, bounds)
    if not seeing:
        raise InputError(f"None of the {len(cameras)} cameras has the object in its picture.")
    judge = Judge(renderer)
    drawn: list[Picture] = []
    for number in [i * len(seeing) // rows for i in range(rows)] if len(seeing) > rows else range(len(seeing)):
        camera, photograph = _with_photograph(seeing[number], images)
        shown = [judge.show(cut, camera) for cut in (before, after)]
        box = square_about(np.any([s.alpha > HALF for s in shown], axis=0))
        outlined = photograph.copy()
        for s, colour in zip(shown, (_SELECTED, _TRIMMED), strict=True):
            contours, _ = cv2.findContours((s.alpha > HALF).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
            cv2.drawContours(outlined, contours, -1, colour, 1, cv2.LINE_AA)
        cells = [("photograph", photograph), ("selection", over_grey(shown[0])), ("trimmed", over_grey(shown[1]))]
        cells.append(("outlines: selection, trimmed", outlined))
        drawn.append(row_of_pictures([(name, cut_out(cell, box)) for name, cell in cells], captions=not drawn))
    return np.vstack(drawn)


def _with_photograph(camera: Camera, images: Path) -> tuple[Camera, FloatArray]:
    """The camera at the size of its photograph, and that in [0, 1], (H, W, 3)."""
    path = find_picture(images, camera)
    photograph = read_picture(path)
    height, width = photograph.shape[:2]
    return at_size(camera, width, height, path), photograph


def square_about(mask: BoolArray, margin: float = 0.15) -> Box:
    """A square box about a mask (H, W), wider by a share of its side; it may reach out of the picture."""
    x0, y0, x1, y1 = bounding_box(mask)
    half = max(1, round((1 + margin) * max(x1 - x0, y1 - y0) / 2))
    x, y = (x0 + x1) // 2, (y0 + y1) // 2
    return x - half, y - half, x + half, y + half


def cut_out(picture: FloatArray, box: Box, size: int = CELL) -> FloatArray:
    """What of a picture (H, W, 3) lies in a box, brought to a size, that of a sheet's pictures; grey outside."""
    (x0, y0, x1, y1), (height, width) = box, picture.shape[:2]
    inside = picture[max(0, y0) : y1, max(0, x0) : x1]
    padding = ((max(0, -y0), max(0, y1 - height)), (max(0, -x0), max(0, x1 - width)), (0, 0))
    square = np.pad(inside, padding, constant_values=_GREY)
    shrinks = square.shape[0] > size
    resized = cv2.resize(square, (size, size), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    return np.asarray(resized)


def over_grey(shown: Shown) -> FloatArray:
    """The object over grey, in [0, 1], (H, W, 3)."""
    return np.asarray(np.clip(shown.rgb + _GREY * (1 - np.clip(shown.alpha, 0, 1))[..., None], 0, 1))


def row_of_pictures(cells: Sequence[tuple[str, FloatArray]], *, captions: bool) -> Picture:
    """Pictures (H, W, 3) in [0, 1] of one height side by side, with their names above."""
    row: list[Picture] = []
    for name, rgb in cells:
        picture = np.ascontiguousarray((255 * np.clip(rgb[..., ::-1], 0, 1) + 0.5).astype(np.uint8))
        row.append(captioned(name, picture) if captions else picture)
    return np.hstack(row)


def _errors(alpha: FloatArray, view: TestView, threshold: float) -> NDArray[Any]:
    ours, truth = alpha > threshold, view.coverage > 0.5
    grey = view.image.mean(axis=2) if view.image is not None else np.full(alpha.shape, 0.5, np.float32)
    picture = np.repeat(np.float32(0.6) * grey[..., None], 3, axis=2)
    picture[ours & ~truth & view.valid] = _TOO_MUCH
    picture[~ours & truth & view.valid] = _MISSING
    picture[~view.valid] *= 0.5
    return picture
