"""How well are all objects of a scene found, without a click?

    python benchmarks/found.py ROOT [--trim] [--without-cameras]

ROOT holds benchmark scenes (see benchmark_scenes.py), or is one. The program knows the training cameras and nothing of
the masks. Scores are those of `evaluate objects` over the sure objects in the held-out views; IoU is that of each true
object, rendered alone, before the trim and, with --trim, after it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from benchmark_scenes import BenchmarkScene, open_scene

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import only_training
from gaussian_trimmer.evaluation import metrics
from gaussian_trimmer.evaluation.panoptic import compare_objects
from gaussian_trimmer.finding.find import find_objects
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.rendering import render
from gaussian_trimmer.trimming.trim import trim_objects


@dataclass(frozen=True)
class Arguments:
    """Measure the objects that are found against ground truth."""

    root: tyro.conf.Positional[Path]
    """Folder with benchmark scenes, or one scene."""
    trim: bool = False
    """Also trim them."""
    without_cameras: bool = False
    """Give the program no cameras."""


def main() -> None:
    """Print a line for each scene and for each of its objects."""
    arguments = tyro.cli(Arguments, description=__doc__)
    root = arguments.root
    listed = [root] if (root / "cameras.json").is_file() else [path.parent for path in root.glob("*/cameras.json")]
    for folder in sorted(listed):
        _measure(open_scene(folder), arguments)


def _measure(scene: BenchmarkScene, arguments: Arguments) -> None:
    cameras = None if arguments.without_cameras else only_training(read_camera_set(scene.cameras_file))
    found = find_objects(scene.gaussians, cameras=cameras)
    selections = found.selections()
    views = [
        (camera, [scene.coverage(name, camera.name) for name in scene.objects])
        for camera, far in scene.test_frames
        if not far
    ]
    scores = compare_objects(scene.gaussians, list(selections.values()), views)
    print(scene.name, ", ".join(f"{name} {value:.4g}" for name, value in scores.counts().items()), flush=True)
    trimmed = (
        trim_objects(scene.gaussians, selections, cameras=cameras).objects if arguments.trim and selections else ()
    )
    numbers = list(selections)
    for place, name in enumerate(scene.objects):
        if scores.best[place] > 0:
            best = int(np.argmax(scores.ious[place]))
            parts = [scene.gaussians.select(selections[numbers[best]]), *([trimmed[best].gaussians] if trimmed else [])]
            print(f"  {name:12s}", " -> ".join(f"{_iou(scene, name, part):.1f}" for part in parts), flush=True)
        else:
            print(f"  {name:12s} missed", flush=True)


def _iou(scene: BenchmarkScene, name: str, part: Gaussians) -> float:
    """Mean foreground IoU over the held-out views, percent, with the object rendered alone."""
    views = [view for view in scene.test_views(name) if not view.far]
    shown = [(render(part, view.camera).alpha, view) for view in views]
    return 100 * float(
        np.mean([metrics.foreground_iou(alpha, view.alone.coverage, view.alone.counted) for alpha, view in shown])
    )


if __name__ == "__main__":
    main()
