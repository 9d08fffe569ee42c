"""Trims measured against ground truth: a task is a selection to trim, a run is one trim of it and its scores."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gaussian_trimmer.cameras import Camera, CameraSet, training_cameras
from gaussian_trimmer.evaluation.ground_truth import TestView
from gaussian_trimmer.evaluation.scoring import Cut, Judge, Scores, Shown, mean_scores
from gaussian_trimmer.evaluation.variants import Variant
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.result import RowLabel, TrimResult
from gaussian_trimmer.trimming.trim import trim

LOSS = 0.3
"""Points of foreground IoU; a trim that loses more has done harm."""


@dataclass(frozen=True, eq=False)
class Task:
    """A rough selection, and the ground truth of its object."""

    scene: str
    """Name of the scene."""
    object: str
    """Name of the object."""
    kind: str
    """Where the selection comes from."""
    gaussians: Gaussians
    """The scene, N Gaussians."""
    selection: BoolArray
    """The rough selection, (N,)."""
    before: Cut
    """What the selection looks like before it is trimmed."""
    views: Sequence[TestView]
    """Ground truth."""
    cameras: CameraSet | None
    """Training cameras, which the trimmer gets; ground truth is no part of them."""
    up: tuple[float, float, float] | None = None
    """Up vector, which the trimmer gets."""


@dataclass(frozen=True)
class ViewScores:
    """The scores of one view."""

    view: str
    before: Scores
    after: Scores


@dataclass(frozen=True)
class Run:
    """One trim and its scores."""

    scene: str
    object: str
    kind: str
    variant: str
    occlusion: str
    """Whether the object was rendered alone or in its scene."""
    before: Scores
    after: Scores
    fidelity: float
    """Of object and background together, dB; NaN if it was not measured."""
    seconds: float
    """Time that the trim took."""
    refused: str
    counts: dict[str, int]
    views: tuple[ViewScores, ...] = field(repr=False, default=())

    @property
    def iou_change(self) -> float:
        """Points of foreground IoU that the trim gained."""
        return self.after["iou"] - self.before["iou"]

    @property
    def loses(self) -> bool:
        """Whether the trim did harm."""
        return self.iou_change < -LOSS

    def as_dict(self) -> dict[str, Any]:
        """The run as JSON holds it."""
        fidelity = None if np.isnan(self.fidelity) else self.fidelity
        return {**self.__dict__, "fidelity": fidelity, "views": [dict(view.__dict__) for view in self.views]}


ShowRun = Callable[[Run, Sequence[TestView], Sequence[Shown], Sequence[Shown]], None]
"""Is given a run, its views, and what they show before and after."""


def measure(
    task: Task, variants: Mapping[str, Variant], judges: Sequence[Judge], *, fidelity: bool = True,
    show: ShowRun | None = None,
) -> Iterator[Run]:  # fmt: skip
    """Trim a task in every way, and compare each with ground truth under the rules of every judge.

    Args:
        fidelity: also compare object and background together with the untouched scene.
        show: called with every run, for pictures.
    """
    first, views = judges[0], task.views
    before = [[judge.show(task.before, view.camera) for view in views] for judge in judges]
    whole, alone = Cut(task.gaussians, task.gaussians.select(slice(0, 0))), replace(first, occlusion="alone")
    untouched = [alone.show(whole, view.camera).rgb for view in views] if fidelity else []
    for name, variant in variants.items():
        start = time.perf_counter()
        result = run_variant(task, variant, first.renderer)
        seconds = time.perf_counter() - start
        cut = Cut(result.object, result.background)
        kept = [first.fidelity(cut, view.camera, u) for view, u in zip(views, untouched, strict=False)]
        for judge, shown_before in zip(judges, before, strict=True):
            shown = [judge.show(cut, view.camera) for view in views]
            run = _run_of(task, name, judge, shown_before, shown, kept, result, seconds)
            if show is not None:
                show(run, views, shown_before, shown)
            yield run


def _run_of(
    task: Task, variant: str, judge: Judge, before: Sequence[Shown], after: Sequence[Shown], fidelity: Sequence[Scores],
    result: TrimResult, seconds: float,
) -> Run:  # fmt: skip
    scored_before = [judge.score(shown, view) for shown, view in zip(before, task.views, strict=True)]
    scored = [judge.score(shown, view) for shown, view in zip(after, task.views, strict=True)]
    if fidelity:
        scored = [scores | more for scores, more in zip(scored, fidelity, strict=True)]
    rows = zip(task.views, scored_before, scored, strict=True)
    mean = mean_scores(scored)
    return Run(
        task.scene, task.object, task.kind, variant, judge.occlusion, mean_scores(scored_before), mean,
        mean.pop("fidelity", float("nan")), seconds, result.refused or "",
        {label.name.lower(): result.count(label) for label in RowLabel},
        tuple(ViewScores(view.camera.name, then, now) for view, then, now in rows),
    )  # fmt: skip


def run_variant(task: Task, variant: Variant, renderer: Renderer) -> TrimResult:
    """Trim a task in one way."""
    config = variant.config if task.up is None else replace(variant.config, up=task.up)
    views = training_views(task.cameras, variant.training_views) if variant.training_views else None
    return trim(
        task.gaussians, task.selection, config=config, renderer=renderer, segmenter=variant.segmenter,
        cameras=task.cameras, view_cameras=views,
    )  # fmt: skip


def training_views(cameras: CameraSet | None, n: int) -> list[Camera] | None:
    """N training cameras, evenly spread over the capture; None if there are none."""
    listed = training_cameras(cameras)
    return [listed[i * len(listed) // n] for i in range(n)] if listed else None
