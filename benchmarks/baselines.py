"""What does trimming add to methods that lift masks of training views? Each alone, with the defaults, and as the paper.

    python benchmarks/baselines.py SCENE [SCENE ...] [--sam-model DIR | --masks DIR] [--format latex] [--output DIR]

SCENE is a benchmark scene (see benchmark_scenes.py). Masks of ten training views are made by a model of the SAM family
in what the scene shows there, prompted by the bounds of the true mask; or they are those of --masks DIR/<object>/, or
else the scene's own. The methods are those of other programs, written anew after their papers and code:

    FlashSplat          the optimal assignment of blend weights to two labels, where these are a pixel at least
    SAGD                centres within the masks of more than 0.7 of the views
    SAGD, decomposed    the same, and Gaussians whose longest axis leaves a mask shortened to the part within, as the
                        published code does it: rows of the rotation for columns, directions projected as points
    SAGD, mended        the same without these two
    COB-GS-like         Gaussians that masks pull in both directions cut in two, twice, and all assigned anew

Means are over the objects, each over its test views, with 95 % bootstrap intervals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from benchmark_scenes import BenchmarkScene, open_scene
from tyro.conf import Positional, arg
from variants import chosen_variants

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera, only_training
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.commands.evaluate import RuleOptions
from gaussian_trimmer.commands.tables import Findings, TableOptions, print_run
from gaussian_trimmer.evaluation.ground_truth import read_mask
from gaussian_trimmer.evaluation.provenance import made_by
from gaussian_trimmer.evaluation.results import cut_by
from gaussian_trimmer.evaluation.runs import Run, Trial, evenly_spread, measure, unit_scores
from gaussian_trimmer.evaluation.statistics import interval_of
from gaussian_trimmer.evaluation.tables import Cell, ScoreTable
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, concatenate, rotation_matrices
from gaussian_trimmer.geometry.split import AXIS_LENGTH, SAGD_SHRINKAGE, split_plane
from gaussian_trimmer.masks.prompts import Prompt
from gaussian_trimmer.masks.sam import SamConfig, SamSegmenter
from gaussian_trimmer.rendering import render
from gaussian_trimmer.selecting.lifting import sum_label_weights
from gaussian_trimmer.views.view import bounding_box

VOTES = 0.7
SEEN = 1.0
"""Blend weight in pixels, over all views, below which an assignment says nothing: the object alone would show it."""
SAMPLES = 33
"""Points along a Gaussian's longest axis."""
PULLED_BOTH_WAYS = 0.5
"""Share of a Gaussian's blend weight by which it must not lean to either side, to be cut."""
ROUNDS = 2
METRICS = {"iou": "IoU", "iou_in_scene": "IoU in scene", "boundary_iou": "boundary IoU"}


@dataclass(frozen=True, eq=False)
class Lifting:
    """What a method is given."""

    gaussians: Gaussians
    cameras: Sequence[Camera]
    masks: Sequence[BoolArray]
    """Of the object in each of these cameras, (H, W)."""


Lifted = tuple[Gaussians, BoolArray]
"""The scene as the method leaves it, and which of its Gaussians are the object's."""


def flashsplat(given: Lifting) -> Lifted:
    return given.gaussians, _assigned(_weights(given, given.gaussians))


def sagd(given: Lifting) -> Lifted:
    pairs = zip(given.cameras, given.masks, strict=True)
    within = np.array([_inside(camera, mask, given.gaussians.means) for camera, mask in pairs])  # (V, N)
    return given.gaussians, np.asarray(within.mean(axis=0) > VOTES)


def sagd_decomposed(given: Lifting, *, mended: bool = False) -> Lifted:
    _, selection = sagd(given)
    part = given.gaussians.select(selection)
    for camera, mask in zip(given.cameras, given.masks, strict=True):
        turns, lengths = rotation_matrices(part.quaternions), part.scales
        every, longest = np.arange(len(part)), lengths.argmax(axis=1)
        axes = turns[every, :, longest] if mended else turns[every, longest]  # (M, 3)
        half = 0.5 * AXIS_LENGTH * lengths[every, longest, None] * axes
        origin = part.means if mended else np.zeros_like(part.means)
        steps = np.linspace(-1, 1, SAMPLES)
        within = np.stack([_inside(camera, mask, origin + step * half) for step in steps], axis=1)  # (M, S)
        cut = _inside(camera, mask, part.means) & (within[:, 0] != within[:, -1])
        share = np.where(cut, np.maximum(within.mean(axis=1), 1 / SAMPLES), 1.0)[:, None]
        towards = np.where(within[:, -1:], 1.0, -1.0)  # the end that is within the mask
        shrunk = np.where(cut[:, None], np.log(SAGD_SHRINKAGE * share), 0.0)
        part = part.replace(means=part.means + towards * (1 - share) * half, log_scales=part.log_scales + shrunk)
    rest = given.gaussians.select(~selection)
    return concatenate([part, rest]), np.arange(len(part) + len(rest)) < len(part)


def sagd_mended(given: Lifting) -> Lifted:
    return sagd_decomposed(given, mended=True)


def cob_gs_like(given: Lifting) -> Lifted:
    gaussians = given.gaussians
    for _ in range(ROUNDS):
        weights = _weights(given, gaussians)
        total = weights.sum(axis=1)
        cut = (total > 0) & (abs(weights[:, 1] - weights[:, 0]) < PULLED_BOTH_WAYS * total)
        parents = gaussians.select(cut)
        axes = rotation_matrices(parents.quaternions)[np.arange(len(parents)), :, parents.log_scales.argmax(axis=1)]
        children = split_plane(parents, np.asarray(axes, np.float64), np.zeros(len(parents)))
        gaussians = concatenate([gaussians.select(~cut), *children])
    return gaussians, _assigned(_weights(given, gaussians))


METHODS: dict[str, Callable[[Lifting], Lifted]] = {
    "FlashSplat": flashsplat,
    "SAGD": sagd,
    "SAGD, decomposed": sagd_decomposed,
    "SAGD, mended": sagd_mended,
    "COB-GS-like": cob_gs_like,
}


@dataclass(frozen=True)
class Baselines:
    """Measure methods that lift masks, each alone and trimmed."""

    scenes: Annotated[Positional[tuple[Path, ...]], arg(metavar="SCENE")]
    """Benchmark scenes."""
    methods: tuple[str, ...] = tuple(METHODS)
    objects: tuple[str, ...] = ()
    """Only these objects."""
    views: int = 10
    """Number of training views, evenly spread."""
    sam_model: Path | None = None
    """Folder with a model of the SAM family that makes the masks."""
    masks: Path | None = None
    """Folder with a folder of masks for each object, named like the training views."""
    variants: tuple[str, ...] = ("default", "paper")
    """Ways of trimming; see variants.py."""
    rules: Annotated[RuleOptions, arg(name="")] = field(default_factory=RuleOptions)
    tables: Annotated[TableOptions, arg(name="")] = field(default_factory=TableOptions)

    def run(self) -> None:
        self.tables.publish(self._measure, open_console(quiet=False))

    def _measure(self) -> Findings:
        judge, runs = self.rules.judge(), list[Run]()
        chosen = chosen_variants(self.variants, self.sam_model)
        progress, overlaps = open_console(quiet=self.tables.for_programs), list[float]()
        for folder in self.scenes:
            for trial in self._trials(open_scene(folder), overlaps, progress.print):
                for run in measure(trial, chosen, judge, fidelity=False):
                    runs.append(run)
                    print_run(run, progress)
        made = f"masks of {self.views} training views: {self._how()}, IoU {100 * np.mean(overlaps):.1f} with the true"
        return Findings({"baselines": table_of(runs, self.variants, [made, judge.describe(), made_by()])}, runs)

    def _how(self) -> str:
        return f"SAM by true boxes ({self.sam_model.name})" if self.sam_model else str(self.masks or "the scene's own")

    def _trials(self, scene: BenchmarkScene, overlaps: list[float], report: Callable[[str], None]) -> Iterator[Trial]:
        listed = only_training(read_camera_set(scene.cameras_file))
        cameras = evenly_spread(listed, self.views) or []
        up = None if scene.up is None else tuple(scene.up.tolist())
        model = SamSegmenter(SamConfig(str(self.sam_model))) if self.sam_model else None
        for name in scene.objects:
            if self.objects and name not in self.objects:
                continue
            masks = []
            for camera in cameras:
                truth = scene.coverage(name, camera.name) > 0.5
                mask = truth
                if model is not None and truth.any():
                    found = model.propose(render(scene.gaussians, camera).rgb, Prompt(bounding_box(truth)))
                    mask = found.logits[int(np.argmax(found.scores))] > 0
                elif self.masks is not None:
                    mask = read_mask(self.masks / name / camera.name) > 0.5
                masks.append(np.asarray(mask))
                overlaps.append(float((mask & truth).sum() / max((mask | truth).sum(), 1)))
            report(f"{scene.name}/{name}: IoU of the masks {100 * np.mean(overlaps[-len(cameras) :]):.1f}")
            views = [view for view in scene.test_views(name) if not view.far]
            for method in self.methods:
                gaussians, selection = METHODS[method](Lifting(scene.gaussians, cameras, masks))
                before = cut_by(gaussians, selection)
                yield Trial(scene.name, name, method, gaussians, selection, before, views, listed, up)


def table_of(runs: Sequence[Run], variants: Sequence[str], notes: Sequence[str]) -> ScoreTable:
    """Return rows for each method: alone, and trimmed in each way; means over objects with intervals."""
    rows: list[list[Cell]] = []
    for method in dict.fromkeys(run.kind for run in runs):
        for number, variant in enumerate(variants):
            own = [run for run in runs if (run.kind, run.variant) == (method, variant)]
            scores = unit_scores(own, "objects").values()
            if number == 0:
                rows.append([method, *(interval_of([before[name] for before, _ in scores]) for name in METRICS)])
            rows.append([f"+ {variant}", *(interval_of([after[name] for _, after in scores]) for name in METRICS)])
    return ScoreTable("Methods that lift masks, alone and trimmed", ["", *METRICS.values()], rows, notes, digits=1)


def _weights(given: Lifting, gaussians: Gaussians) -> Float64Array:
    """Blend weight of each Gaussian outside and inside of the masks, (N, 2)."""
    labels = [mask.astype(np.uint8) for mask in given.masks]
    return np.asarray(sum_label_weights(gaussians, given.cameras, labels, 2))


def _assigned(weights: Float64Array) -> BoolArray:
    """Which Gaussians weigh more inside of the masks than outside, (N,), of those that are seen."""
    return np.asarray((weights[:, 1] > weights[:, 0]) & (weights.sum(axis=1) > SEEN))


def _inside(camera: Camera, mask: BoolArray, points: FloatArray | Float64Array) -> BoolArray:
    """Which points (M, 3) a camera sees within a mask, whatever stands before them, (M,)."""
    pixels, depths = camera.project(np.asarray(points, np.float64))
    x, y = np.floor(np.clip(np.nan_to_num(pixels, nan=-1.0), -1, 1e6)).astype(np.int64).T
    seen = (depths > 0) & (x >= 0) & (y >= 0) & (x < camera.width) & (y < camera.height)
    return np.asarray(seen & mask[np.where(seen, y, 0), np.where(seen, x, 0)])


if __name__ == "__main__":
    tyro.cli(Baselines).run()
