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
    AcceptanceConfig,
    BoundaryConfig,
    EvidenceConfig,
    LabelCrfConfig,
    PlanConfig,
    SplitConfig,
    TrimConfig,
    check_config,
    paper_config,
)
from gaussian_trimmer.decomposition.contact import split_at_support_plane
from gaussian_trimmer.decomposition.evidence import classify_gaussians, find_halo
from gaussian_trimmer.decomposition.split_rules import SPLIT_RULES
from gaussian_trimmer.decomposition.straddlers import find_straddlers
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.support_plane import SupportPlane, find_support_plane
from gaussian_trimmer.planning.coverage import limit_yaw_to_observed
from gaussian_trimmer.planning.up_vector import UpVector, find_up
from gaussian_trimmer.planning.virtual_cameras import plan_cameras
from gaussian_trimmer.rendering import Renderer, get_renderer
from gaussian_trimmer.result import KEPT, PRUNED, RECOVERED, SPLIT_INSIDE, SPLIT_OUTSIDE, TrimResult
from gaussian_trimmer.segmentation.acceptance import check_masks, excessive_loss, rejection
from gaussian_trimmer.segmentation.label_crf import correct_labels
from gaussian_trimmer.segmentation.segmenters import Segmenter, get_segmenter
from gaussian_trimmer.segmentation.view_rendering import complete_views, visible_weight
from gaussian_trimmer.views import TrimmedView

__all__ = [
    "KEPT", "PRUNED", "RECOVERED", "SPLIT_INSIDE", "SPLIT_OUTSIDE", "AcceptanceConfig", "BoundaryConfig",
    "EvidenceConfig", "LabelCrfConfig", "PlanConfig", "SplitConfig", "TrimConfig", "TrimResult", "TrimmedView",
    "paper_config", "trim",
]  # fmt: skip

_MIN_REACH = 1.8
_IN_FRONT = 0.1
"""Depth difference, in object radii, from which something in the scene hides the object rather than touches it."""
Progress = Callable[[str], None]


def trim(
    scene: Gaussians,
    selection: BoolArray,
    config: TrimConfig | None = None,
    renderer: Renderer | str = "numba",
    segmenter: Segmenter | str = "silhouette",
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
        InputError: the selection has the wrong length or is empty, or a setting is out of its range.
    """
    config = config or TrimConfig()
    check_config(config)
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
        probability = correct_labels(scope.local, scope.coarse, visible, scope.bounds, config.label_crf)
    with clock("render"):
        segmented = complete_views(pictures, scope.local, scope.coarse, probability, scope.cameras, renderer)
    with clock("segment"):
        checked = check_masks(segmented, segmenter.segment(segmented), config.acceptance)
    refused, decomposition = rejection(checked, config.acceptance), None
    if not refused:
        decomposition = _classify(
            scope, probability, [view for view in checked if not view.rejected], renderer, config, clock
        )
        refused = excessive_loss(scope.coarse, decomposition.keep, visible, config.acceptance)
    with clock("assemble"):
        rows = _assemble(scene, selection, scope.rows, None if refused else decomposition)
    floaters = int(selection.sum() - scope.coarse.sum())
    return TrimResult(
        scene, *rows, scope.up, scope.bounds, tuple(checked), floaters, refused, clock.seconds, renderer.name,
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
class _Decomposition:
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
    training_cameras = [camera for camera, train in listed if train]
    planned, bounds = plan_cameras(scene.select(selection), up.direction, config.plan, training_cameras)
    rows, coarse = _surroundings(scene, selection, bounds, config.context_radius)
    local = scene.select(rows)
    if views:
        planned = list(views)
    elif not training_cameras:
        plan = limit_yaw_to_observed(local, coarse, up.direction, config.plan, renderer)
        if plan is not config.plan:
            planned, bounds = plan_cameras(local.select(coarse), up.direction, plan)
    return _Scope(up, bounds, planned, rows, local, coarse)


def _surroundings(scene: Gaussians, selection: BoolArray, bounds: Bounds, reach: float) -> tuple[IntArray, BoolArray]:
    """Rows of the object and its neighbours, eq. 7, and which of them are the object: far floaters are neither."""
    offset = scene.means - bounds.centre.astype(np.float32)
    squared = np.einsum("ni,ni->n", offset, offset)
    core = selection & (squared < (max(reach, _MIN_REACH) * bounds.radius) ** 2)
    if not core.any():
        core = selection
    rows = np.flatnonzero(core | (~selection & (squared < (reach * bounds.radius) ** 2)))
    return rows, core[rows]


def _classify(
    scope: _Scope, probability: FloatArray, accepted: Sequence[TrimmedView], renderer: Renderer, config: TrimConfig,
    clock: _Clock,
) -> _Decomposition:  # fmt: skip
    """Evidence in the whole picture, evidence of the object alone, and cuts."""
    with clock("weigh"):
        outside, inside = np.sum(_weigh(scope.local, accepted, renderer), axis=0).T
        keep = classify_gaussians(inside, outside, probability, scope.coarse, config.evidence)
    rows = np.flatnonzero(keep)
    with clock("prune"):
        isolated = scope.local.select(rows)
        weights = _weigh_isolated(isolated, accepted, scope.bounds.radius, renderer) if len(rows) else []
        if config.evidence.second_evidence and len(rows):
            support = _find_support_plane(scope, keep, inside + outside, config)
            free = support.above[rows] if support else np.zeros(len(rows), np.bool_)
            halo = find_halo(np.sum(weights, axis=0), inside[rows], outside[rows], free, config.evidence)
            keep[rows[halo]] = False
    if not keep.any():
        return _Decomposition(keep, np.zeros(0, np.int64), None, None)
    with clock("split"):
        cut, inner, outer = _split(isolated, keep[rows], accepted, weights, renderer, config)
        decomposition = _Decomposition(keep, rows[cut], inner, outer)
        if config.split.rule != "none" and config.split.at_support_plane.enabled and config.evidence.recover:
            decomposition = _split_at_support_plane(scope, decomposition, inside + outside, accepted, renderer, config)
    return decomposition


def _weigh(part: Gaussians, accepted: Sequence[TrimmedView], renderer: Renderer) -> list[FloatArray]:
    """Blend weights outside and inside the mask, (N, 2) for each view."""
    return [renderer.blend_weights(part, v.view.camera, v.mask.astype(np.uint8), 2) for v in accepted]


def _find_support_plane(scope: _Scope, keep: BoolArray, seen: FloatArray, config: TrimConfig) -> SupportPlane | None:
    """The surface that the object stands on, if there is one."""
    positions = scope.local.means / np.float32(scope.bounds.radius)
    return find_support_plane(positions, keep, seen.astype(np.float64), scope.bounds, config.label_crf.support_plane)


def _split_at_support_plane(
    scope: _Scope, decomposition: _Decomposition, seen: FloatArray, accepted: Sequence[TrimmedView], renderer: Renderer,
    config: TrimConfig,
) -> _Decomposition:  # fmt: skip
    """The verdict, with hidden Gaussians that cross the surface below the object cut there."""
    support = _find_support_plane(scope, decomposition.keep, seen, config)
    if support is None:
        return decomposition
    cameras, masks = [v.view.camera for v in accepted], [v.mask for v in accepted]
    rows, inner, outer = split_at_support_plane(
        scope.local,
        decomposition.keep,
        seen,
        support,
        scope.bounds,
        cameras,
        masks,
        renderer,
        config.split.at_support_plane,
    )
    keep = decomposition.keep.copy()
    keep[rows] = True
    # These come first, since they have outer parts under every rule.
    return _Decomposition(
        keep,
        np.concatenate([rows, decomposition.split]),
        _joined(inner, decomposition.inner),
        _joined(outer, decomposition.outer),
    )


def _joined(first: Gaussians, second: Gaussians | None) -> Gaussians:
    return first if second is None else concatenate([first, second])


def _weigh_isolated(
    isolated: Gaussians, accepted: Sequence[TrimmedView], radius: float, renderer: Renderer
) -> list[FloatArray]:
    """Blend weights of the object alone: outside the mask, inside, outside but hidden in the scene, (N, 3) a view."""
    weights = []
    for shown in accepted:
        camera, nearest_depth = shown.view.camera, shown.view.depth
        depth = renderer.render(isolated, camera).depth
        occluded = (nearest_depth > 0) & (nearest_depth < depth - _IN_FRONT * radius)
        labels = np.where(shown.mask, np.uint8(1), np.where(occluded, np.uint8(2), np.uint8(0)))
        weights.append(renderer.blend_weights(isolated, camera, labels, 3))
    return weights


def _split(
    isolated: Gaussians, keep: BoolArray, accepted: Sequence[TrimmedView], weights: Sequence[FloatArray],
    renderer: Renderer, config: TrimConfig,
) -> tuple[IntArray, Gaussians | None, Gaussians | None]:  # fmt: skip
    """Rows of Gaussians that straddle the boundary when the object is alone, and their inner and outer parts."""
    if config.split.rule == "none":
        return np.zeros(0, np.int64), None, None
    cameras, masks = [v.view.camera for v in accepted], [v.mask for v in accepted]
    sides = [weight[:, :2] for weight in weights]
    found = find_straddlers(isolated, cameras, masks, sides, renderer, config.boundary)
    ours = keep[found.rows]
    rows = found.rows[ours]
    return rows, *SPLIT_RULES[config.split.rule](isolated.select(rows), found.normals[ours], found.offsets[ours])


def _assemble(
    scene: Gaussians, selection: BoolArray, rows: IntArray, decomposition: _Decomposition | None
) -> tuple[Gaussians, Gaussians, IntArray, NDArray[np.uint8]]:
    """Object, outer parts, and source row and label of every output row; the selection unchanged without a verdict."""
    final = selection.copy() if decomposition is None else np.zeros(len(scene), np.bool_)
    nothing = scene.select(np.zeros(0, np.int64))
    split, inner, outer = np.zeros(0, np.int64), nothing, nothing
    if decomposition is not None:
        final[rows] = decomposition.keep
        split, inner, outer = rows[decomposition.split], decomposition.inner or nothing, decomposition.outer or nothing
    whole = final.copy()
    whole[split] = False
    inside, outside = np.flatnonzero(whole), np.flatnonzero(~final)
    source = np.concatenate([inside, split, outside, split[: len(outer)]])
    label = np.concatenate([
        np.where(selection[inside], KEPT, RECOVERED), np.full(len(split), SPLIT_INSIDE),
        np.where(selection[outside], PRUNED, KEPT), np.full(len(outer), SPLIT_OUTSIDE),
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
