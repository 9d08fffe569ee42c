"""How well are all objects of a scene found, without a click?

    python benchmarks/found.py ROOT [--trim] [--without-cameras]

ROOT holds benchmark scenes (see benchmark_scenes.py), or is one. The program knows the training cameras and nothing of
the masks. Objects are compared over the pixels of all held-out views together, and only sure ones: a true object is
found if one of them has an IoU of 80 with it, and missed below 50; a false one has 50 with none. IoU in the lines below
is that of each true object, rendered alone, before the trim and, with --trim, after it.
"""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import numpy as np
from benchmark_scenes import BenchmarkScene, find_captures, open_scene
from quality import parser_of

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import only_training
from gaussian_trimmer.evaluation import metrics
from gaussian_trimmer.evaluation.metrics import ious_of, shared_pixels
from gaussian_trimmer.finding.find import find_objects
from gaussian_trimmer.gaussians import Gaussians, IntArray, mask_of_rows
from gaussian_trimmer.rendering import render
from gaussian_trimmer.trimming.trim import trim_objects

FOUND_IOU, MATCHING_IOU = 0.8, 0.5
SPLIT_SHARE, MERGED_SHARE = 0.2, 0.5
"""Share of a true object that each of its pieces has, where it is split; and that one found object has of each of
several true ones, where these are merged."""


def main() -> None:
    """Print a line for each scene and for each of its objects."""
    parser = parser_of(__doc__)
    parser.add_argument("root", type=Path, help="folder with benchmark scenes, or one scene")
    parser.add_argument("--trim", action="store_true", help="also trim them")
    parser.add_argument("--without-cameras", action="store_true", help="give the program no cameras")
    arguments = parser.parse_args()
    for folder in find_captures(arguments.root):
        _measure(open_scene(folder), arguments)


def counts(shared: IntArray) -> dict[str, float]:
    """What became of the true objects, by the pixels that they share with those that were found, (T + 1, P + 1)."""
    ious, covered = ious_of(shared), shared[1:, 1:] / np.maximum(shared[1:].sum(axis=1, keepdims=True), 1)
    best = ious.max(axis=1, initial=0)
    return {
        "true objects": len(best),
        "found": int((best >= FOUND_IOU).sum()),
        "missed": int((best < MATCHING_IOU).sum()),
        "false": int((ious.max(axis=0, initial=0) < MATCHING_IOU).sum()),
        "split": int(((covered > SPLIT_SHARE).sum(axis=1) > 1).sum()),
        "merged": int(((covered > MERGED_SHARE).sum(axis=0) > 1).sum()),
        "mean IoU (%)": 100 * float(best.mean()),
    }


def _measure(scene: BenchmarkScene, arguments: Namespace) -> None:
    cameras = None if arguments.without_cameras else only_training(read_camera_set(scene.cameras_file))
    found = find_objects(scene.gaussians, cameras=cameras)
    selections = found.selections()
    views = [
        (camera, [scene.coverage(name, camera.name) for name in scene.objects])
        for camera, far in scene.test_frames
        if not far
    ]
    masks = [mask_of_rows(rows, len(scene.gaussians)) for rows in selections.values()]
    shared = shared_pixels(scene.gaussians, masks, views)
    print(scene.name, ", ".join(f"{name} {value:.4g}" for name, value in counts(shared).items()), flush=True)
    trimmed = (
        trim_objects(scene.gaussians, selections, cameras=cameras).objects if arguments.trim and selections else ()
    )
    numbers = list(selections)
    for name, ious in zip(scene.objects, ious_of(shared), strict=True):
        if ious.any():
            best = int(np.argmax(ious))
            parts = [scene.gaussians.select(selections[numbers[best]]), *([trimmed[best].gaussians] if trimmed else [])]
            print(f"  {name:12s}", " -> ".join(f"{_iou(scene, name, part):.1f}" for part in parts), flush=True)
        else:
            print(f"  {name:12s} missed", flush=True)


def _iou(scene: BenchmarkScene, name: str, part: Gaussians) -> float:
    """Mean foreground IoU over the held-out views, percent, with the object rendered alone."""
    views = [view for view in scene.test_views(name) if not view.far]
    ious = [metrics.foreground_iou(render(part, v.camera).alpha, v.coverage, v.counted) for v in views]
    return 100 * float(np.mean(ious))


if __name__ == "__main__":
    main()
