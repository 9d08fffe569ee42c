"""The trimmer: plan cameras, render, segment, judge, split."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.config import (
    AcceptConfig,
    BoundaryConfig,
    EvidenceConfig,
    LabelFieldConfig,
    PlanConfig,
    SplitConfig,
    TrimConfig,
    check_config,
    paper_config,
)
from gaussian_trimmer.decomposition.contact import cut_sunken
from gaussian_trimmer.decomposition.evidence import judge, shows_outside
from gaussian_trimmer.decomposition.split_rules import SPLIT_RULES
from gaussian_trimmer.decomposition.straddlers import find_straddlers
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.support_plane import Support, find_support
from gaussian_trimmer.planning.coverage import restrict_to_seen
from gaussian_trimmer.planning.up_vector import UpVector, find_up
from gaussian_trimmer.planning.virtual_cameras import plan_cameras
from gaussian_trimmer.rendering import Renderer, get_renderer
from gaussian_trimmer.result import KEPT, PRUNED, RECOVERED, SPLIT_INSIDE, SPLIT_OUTSIDE, TrimResult
from gaussian_trimmer.scene_limits import check_magnitudes
from gaussian_trimmer.segmentation.acceptance import accept, harm, refusal
from gaussian_trimmer.segmentation.label_crf import correct_labels
from gaussian_trimmer.segmentation.segmenters import Segmenter, get_segmenter
from gaussian_trimmer.segmentation.view_rendering import complete_views, visible_weight
from gaussian_trimmer.views import TrimmedView

__all__ = [
    "KEPT", "PRUNED", "RECOVERED", "SPLIT_INSIDE", "SPLIT_OUTSIDE", "AcceptConfig", "BoundaryConfig", "EvidenceConfig",
    "LabelFieldConfig", "PlanConfig", "SplitConfig", "TrimConfig", "TrimResult", "TrimmedView", "paper_config", "trim",
]  # fmt: skip

_LEAST_REACH = 1.8
_IN_FRONT = 0.1
"""Depth difference, in object radii, from which something in the scene hides the object rather than touches it."""
Progress = Callable[[str], None]


def trim(
    scene: Gaussians,
    selection: BoolArray,
    config: TrimConfig | None = None,
    renderer: Renderer | str = "numba",
    segmenter: Segmenter | str = "label-field",
    cameras: CameraSet | None = None,
    views: Sequence[Camera] | None = None,
    progress: Progress = lambda stage: None,
) -> TrimResult:
    """Sharpen a rough selection of one object.

    Args:
        scene: all Gaussians; the object alone works too, without background augmentation.
        selection: the coarse object, (N,) bool.
        config: settings of all stages.
        renderer: a renderer, or the name of one.
        segmenter: a segmenter, or the name of one.
        cameras: the cameras that the scene was trained with, if known: they give the up vector and the span of
            angles from which the object was really seen.
        views: cameras to look from instead of planned ones: the "no virtual cameras" ablation, or those of given masks.
        progress: called with a stage's name when it begins.

    Raises:
        InputError: the selection has the wrong length or is empty, a setting is out of its range, or the scene holds
            numbers with which nothing can be computed.
    """
    config = config or TrimConfig()
    check_config(config)
    check_magnitudes(scene)
    selection = _checked(selection, len(scene))
    renderer = get_renderer(renderer) if isinstance(renderer, str) else renderer
    segmenter = get_segmenter(segmenter) if isinstance(segmenter, str) else segmenter
    clock = _Clock(progress)
    with clock("plan"):
        scope = _plan(scene, selection, config, renderer, cameras, views)
    with clock("render"):
        pictures = [renderer.render(scope.local, camera, weights=True) for camera in scope.cameras]
        visible = visible_weight([picture.weights for picture in pictures], scope.cameras)
    with clock("correct"):
        probability = correct_labels(scope.local, scope.coarse, visible, scope.bounds, config.labels)
    with clock("render"):
        looks = complete_views(pictures, scope.local, scope.coarse, probability, scope.cameras, renderer)
    with clock("segment"):
        judged = accept(looks, segmenter.segment(looks), config.accept)
    refused, verdict = refusal(judged, config.accept), None
    if not refused:
        verdict = _judge(scope, probability, [view for view in judged if not view.rejected], renderer, config, clock)
        refused = harm(scope.coarse, verdict.keep, visible, config.accept)
    with clock("assemble"):
        rows = _assemble(scene, selection, scope.rows, None if refused else verdict)
    floaters = int(selection.sum() - scope.coarse.sum())
    return TrimResult(
        scene, *rows, scope.up, scope.bounds, tuple(judged), floaters, refused, clock.seconds, renderer.name,
        segmenter.name,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Scope:
    """The part of the scene that is looked at, and from where."""

    up: UpVector
    bounds: Bounds
    cameras: list[Camera]
    rows: IntArray
    """Scene rows of the object and its neighbours, ascending, (L,)."""
    local: Gaussians
    """Those Gaussians."""
    coarse: BoolArray
    """Which of them the selection holds, far floaters left out, (L,)."""


@dataclass(frozen=True, eq=False)
class _Verdict:
    """What the views say of the Gaussians of a scope."""

    keep: BoolArray
    """Object or not, (L,)."""
    split: IntArray
    """Object rows of the scope that are cut in two, (S,)."""
    inner: Gaussians | None
    outer: Gaussians | None


def _checked(selection: BoolArray, n: int) -> BoolArray:
    selection = np.asarray(selection)
    if selection.dtype != np.bool_ or selection.shape != (n,):
        raise InputError(
            f"The selection has shape {selection.shape} and type {selection.dtype}; {n} booleans are needed."
        )
    if not selection.any():
        raise InputError("The selection is empty: no Gaussian of the scene belongs to the object.")
    return selection


def _plan(
    scene: Gaussians, selection: BoolArray, config: TrimConfig, renderer: Renderer, cameras: CameraSet | None,
    views: Sequence[Camera] | None,
) -> _Scope:  # fmt: skip
    """Up vector, cameras, and the object with its neighbours."""
    up = find_up(scene, cameras, config.up, selection)
    listed = zip(cameras.cameras, cameras.train, strict=True) if cameras else ()
    seen_from = [camera for camera, train in listed if train]
    planned, bounds = plan_cameras(scene.select(selection), up.direction, config.plan, seen_from)
    rows, coarse = _surroundings(scene, selection, bounds, config.neighbours)
    local = scene.select(rows)
    if views:
        planned = list(views)
    elif not seen_from:
        plan = restrict_to_seen(local, coarse, up.direction, config.plan, renderer)
        if plan is not config.plan:
            planned, bounds = plan_cameras(local.select(coarse), up.direction, plan)
    return _Scope(up, bounds, planned, rows, local, coarse)


def _surroundings(scene: Gaussians, selection: BoolArray, bounds: Bounds, reach: float) -> tuple[IntArray, BoolArray]:
    """Rows of the object and its neighbours, eq. 7, and which of them are the object: far floaters are neither."""
    offset = scene.means - bounds.centre.astype(np.float32)
    squared = np.einsum("ni,ni->n", offset, offset)
    core = selection & (squared < (max(reach, _LEAST_REACH) * bounds.radius) ** 2)
    if not core.any():
        core = selection
    rows = np.flatnonzero(core | (~selection & (squared < (reach * bounds.radius) ** 2)))
    return rows, core[rows]


def _judge(
    scope: _Scope, probability: FloatArray, accepted: Sequence[TrimmedView], renderer: Renderer, config: TrimConfig,
    clock: _Clock,
) -> _Verdict:  # fmt: skip
    """Evidence in the whole picture, evidence of the object alone, and cuts."""
    with clock("weigh"):
        outside, inside = np.sum(_weigh(scope.local, accepted, renderer), axis=0).T
        keep = judge(inside, outside, probability, scope.coarse, config.evidence)
    rows = np.flatnonzero(keep)
    with clock("prune"):
        alone = scope.local.select(rows)
        weights = _weigh_alone(alone, accepted, scope.bounds.radius, renderer) if len(rows) else []
        if config.evidence.second_evidence and len(rows):
            support = _support(scope, keep, inside + outside, config)
            free = support.above[rows] if support else np.zeros(len(rows), np.bool_)
            halo = shows_outside(np.sum(weights, axis=0), inside[rows], outside[rows], free, config.evidence)
            keep[rows[halo]] = False
    if not keep.any():
        return _Verdict(keep, np.zeros(0, np.int64), None, None)
    with clock("split"):
        cut, inner, outer = _split(alone, keep[rows], accepted, weights, renderer, config)
        verdict = _Verdict(keep, rows[cut], inner, outer)
        if config.split.rule != "none" and config.split.contact.enabled and config.evidence.recover:
            verdict = _cut_sunken(scope, verdict, inside + outside, accepted, renderer, config)
    return verdict


def _weigh(part: Gaussians, accepted: Sequence[TrimmedView], renderer: Renderer) -> list[FloatArray]:
    """Blend weights outside and inside the mask, (N, 2) for each view."""
    return [renderer.blend_weights(part, v.view.camera, v.mask.astype(np.uint8), 2) for v in accepted]


def _support(scope: _Scope, keep: BoolArray, seen: FloatArray, config: TrimConfig) -> Support | None:
    """The surface that the object stands on, if there is one."""
    places = scope.local.means / np.float32(scope.bounds.radius)
    return find_support(places, keep, seen.astype(np.float64), scope.bounds, config.labels.support)


def _cut_sunken(
    scope: _Scope, verdict: _Verdict, seen: FloatArray, accepted: Sequence[TrimmedView], renderer: Renderer,
    config: TrimConfig,
) -> _Verdict:  # fmt: skip
    """The verdict, with hidden Gaussians that cross the surface below the object cut there."""
    support = _support(scope, verdict.keep, seen, config)
    if support is None:
        return verdict
    cameras, masks = [v.view.camera for v in accepted], [v.mask for v in accepted]
    rows, inner, outer = cut_sunken(
        scope.local, verdict.keep, seen, support, scope.bounds, cameras, masks, renderer, config.split.contact
    )
    keep = verdict.keep.copy()
    keep[rows] = True
    # These come first, since they have outer parts under every rule.
    return _Verdict(
        keep, np.concatenate([rows, verdict.split]), _joined(inner, verdict.inner), _joined(outer, verdict.outer)
    )


def _joined(first: Gaussians, second: Gaussians | None) -> Gaussians:
    return first if second is None else concatenate([first, second])


def _weigh_alone(
    alone: Gaussians, accepted: Sequence[TrimmedView], radius: float, renderer: Renderer
) -> list[FloatArray]:
    """Blend weights of the object alone: outside the mask, inside, outside but hidden in the scene, (N, 3) a view."""
    weights = []
    for shown in accepted:
        camera, nearest_depth = shown.view.camera, shown.view.depth
        depth = renderer.render(alone, camera).depth
        occluded = (nearest_depth > 0) & (nearest_depth < depth - _IN_FRONT * radius)
        labels = np.where(shown.mask, np.uint8(1), np.where(occluded, np.uint8(2), np.uint8(0)))
        weights.append(renderer.blend_weights(alone, camera, labels, 3))
    return weights


def _split(
    alone: Gaussians, keep: BoolArray, accepted: Sequence[TrimmedView], weights: Sequence[FloatArray],
    renderer: Renderer, config: TrimConfig,
) -> tuple[IntArray, Gaussians | None, Gaussians | None]:  # fmt: skip
    """Rows of Gaussians that straddle the boundary when the object is alone, and their inner and outer parts."""
    if config.split.rule == "none":
        return np.zeros(0, np.int64), None, None
    cameras, masks = [v.view.camera for v in accepted], [v.mask for v in accepted]
    sides = [weight[:, :2] for weight in weights]
    found = find_straddlers(alone, cameras, masks, sides, renderer, config.boundary)
    ours = keep[found.rows]
    rows = found.rows[ours]
    return rows, *SPLIT_RULES[config.split.rule](alone.select(rows), found.normals[ours], found.offsets[ours])


def _assemble(
    scene: Gaussians, selection: BoolArray, rows: IntArray, verdict: _Verdict | None
) -> tuple[Gaussians, Gaussians, IntArray, NDArray[np.uint8]]:
    """Object, outer parts, and source row and label of every output row; the selection unchanged without a verdict."""
    final = selection.copy() if verdict is None else np.zeros(len(scene), np.bool_)
    nothing = scene.select(np.zeros(0, np.int64))
    split, inner, outer = np.zeros(0, np.int64), nothing, nothing
    if verdict is not None:
        final[rows] = verdict.keep
        split, inner, outer = rows[verdict.split], verdict.inner or nothing, verdict.outer or nothing
    whole = final.copy()
    whole[split] = False
    inside, beside = np.flatnonzero(whole), np.flatnonzero(~final)
    source = np.concatenate([inside, split, beside, split[: len(outer)]])
    label = np.concatenate([
        np.where(selection[inside], KEPT, RECOVERED), np.full(len(split), SPLIT_INSIDE),
        np.where(selection[beside], PRUNED, KEPT), np.full(len(outer), SPLIT_OUTSIDE),
    ]).astype(np.uint8)  # fmt: skip
    return concatenate([scene.select(inside), inner]), outer, source, label


class _Clock:
    """Adds up the time of stages, which may come back, and announces them."""

    def __init__(self, progress: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self._progress = progress

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        self._progress(stage)
        start = time.perf_counter()
        yield
        self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start
