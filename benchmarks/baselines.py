"""What does trimming add to methods that lift masks of training views? Each alone, with the defaults, and as the paper.

    python benchmarks/baselines.py SCENE [SCENE ...] [--sam-model DIR | --masks DIR] [--format latex] [--output DIR]

SCENE is a benchmark scene (see benchmark_scenes.py). Masks of ten training views are made by a model of the SAM family
in what the scene shows there, prompted by the bounds of the true mask: of what it proposes, the mask that fills them
best is taken. Or they are those of --masks DIR/<object>/, or else the scene's own. The methods are those of other
programs, written anew after their papers and code:

    FlashSplat          the optimal assignment of blend weights to two labels, where these are a pixel at least
    SAGD                centres within the masks of more than 0.7 of the views
    SAGD, decomposed    the same, and Gaussians whose longest axis leaves a mask shortened to the part within, as the
                        published code does it: rows of the rotation for columns, directions projected as points
    SAGD, mended        the same without these two
    COB-GS-like         Gaussians that masks pull in both directions cut in two, twice, and all assigned anew

Means are over the objects, each over its test views, with 95 % t intervals from five captures on.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from benchmark_scenes import capture_of, open_scene
from quality import parser_of
from variants import chosen_variants

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera, only_training, training_cameras
from gaussian_trimmer.commands.evaluate import Findings, publish
from gaussian_trimmer.evaluation.ground_truth import read_mask
from gaussian_trimmer.evaluation.scoring import Judge, cut_by
from gaussian_trimmer.evaluation.tables import MADE_BY, Cell, ScoreTable, interval_of, unit_scores
from gaussian_trimmer.evaluation.trials import Run, Trial, measure
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, concatenate, rotation_matrices
from gaussian_trimmer.geometry.split import AXIS_LENGTH, SAGD_SHRINKAGE, split_plane
from gaussian_trimmer.masks.sam import agreement
from gaussian_trimmer.masks.sam_onnx import OnnxSam, Prompt
from gaussian_trimmer.rendering import render
from gaussian_trimmer.selecting.lifting import sum_label_weights
from gaussian_trimmer.surface.visible_surface import evenly_spread
from gaussian_trimmer.views.view import bounding_box, box_slices

VOTES = 0.7
SEEN = 1.0
"""Blend weight in pixels, over all views, below which an assignment says nothing: the object alone would show it."""
SAMPLES = 33
"""Points along a Gaussian's longest axis."""
PULLED_BOTH_WAYS = 0.5
"""Share of a Gaussian's blend weight by which it must not lean to either side, to be cut."""
ROUNDS = 2
METRICS = {"iou": "IoU", "iou_in_scene": "IoU in scene", "boundary_iou": "boundary IoU"}


class Lifting(NamedTuple):
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


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("scenes", nargs="+", type=Path, help="benchmark scenes")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--objects", nargs="+", help="only these objects")
    parser.add_argument("--views", type=int, default=10, help="number of training views, evenly spread")
    parser.add_argument("--sam-model", type=Path, help="folder of a model of the SAM family that makes the masks")
    parser.add_argument("--masks", type=Path, help="folder of a folder of masks for each object, named like the views")
    parser.add_argument("--variants", nargs="+", default=["default", "paper"], help="ways of trimming; see variants.py")
    parser.add_argument("--output", type=Path, help="folder to write the table to, in every format")
    options = parser.parse_args()
    publish(lambda: baselines(options), output=options.output)


def baselines(options: Namespace) -> Findings:
    """Measure methods that lift masks, each alone and trimmed."""
    judge, runs, overlaps = Judge(), list[Run](), list[float]()
    ways = chosen_variants(options.variants, options.sam_model)
    for trial in lifted_trials(options, overlaps):
        for run in measure(trial, ways, judge, fidelity=False):
            runs.append(run)
            print(run, flush=True)
    how = f"SAM by true boxes ({options.sam_model.name})" if options.sam_model else options.masks or "the scene's own"
    made = f"masks of {options.views} training views: {how}, IoU {100 * np.mean(overlaps):.1f} with the true"
    return {"baselines": table_of(runs, options.variants, [made, judge.describe(), MADE_BY])}, runs, {}


def lifted_trials(options: Namespace, overlaps: list[float]) -> Iterator[Trial]:
    """What each method makes of the masks of each object; how good the masks are is added to `overlaps`."""
    model = OnnxSam(options.sam_model) if options.sam_model else None
    for scene in map(open_scene, options.scenes):
        listed = only_training(read_camera_set(scene.cameras_file))
        cameras = evenly_spread(training_cameras(listed), options.views)
        up = None if scene.up is None else tuple(scene.up.tolist())
        for name in options.objects or scene.objects:
            masks = []
            for camera in cameras:
                truth = scene.coverage(name, camera.name) > 0.5
                mask = truth
                if model is not None and truth.any():
                    prompt, in_box = Prompt(bounding_box(truth)), np.zeros(truth.shape, np.float32)
                    in_box[box_slices(prompt.box)] = 1
                    found = model.propose(render(scene.gaussians, camera).rgb, prompt) > 0
                    mask = found[int(np.argmax([agreement(one, in_box) for one in found]))]
                elif options.masks is not None:
                    mask = read_mask(options.masks / name / camera.name) > 0.5
                masks.append(np.asarray(mask))
                overlaps.append(float((mask & truth).sum() / max((mask | truth).sum(), 1)))
            print(f"{scene.name}/{name}: IoU of the masks {100 * np.mean(overlaps[-len(cameras) :]):.1f}")
            views = [view for view in scene.test_views(name) if not view.far]
            for method in options.methods:
                gaussians, selection = METHODS[method](Lifting(scene.gaussians, cameras, masks))
                yield Trial(scene.name, name, method, gaussians, cut_by(gaussians, selection), views, listed, up)


def table_of(runs: Sequence[Run], variants: Sequence[str], notes: Sequence[str]) -> ScoreTable:
    """Return rows for each method: alone, and trimmed in each way; means over objects with intervals."""
    rows: list[list[Cell]] = []
    for method in dict.fromkeys(run.kind for run in runs):
        for number, variant in enumerate(variants):
            own = [run for run in runs if (run.kind, run.variant) == (method, variant)]
            scores = unit_scores(own, "objects")
            captures = [capture_of(unit.partition("/")[0]) for unit in scores]
            for label, when in ([(method, 0)] if number == 0 else []) + [(f"+ {variant}", 1)]:
                values = ([pair[when][name] for pair in scores.values()] for name in METRICS)
                rows.append([label, *(interval_of(of_metric, captures) for of_metric in values)])
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
    main()
