"""How good is a selection by one box or one click, as it is selected and after the trim?

    python benchmarks/clicks.py ROOT [--ways box click] [--objects NAME ...] [--without-cameras] [--output FILE]
    python benchmarks/clicks.py ROOT --sam-model DIR

ROOT holds benchmark scenes (see `gaussian_trimmer.evaluation.datasets`), or is one. The user is simulated: in the
training view whose mask of the object is largest, the box is the mask's bounds and two pixels more, within the
picture, and the click is the pixel farthest from the mask's edge. No other ground truth reaches the program.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import tyro

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation import metrics
from gaussian_trimmer.evaluation.datasets import BenchmarkScene, TestView, open_scene
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians
from gaussian_trimmer.pipeline import TrimConfig, trim
from gaussian_trimmer.planning.up_vector import find_up
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.segmentation.segmenters.sam import SamConfig, SamSegmenter
from gaussian_trimmer.selecting.clicks import Pick, select_by_box, select_by_clicks
from gaussian_trimmer.selecting.model_masks import select_by_model
from gaussian_trimmer.views import Box, bounding_box

Way = Literal["box", "click"]

_MARGIN = 2
"""Pixels between the mask's bounds and the box."""
_RENDERER = get_renderer("numba")


@dataclass(frozen=True)
class Arguments:
    """Measure selections by a box or a click against ground truth."""

    root: tyro.conf.Positional[Path]
    """Folder with benchmark scenes, or one scene."""
    ways: tuple[Way, ...] = ("box", "click")
    """How objects are selected."""
    objects: tuple[str, ...] = ()
    """Only these objects."""
    without_cameras: bool = False
    """Give neither the selection nor the trim cameras or an up vector."""
    sam_model: Path | None = None
    """Let a model of the SAM family in this folder understand the marks."""
    output: Path | None = None
    """Write all rows to this JSON file."""


@dataclass(frozen=True)
class Row:
    """One selection and its scores."""

    scene: str
    object: str
    way: Way
    view: str
    understood: str
    """The way in which the program took it, or why it refused."""
    selected: int
    """Gaussians in the selection."""
    raw_iou: float
    """Mean foreground IoU of the selection over the test views, percent."""
    trimmed_iou: float
    """The same after the trim."""


def main() -> None:
    """Select, trim and measure each object in each way."""
    arguments = tyro.cli(Arguments)
    rows = []
    for folder in _folders(arguments.root):
        for row in _measure(open_scene(folder), arguments):
            rows.append(row)
            print(
                f"{row.scene + '/' + row.object:28s} {row.way:5s} {row.view}  "
                f"{row.raw_iou:5.1f} -> {row.trimmed_iou:5.1f}  {row.selected:7,} selected  {row.understood}",
                flush=True,
            )
    for scene in sorted({row.scene for row in rows}):
        for way in arguments.ways:
            chosen = [row for row in rows if (row.scene, row.way) == (scene, way)]
            raw, trimmed = (np.mean([getattr(row, key) for row in chosen]) for key in ("raw_iou", "trimmed_iou"))
            worst = min(chosen, key=lambda row: row.trimmed_iou)
            print(f"{scene:12s} {way:5s} {raw:5.1f} -> {trimmed:5.1f}, worst {worst.object} {worst.trimmed_iou:.1f}")
    if arguments.output:
        arguments.output.write_text(json.dumps([asdict(row) for row in rows], indent=1))


def _folders(root: Path) -> list[Path]:
    return [root] if (root / "cameras.json").is_file() else sorted(path.parent for path in root.glob("*/cameras.json"))


def _measure(scene: BenchmarkScene, arguments: Arguments) -> Iterator[Row]:
    cameras = None if arguments.without_cameras else _training_cameras(scene.folder)
    config = TrimConfig()
    if scene.up is not None and cameras is not None:
        config = replace(config, up=tuple(scene.up.tolist()))
    up = find_up(scene.gaussians, cameras, config.up).direction
    for name in scene.objects:
        if arguments.objects and name not in arguments.objects:
            continue
        views = [view for view in scene.test_views(name) if not view.far]
        camera, mask = _best_view(scene, name)
        for way in arguments.ways:
            try:
                pick = _select(scene.gaussians, camera, mask, way, up, cameras, arguments.sam_model)
            except InputError as refused:
                yield Row(scene.name, name, way, camera.name, str(refused), 0, 0.0, 0.0)
                continue
            result = trim(scene.gaussians, pick.selection, config=config, cameras=cameras)
            yield Row(
                scene.name, name, way, camera.name, " and ".join(pick.ways), int(np.count_nonzero(pick.selection)),
                _iou(scene.gaussians.select(pick.selection), views), _iou(result.object, views),
            )  # fmt: skip


def _select(
    gaussians: Gaussians, camera: Camera, mask: BoolArray, way: Way, up: Float64Array, cameras: CameraSet | None,
    sam_model: Path | None,
) -> Pick:  # fmt: skip
    seen_from = cameras.cameras if cameras else ()
    if sam_model is not None:
        marks = box_around(mask) if way == "box" else [middle_of(mask)]
        return select_by_model(gaussians, camera, marks, up, _RENDERER, _sam(sam_model), seen_from)
    if way == "box":
        return select_by_box(gaussians, camera, box_around(mask), up, _RENDERER, seen_from)
    return select_by_clicks(gaussians, camera, [middle_of(mask)], up, _RENDERER, seen_from)


@cache
def _sam(folder: Path) -> SamSegmenter:
    """The model, loaded once."""
    return SamSegmenter(SamConfig(str(folder)))


def box_around(mask: BoolArray) -> Box:
    """The bounds of a mask (H, W) and a margin, within the picture."""
    x0, y0, x1, y1 = bounding_box(mask)
    return (
        max(x0 - _MARGIN, 0), max(y0 - _MARGIN, 0), min(x1 + _MARGIN, mask.shape[1]), min(y1 + _MARGIN, mask.shape[0])
    )  # fmt: skip


def middle_of(mask: BoolArray) -> tuple[int, int]:
    """The pixel (x, y) of a mask (H, W) that is farthest from its edge."""
    depth = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    y, x = np.unravel_index(int(np.argmax(depth)), depth.shape)
    return int(x), int(y)


def _best_view(scene: BenchmarkScene, name: str) -> tuple[Camera, BoolArray]:
    """The training view whose mask of the object is largest, and that mask."""
    masks = [(camera, scene.coverage(name, camera.name) > 0.5) for camera in scene.training_cameras]
    return max(masks, key=lambda found: np.count_nonzero(found[1]))


def _training_cameras(folder: Path) -> CameraSet:
    """The training cameras alone: held-out views are ground truth."""
    listed = read_camera_set(folder / "cameras.json")
    kept = tuple(camera for camera, train in zip(listed.cameras, listed.train, strict=True) if train)
    return replace(listed, cameras=kept, train=(True,) * len(kept))


def _iou(gaussians: Gaussians, views: Sequence[TestView]) -> float:
    """Mean foreground IoU over the views, percent, with the object rendered alone."""
    shown = [(_RENDERER.render(gaussians, view.camera).alpha, view) for view in views]
    return 100 * float(np.mean([metrics.foreground_iou(alpha, view.coverage, view.valid) for alpha, view in shown]))


if __name__ == "__main__":
    main()
