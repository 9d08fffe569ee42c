"""How many pairs of things that touch are found apart?

    python benchmarks/touching.py ROOT [ROOT ...]

Each ROOT is a benchmark scene (see benchmark_scenes.py) in which objects stand on one surface. Of each pair of them one
is shifted along that surface until it touches the other, with nothing else changed. Both are found apart if two sure
objects show with an intersection over union of 80 percent of theirs, counted in the pixels of the views that the
program looks at.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
import tyro
from benchmark_scenes import BenchmarkScene, open_scene

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import only_training
from gaussian_trimmer.finding.find import find_objects
from gaussian_trimmer.finding.found import FoundObjects
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, sigmoid
from gaussian_trimmer.geometry.neighbours import nearest
from gaussian_trimmer.trimming.up_vector import find_up

_STEPS, _HALVINGS = 160, 8
_TOUCHING_SHARE = 1 / 300
"""Share of the shifted object's Gaussians that must lie next to the other one."""
FOUND = 0.8
"""Intersection over union from which on an object is found."""


@dataclass(frozen=True)
class Arguments:
    """Measure how things that touch are found apart."""

    roots: tyro.conf.Positional[tuple[Path, ...]]
    """Benchmark scenes."""


def main() -> None:
    """Print a line for each pair and the number that are found apart."""
    arguments = tyro.cli(Arguments, description=__doc__)
    apart = []
    for root in arguments.roots:
        scene = open_scene(root)
        cameras = only_training(read_camera_set(scene.cameras_file))
        up = np.asarray(find_up(scene.gaussians, cameras, None).direction, np.float64)
        for names, gaussians, masks in touching_pairs(scene, up):
            found = find_objects(gaussians, cameras=cameras, up=up)
            matched = [_matched(found, mask) for mask in masks]
            apart.append(min(iou for iou, _ in matched) > FOUND and matched[0][1] != matched[1][1])
            ious = ", ".join(f"{name} {iou:.2f}" for name, (iou, _) in zip(names, matched, strict=True))
            print(scene.name, ious, "apart" if apart[-1] else "together", flush=True)
    print(f"{sum(apart)} of {len(apart)} pairs apart")


def touching_pairs(
    scene: BenchmarkScene, up: Float64Array
) -> Iterator[tuple[tuple[str, str], Gaussians, list[BoolArray]]]:
    """The names of two objects, the scene in which they touch, and their Gaussians, (N,) each."""
    for names in combinations(scene.objects, 2):
        still, other = (scene.coarse(name, "exact") for name in names)
        moving = other & ~still
        means = scene.gaussians.means.copy()
        solid = sigmoid(scene.gaussians.opacity_logits) > 0.5
        shift = _shift(means[still & solid], means[moving & solid], up)
        if shift is not None:
            means[moving] += shift
            yield names, replace(scene.gaussians, means=means), [still, moving]


def _shift(still: FloatArray, moving: FloatArray, up: Float64Array) -> FloatArray | None:
    """How far the moving object (M, 3) goes towards the still one (S, 3) until it touches; None if it misses it."""
    towards = np.median(still, axis=0).astype(np.float64) - np.median(moving, axis=0)
    towards -= (towards @ up) * up
    direction = towards / np.linalg.norm(towards)
    spacing = float(np.sqrt(np.median(nearest(moving, moving, 2)[0][:, 1])))
    rank = max(3, int(_TOUCHING_SHARE * len(moving)))

    def touches(length: float) -> bool:
        shifted = (moving + length * direction).astype(np.float32)
        return bool(np.sort(nearest(still, shifted, 1)[0][:, 0])[rank] < spacing**2)

    reach = float(np.ptp(still @ direction) + np.ptp(moving @ direction))
    middle = float(np.linalg.norm(towards))
    lengths = np.linspace(middle - 1.2 * reach, middle + 0.8 * reach, _STEPS)
    first = next((number for number, length in enumerate(lengths) if touches(length)), None)
    if first is None:
        return None
    low, high = float(lengths[max(first - 1, 0)]), float(lengths[first])
    for _ in range(_HALVINGS):
        half = (low + high) / 2
        low, high = (low, half) if touches(half) else (half, high)
    return np.asarray(high * direction, np.float32)


def _matched(found: FoundObjects, mask: BoolArray) -> tuple[float, int]:
    """Intersection over union of some Gaussians (N,) with the sure object that is most alike, and its number."""
    assert found.surface is not None  # such scenes are small
    weights, part = found.surface.shown.sum(axis=0), mask[found.surface.rows]
    labels = found.labels[found.surface.rows]
    alike = [(0.0, 0)]
    for one in found:
        if one.sure:
            own = labels == one.id
            alike.append((float(weights[part & own].sum() / weights[part | own].sum()), one.id))
    return max(alike)


if __name__ == "__main__":
    main()
