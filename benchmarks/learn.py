"""Learn weights that decide which Gaussians belong to the object, and compare them with the trimmer's own decision.

    python benchmarks/learn.py ROOT [ROOT ...] [--workers 2]

Each ROOT holds benchmark scenes (see benchmark_scenes.py); captures.py makes more of them. Whether a Gaussian should
belong to the object follows from the true masks of the training views: what it adds inside them minus what it adds
outside, in the whole scene and in the object alone. A logistic regression on the features of learned_decision.py weighs
each Gaussian by that difference, and each trim alike. A decision's score is the intersection over union of these
weights.

Scores are held out: the weights that judge a capture were learned without it, and without all captures that share its
objects or pictures.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from benchmark_scenes import BenchmarkScene, capture_of, find_scenes, open_scene
from learned_decision import FEATURES, features, likely, weigh
from quality import too_small
from tyro.conf import Positional, arg

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import CameraSet, only_training
from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.scope import Scope
from gaussian_trimmer.segmentation.label_crf import correct_labels
from gaussian_trimmer.segmentation.view_rendering import render_scope
from gaussian_trimmer.trimming.clock import Clock
from gaussian_trimmer.trimming.task import PlugIns, Task
from gaussian_trimmer.trimming.trim import decide
from gaussian_trimmer.views import HALF

TRUTH_VIEWS = 20
"""Training views whose masks tell the truth, at most."""
SAMPLES = 4000
"""Gaussians of a trim that the regression sees, drawn by how much they matter."""
LARGEST_SHARE = 0.02
"""Largest share of an object that one Gaussian counts for."""
PENALTY = 1e-4
STEPS = 12
LOSS = 0.3
"""Points; a trim that loses more has done harm."""


@dataclass(frozen=True, eq=False)
class Sample:
    """One rough selection: features of the Gaussians in reach, and the truth about them."""

    scene: str
    object: str
    kind: str
    features: FloatArray
    """(L, F)."""
    gain: Float64Array
    """Blend weight that each adds inside the true masks minus outside them, (L,)."""
    total: float
    """Sum of the positive gains of the whole scene."""
    selected: BoolArray
    """The rough selection, (L,)."""
    decided: BoolArray
    """What the trimmer makes of it, (L,)."""

    @property
    def capture(self) -> str:
        """What is left out together."""
        return capture_of(self.scene)

    def score(self, members: BoolArray) -> float:
        """Intersection over union of blend weights, in percent."""
        right, wrong = self.gain[members & (self.gain > 0)].sum(), self.gain[members & (self.gain < 0)].sum()
        return float(100 * right / (self.total - wrong))


def true_gains(scene: BenchmarkScene, name: str, candidates: BoolArray) -> Float64Array:
    """What each Gaussian adds inside the true masks minus outside them, in the scene and in the object alone, (N,).

    Args:
        scene: the scene.
        name: the object.
        candidates: what any selection has; of these, those that no view shows count as the object alone shows them.
    """
    renderer, cameras = get_renderer("numba"), scene.training_cameras
    chosen = cameras[:: max(1, len(cameras) // TRUTH_VIEWS)]
    masks = [scene.coverage(name, camera.name) > 0.5 for camera in chosen]
    views = list(zip(chosen, masks, strict=True))
    outside, inside = np.sum([renderer.blend_weights(scene.gaussians, c, m.astype(np.uint8), 2) for c, m in views], 0).T
    seen = inside + outside > 0.01 * len(views)
    rows = np.flatnonzero(np.where(seen, inside > 0.3 * (inside + outside), candidates))
    gain = (inside - outside).astype(np.float64)
    for camera, mask in views:
        sides = mask.astype(np.uint8)
        for other in scene.objects:
            if other != name:
                sides[(scene.coverage(other, camera.name) > 0.5) & ~mask] = 2  # it may hide this object
        weights = renderer.blend_weights(scene.gaussians.select(rows), camera, sides, 2)
        gain[rows] += weights[:, 1] - weights[:, 0]
    return np.asarray(gain)


def samples_of(folder: Path) -> list[Sample]:
    """All samples of a scene."""
    scene = open_scene(folder)
    cameras = only_training(read_camera_set(scene.cameras_file))
    found = []
    for name in scene.objects:
        kinds = {kind: scene.coarse(name, kind) for kind in scene.coarse_kinds(name)}
        kinds = {kind: chosen for kind, chosen in kinds.items() if not too_small(scene, name, kind, chosen)}
        gain = true_gains(scene, name, np.any(list(kinds.values()), axis=0))
        for kind, chosen in kinds.items():
            task = _task(scene, cameras, chosen)
            decision = decide(task, Clock(lambda stage: None))
            scope, total = decision.scope, float(gain[gain > 0].sum())
            decided = decision.parts.members if decision.parts else scope.selected
            values = _features(task, scope).astype(np.float32)
            found.append(Sample(scene.name, name, kind, values, gain[scope.rows], total, scope.selected, decided))
    return found


def _task(scene: BenchmarkScene, cameras: CameraSet, chosen: BoolArray) -> Task:
    config = TrimConfig() if scene.up is None else replace(TrimConfig(), up=tuple(scene.up.tolist()))
    nothing = np.zeros(len(chosen), np.bool_)
    return Task(scene.gaussians, chosen, nothing, config, PlugIns.of("numba", "silhouette"), cameras)


def _features(task: Task, scope: Scope) -> Float64Array:
    config, renderer = task.config, task.renderer
    visible = render_scope(scope, renderer).visible
    label = correct_labels(scope.local, scope.selected, visible, scope.bounds, config.label_crf)
    plane = scope.support_plane(label > HALF, visible, config.label_crf.support_plane)
    return features(scope, label, plane, weigh(task, scope, label, renderer))


class Regression:
    """Logistic regression on the Gaussians that matter, by Newton's method."""

    def __init__(self, samples: Sequence[Sample]) -> None:
        rng = np.random.default_rng(0)
        self.rows = {id(sample): self._drawn(sample, rng) for sample in samples}

    @staticmethod
    def _drawn(sample: Sample, rng: np.random.Generator) -> tuple[Float64Array, Float64Array, Float64Array]:
        matters = np.minimum(np.abs(sample.gain) / sample.total, LARGEST_SHARE)
        chance = np.minimum(1, matters / max(matters.sum(), 1e-12) * SAMPLES)
        drawn = rng.random(len(chance)) < chance
        truth = (sample.gain[drawn] > 0).astype(np.float64)
        return sample.features[drawn].astype(np.float64), truth, matters[drawn] / chance[drawn]

    def fit(self, samples: Sequence[Sample]) -> Float64Array:
        """The weights that make the truth of some samples likeliest, (F,)."""
        columns = zip(*(self.rows[id(sample)] for sample in samples), strict=True)
        values, truth, matters = (np.concatenate(column) for column in columns)
        matters, theta = matters / len(samples), np.zeros(values.shape[1])
        for _ in range(STEPS):
            likely = 1 / (1 + np.exp(-np.clip(values @ theta, -30, 30)))
            slope = values.T @ (matters * (likely - truth)) + PENALTY * theta
            curve = (values * (matters * likely * (1 - likely))[:, None]).T @ values + PENALTY * np.eye(len(theta))
            step = np.linalg.solve(curve, slope)
            theta -= step * min(1.0, 4 / np.abs(step).max())
        return np.asarray(theta)


@dataclass(frozen=True)
class Learn:
    """Learn the weights of the decision."""

    roots: Annotated[Positional[tuple[Path, ...]], arg(metavar="ROOT ...")]
    """Folders with benchmark scenes."""
    workers: int = 1
    """Processes that compute features."""

    def run(self) -> None:
        samples = list(self._samples())
        regression = Regression(samples)
        captures = sorted({sample.capture for sample in samples})
        held_out = {name: regression.fit([s for s in samples if s.capture != name]) for name in captures}
        final = regression.fit(samples)
        print(f"{len(samples)} selections of {len(captures)} captures; IoU of blend weights")
        for key in (lambda s: s.scene, lambda s: s.kind, lambda s: "all"):
            self._print(samples, key, held_out, final)
        spread = np.array(list(held_out.values()))
        for name, weight, lowest, highest in zip(FEATURES, final, spread.min(0), spread.max(0), strict=True):
            print(f"{name:20s} {weight:6.2f}, {lowest:.2f} to {highest:.2f} without one capture")

    def _samples(self) -> Iterator[Sample]:
        folders = [folder for root in self.roots for folder in find_scenes(root)]
        with ProcessPoolExecutor(self.workers, get_context("spawn")) as pool:
            for found in pool.map(samples_of, folders):
                yield from found

    @staticmethod
    def _print(
        samples: Sequence[Sample],
        key: Callable[[Sample], str],
        held_out: dict[str, Float64Array],
        final: Float64Array,
    ) -> None:
        groups = defaultdict(list)
        for sample in samples:
            scores = [sample.score(likely(sample.features, theta)) for theta in (held_out[sample.capture], final)]
            groups[key(sample)].append([sample.score(sample.selected), sample.score(sample.decided), *scores])
        for name, rows in sorted(groups.items()):
            before, today, held, learned = np.mean(rows, axis=0)
            losses = [sum(row[column] < row[0] - LOSS for row in rows) for column in (1, 2)]
            decisions = f"trimmer {today:.2f} ({losses[0]} lose), learned {held:.2f} ({losses[1]} lose)"
            print(f"{name:20s} {len(rows):4d} selections {before:.2f}: {decisions}, on its own captures {learned:.2f}")


if __name__ == "__main__":
    tyro.cli(Learn).run()
