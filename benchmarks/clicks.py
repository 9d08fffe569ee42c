"""How good is a selection by one box or one click, as it is selected and after the trim?

    python benchmarks/clicks.py ROOT [--ways box click] [--marks 3] [--objects NAME ...] [--without-cameras]
        [--output FILE]

ROOT holds benchmark scenes (see benchmark_scenes.py), or is one. The user is simulated: in the
training view whose mask of the object is largest, the box is the mask's bounds and two pixels more, within the
picture, and the click is the pixel farthest from the mask's edge. No other ground truth reaches the program.

With --marks, more clicks follow: each in the training view in which the selection is worst, on the pixel of its largest
wrong region that is farthest from the region's edge; it adds or removes, whichever is right there. Then IoU is given
against the number of marks, beside that of the selection `exact`, trimmed too.
"""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from benchmark_scenes import BenchmarkScene, find_captures, open_scene
from quality import parser_of

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera, only_training
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation import metrics
from gaussian_trimmer.evaluation.ground_truth import TestView
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.geometry.graphs import distance_to_outside
from gaussian_trimmer.rendering import blend_values, render
from gaussian_trimmer.selecting.marks import Box, Click, Mark
from gaussian_trimmer.selecting.select import select
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.trimming.up_vector import find_up
from gaussian_trimmer.views.view import bounding_box

_GOOD_ENOUGH = 0.95
"""Share of the IoU of `exact` from which on no more marks are set."""
_MARGIN = 2
"""Pixels between the mask's bounds and the box."""


@dataclass(frozen=True)
class Row:
    """One selection and its scores."""

    scene: str
    object: str
    way: str
    view: str
    understood: str
    """The way in which the program took it, or why it refused."""
    selected: int
    """Gaussians in the selection."""
    raw_iou: float
    """Mean foreground IoU of the selection over the test views, percent."""
    trimmed_iou: float
    """The same after the trim."""
    marks: int = 1
    """Number of marks that it was made by."""
    exact_iou: float = 0.0
    """That of the selection `exact` after the trim, where several marks are asked for."""


def main() -> None:
    """Select, trim and measure each object in each way."""
    parser = parser_of(__doc__)
    parser.add_argument("root", type=Path, help="folder with benchmark scenes, or one scene")
    parser.add_argument("--ways", nargs="+", choices=("box", "click"), default=["box", "click"])
    parser.add_argument("--marks", type=int, default=1, help="number of marks at most")
    parser.add_argument("--objects", nargs="+", help="only these objects")
    parser.add_argument("--without-cameras", action="store_true", help="give neither cameras nor up vector")
    parser.add_argument("--output", type=Path, help="write all rows to this JSON file")
    arguments = parser.parse_args()
    rows = []
    for folder in find_captures(arguments.root):
        for row in _measure(open_scene(folder), arguments):
            rows.append(row)
            share = f"  ({row.trimmed_iou / row.exact_iou:.3f} of exact's {row.exact_iou:.1f})" if row.exact_iou else ""
            print(
                f"{row.scene + '/' + row.object:28s} {row.way:5s} {row.marks} {row.view}  {row.raw_iou:5.1f} -> "
                f"{row.trimmed_iou:5.1f}  {row.selected:7,} selected  {row.understood}{share}",
                flush=True,
            )
    for scene in sorted({row.scene for row in rows}):
        for way in arguments.ways:
            _summarise([row for row in rows if (row.scene, row.way) == (scene, way)], scene, way, arguments.marks)
    if arguments.output:
        arguments.output.write_text(json.dumps([asdict(row) for row in rows], indent=1))


def _summarise(rows: Sequence[Row], scene: str, way: str, marks: int) -> None:
    """Print means and the worst object after each number of marks; who was good enough stays as it was."""
    objects = sorted({row.object for row in rows})
    for number in range(1, marks + 1):
        latest = [[row for row in rows if row.object == name and row.marks <= number][-1] for name in objects]
        raw, trimmed = (np.mean([getattr(row, key) for row in latest]) for key in ("raw_iou", "trimmed_iou"))
        worst = min(latest, key=lambda row: row.trimmed_iou)
        share = ""
        if marks > 1:
            good = sum(row.trimmed_iou >= _GOOD_ENOUGH * row.exact_iou for row in latest)
            share = f", {good} of {len(latest)} at {100 * _GOOD_ENOUGH:.0f} % of exact"
        print(
            f"{scene:12s} {way:5s} {number} marks {raw:5.1f} -> {trimmed:5.1f}, "
            f"worst {worst.object} {worst.trimmed_iou:.1f}{share}"
        )


def _measure(scene: BenchmarkScene, arguments: Namespace) -> Iterator[Row]:
    cameras = None if arguments.without_cameras else only_training(read_camera_set(scene.folder / "cameras.json"))
    config = TrimConfig()
    if scene.up is not None and cameras is not None:
        config = replace(config, up=tuple(scene.up.tolist()))
    up = find_up(scene.gaussians, cameras, config.up).direction
    for name in scene.objects:
        if arguments.objects and name not in arguments.objects:
            continue
        views = [view for view in scene.test_views(name) if not view.far]
        camera, mask = best_view(scene, name)
        exact = 0.0
        if arguments.marks > 1:
            rough = scene.coarse(name, "exact")
            exact = _iou(trim(scene.gaussians, rough, config=config, cameras=cameras).object, views)
        for way in arguments.ways:
            first: Mark = Box(*box_around(mask), camera) if way == "box" else Click(*middle_of(mask), camera)
            marks: list[Any] = [first]
            while True:
                number, view = len(marks), marks[-1].view.name
                try:
                    made = select(scene.gaussians, marks, cameras=cameras, up=up)
                except InputError as refused:
                    yield Row(scene.name, name, way, view, str(refused), 0, 0.0, 0.0, number, exact)
                    break
                result = trim(scene.gaussians, made.mask, config=config, cameras=cameras)
                row = Row(
                    scene.name, name, way, view, made.interpretations[-1], int(np.count_nonzero(made.mask)),
                    _iou(scene.gaussians.select(made.mask), views), _iou(result.object, views), number, exact,
                )  # fmt: skip
                yield row
                good = exact > 0 and row.trimmed_iou >= _GOOD_ENOUGH * exact
                if number >= arguments.marks or good or not (mark := _next_click(scene, name, made.mask)):
                    break
                marks.append(mark)


def _next_click(scene: BenchmarkScene, name: str, selection: BoolArray) -> Click | None:
    """A click in the middle of the largest wrong region of the training view that is worst, or None if all is right."""
    worst, found = 1.0, None
    values = selection.astype(np.float32)[:, None]
    for camera in scene.training_cameras:
        truth = scene.coverage(name, camera.name) > 0.5
        shown = blend_values(scene.gaussians, camera, values)[..., 0] > 0.5
        union = np.count_nonzero(truth | shown)
        iou = np.count_nonzero(truth & shown) / union if union else 1.0
        if iou < worst:
            worst, found = iou, (camera, truth, shown)
    if found is None:
        return None
    camera, truth, shown = found
    regions = []
    for wrong in (truth & ~shown, shown & ~truth):
        _, labels, stats, _ = cv2.connectedComponentsWithStats(wrong.astype(np.uint8), connectivity=4)
        regions += [(stats[i, cv2.CC_STAT_AREA], labels == i) for i in range(1, len(stats))]
    _, region = max(regions, key=lambda entry: entry[0])
    x, y = middle_of(region)
    return Click(x, y, camera, "add" if truth[y, x] else "remove")


def box_around(mask: BoolArray) -> tuple[int, int, int, int]:
    """The bounds of a mask (H, W) and a margin, within the picture."""
    x0, y0, x1, y1 = bounding_box(mask)
    return (
        max(x0 - _MARGIN, 0), max(y0 - _MARGIN, 0), min(x1 + _MARGIN, mask.shape[1]), min(y1 + _MARGIN, mask.shape[0])
    )  # fmt: skip


def middle_of(mask: BoolArray) -> tuple[int, int]:
    """The pixel (x, y) of a mask (H, W) that is farthest from its edge."""
    depth = distance_to_outside(mask, beyond=False)
    y, x = np.unravel_index(int(np.argmax(depth)), depth.shape)
    return int(x), int(y)


def best_view(scene: BenchmarkScene, name: str) -> tuple[Camera, BoolArray]:
    """The training view whose mask of the object is largest, and that mask."""
    masks = [(camera, scene.coverage(name, camera.name) > 0.5) for camera in scene.training_cameras]
    return max(masks, key=lambda found: np.count_nonzero(found[1]))


def _iou(gaussians: Gaussians, views: Sequence[TestView]) -> float:
    """Mean foreground IoU over the views, percent, with the object rendered alone."""
    shown = [(render(gaussians, view.camera).alpha, view) for view in views]
    return 100 * float(np.mean([metrics.foreground_iou(alpha, view.coverage, view.counted) for alpha, view in shown]))


if __name__ == "__main__":
    main()
