"""Trims measured against ground truth: a trial is a selection to trim, a run is one trim of it and its scores."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from gaussian_trimmer.cameras import Camera, CameraSet, training_cameras
from gaussian_trimmer.evaluation.ground_truth import TestView
from gaussian_trimmer.evaluation.scoring import Cut, Judge, Scores, mean_scores
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.masks import DEFAULT_SEGMENTER, Segmenter
from gaussian_trimmer.rendering import render
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.result import RowLabel, TrimResult
from gaussian_trimmer.trimming.trim import trim

MeanOver = Literal["objects", "scenes", "scenes, by view"]
"""The units of a mean: objects, or scenes, whose own means are over objects or over all views of all objects."""
LOSS = 0.3
"""Points of foreground IoU; a trim that loses more has done harm."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A selection, and the ground truth of its object."""

    scene: str
    """Name of the scene."""
    object: str
    """Name of the object."""
    kind: str
    """Where the selection comes from."""
    gaussians: Gaussians
    """The scene, N Gaussians."""
    selection: BoolArray
    """The selection, (N,)."""
    before: Cut
    """The object as the selection has it."""
    views: Sequence[TestView]
    """Ground truth."""
    cameras: CameraSet | None
    """Training cameras, which the trimmer gets; the ground truth's are not among them."""
    up: tuple[float, float, float] | None = None
    """Up vector, which the trimmer gets."""


@dataclass(frozen=True)
class Variant:
    """One way of running the trimmer."""

    config: TrimConfig = field(default_factory=TrimConfig)
    segmenter: str | Segmenter = DEFAULT_SEGMENTER
    training_views: int = 0
    """If positive, trim with this many training cameras instead of virtual ones."""

    def trim(self, trial: Trial) -> TrimResult:
        """Trim in this way."""
        config = self.config if trial.up is None else replace(self.config, up=trial.up)
        return trim(
            trial.gaussians,
            trial.selection,
            config=config,
            segmenter=self.segmenter,
            cameras=trial.cameras,
            view_cameras=evenly_spread(trial.cameras, self.training_views) if self.training_views else None,
        )


@dataclass(frozen=True)
class Run:
    """One trim and its scores, means over the views."""

    scene: str
    object: str
    kind: str
    variant: str
    views: int
    """Number of views with ground truth."""
    before: Scores
    after: Scores
    """Empty if nothing is trimmed, since only masks are known."""
    seconds: float
    """Time that the trim took."""
    refused: str
    """Why nothing was trimmed; empty if something was."""
    counts: dict[str, int]
    """Gaussians by label."""

    def gain(self, metric: str = "iou") -> float:
        """Return the points of a metric that the trim gained."""
        return self.after[metric] - self.before[metric]

    def loses(self, metric: str = "iou") -> bool:
        """Return whether the trim did harm."""
        return self.gain(metric) < -LOSS


def measure(trial: Trial, variants: Mapping[str, Variant], judge: Judge, *, fidelity: bool = True) -> Iterator[Run]:
    """Trim a task in every way, and compare each result with ground truth.

    Args:
        trial: what is trimmed.
        variants: ways of trimming, by name.
        judge: the rules of the comparison.
        fidelity: also compare object and background together with the untouched scene.
    """
    before = mean_scores(judge.score_views(trial.before, trial.views))
    untouched = [render(trial.gaussians, view.camera).rgb for view in trial.views if fidelity]
    for name, variant in variants.items():
        start = time.perf_counter()
        result = variant.trim(trial)
        seconds = time.perf_counter() - start
        cut = Cut(result.object, result.background)
        scores = judge.score_views(cut, trial.views)
        for score, view, picture in zip(scores, trial.views, untouched, strict=False):
            score |= judge.fidelity(cut, view.camera, picture)
        counts = {label.name.lower(): result.count(label) for label in RowLabel}
        where = trial.scene, trial.object, trial.kind, name
        yield Run(*where, len(trial.views), before, mean_scores(scores), seconds, result.refused or "", counts)


def unit_scores(runs: Sequence[Run], over: MeanOver) -> dict[str, tuple[Scores, Scores]]:
    """Return the mean scores before and after of each object or scene, by its name."""
    units: dict[str, list[Run]] = {}
    for run in runs:
        name = f"{run.scene}/{run.object}" if over == "objects" else run.scene
        units.setdefault(name, []).extend([run] * (run.views if over == "scenes, by view" else 1))
    return {
        name: (mean_scores(r.before for r in own), mean_scores(r.after for r in own)) for name, own in units.items()
    }


def evenly_spread(cameras: CameraSet | None, n: int) -> list[Camera] | None:
    """Return n training cameras, evenly spread over the capture; None if there are none."""
    listed = training_cameras(cameras)
    return [listed[i * len(listed) // n] for i in range(n)] if listed else None
