"""The trimmer: plan cameras, render, segment, judge, split."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.boundary import BoundaryConfig, find_straddlers
from gaussian_trimmer.camera_files import CameraSet
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.decomposition import SPLIT_RULES
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evidence import EvidenceConfig, judge, shows_outside
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.label_field import LabelFieldConfig, correct_labels
from gaussian_trimmer.orientation import UpVector, find_up
from gaussian_trimmer.planning import Bounds, PlanConfig, neighbours, plan_cameras
from gaussian_trimmer.rendering import Renderer, get_renderer
from gaussian_trimmer.segmenters import Box, Segmenter, View, get_segmenter
from gaussian_trimmer.visibility import restrict_to_seen

KEPT, PRUNED, RECOVERED, SPLIT_INSIDE, SPLIT_OUTSIDE = range(5)
"""Labels of output rows: unchanged side, taken from the object, added to it, and the two parts of a split Gaussian."""

_REFERENCE_PIXELS = 5 * 512 * 512
Progress = Callable[[str], None]


@dataclass(frozen=True)
class SplitConfig:
    """What is done to Gaussians that straddle the boundary."""

    rule: Literal["plane", "principal_axis", "sagd", "none"] = "plane"
    """`plane`: cut at the silhouette; `principal_axis`: the paper's eqs. 8-9; `sagd`: one shrunken child; `none`."""


@dataclass(frozen=True)
class AcceptConfig:
    """When a view's mask is believed, and when the whole trim is."""

    least_overlap: float = 0.6
    """Smallest intersection over union of a mask with the silhouette that the corrected labels expect."""
    least_silhouette: int = 64
    """Smallest expected silhouette in pixels; less of the object cannot be judged."""
    least_views: float = 0.4
    """Smallest share of views that must be accepted for the trim to stand."""


@dataclass(frozen=True)
class TrimConfig:
    """Every setting of the trimmer, by stage."""

    up: tuple[float, float, float] | None = None
    """Up vector of the scene; not given: found from the cameras, else from the ground plane."""
    plan: PlanConfig = field(default_factory=PlanConfig)
    neighbours: float = 1.8
    """Non-object Gaussians within this many object radii surround the object in the views (eq. 7); 0: none."""
    labels: LabelFieldConfig = field(default_factory=LabelFieldConfig)
    accept: AcceptConfig = field(default_factory=AcceptConfig)
    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)
    boundary: BoundaryConfig = field(default_factory=BoundaryConfig)
    split: SplitConfig = field(default_factory=SplitConfig)


def paper_config(config: TrimConfig | None = None) -> TrimConfig:
    """The paper's choices: its framing, no correction in 3D, masks alone as evidence, splits along principal axes."""
    config = config or TrimConfig()
    return replace(
        config,
        plan=replace(config.plan, framing="paper"),
        labels=replace(config.labels, enabled=False),
        evidence=replace(config.evidence, prior=0.0, recover=False, second_evidence=False),
        split=SplitConfig("principal_axis"),
    )


@dataclass(frozen=True, eq=False)
class TrimmedView:
    """A virtual view and what was made of it."""

    view: View
    mask: BoolArray
    """The segmenter's mask, (H, W)."""
    rejected: str
    """Why the mask was not believed; empty if it was."""


@dataclass(frozen=True, eq=False)
class TrimResult:
    """The object, the scene without it, and how they came about."""

    scene: Gaussians
    object: Gaussians
    """The trimmed object."""
    outside_parts: Gaussians
    """Outer parts of split Gaussians."""
    source_index: IntArray
    """Scene row of every row of the object, then of every row of the background."""
    label: NDArray[np.uint8]
    """KEPT, PRUNED, RECOVERED, SPLIT_INSIDE or SPLIT_OUTSIDE, for the same rows."""
    up: UpVector
    bounds: Bounds
    views: tuple[TrimmedView, ...]
    floaters: int
    """Selected Gaussians too far from the object's bounds to belong to it."""
    refused: str
    """Why the coarse selection was returned unchanged; empty if it was trimmed."""
    seconds: dict[str, float]
    """Time taken by each stage."""
    renderer: str
    segmenter: str

    @cached_property
    def background(self) -> Gaussians:
        """The scene without the object: every other Gaussian, then the outer parts of split ones."""
        whole = self.source_index[len(self.object) : len(self.source_index) - len(self.outside_parts)]
        return concatenate([self.scene.select(whole), self.outside_parts])

    def count(self, label: int) -> int:
        """Number of output rows with a label."""
        return int(np.count_nonzero(self.label == label))


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
        InputError: the selection has the wrong length or is empty, or the up vector is zero.
    """
    config = config or TrimConfig()
    _check(config)
    renderer = get_renderer(renderer) if isinstance(renderer, str) else renderer
    segmenter = get_segmenter(segmenter) if isinstance(segmenter, str) else segmenter
    selection = _checked(selection, len(scene))
    clock = _Clock(progress)
    with clock("plan"):
        up = find_up(scene, cameras, config.up, selection)
        seen_from = (
            [camera for camera, train in zip(cameras.cameras, cameras.train, strict=True) if train] if cameras else []
        )
        planned, bounds = plan_cameras(scene.select(selection), up.direction, config.plan, seen_from)
        core, rows = _surroundings(scene, selection, bounds, config.neighbours)
        local, coarse = scene.select(rows), core[rows]
        if views:
            planned = list(views)
        elif not seen_from:
            plan = restrict_to_seen(local, coarse, up.direction, config.plan, renderer)
            if plan is not config.plan:
                planned, bounds = plan_cameras(local.select(coarse), up.direction, plan)
    with clock("render"):
        visible = _visible_weight(local, planned, renderer)
    with clock("correct"):
        probability = correct_labels(local, coarse, visible, bounds, config.labels)
    with clock("render"):
        pictures = _render_views(local, coarse, probability, planned, renderer)
    with clock("segment"):
        judged = _accept(pictures, segmenter.segment(pictures), config.accept)
    accepted = [view for view in judged if not view.rejected]
    refused = _refusal(judged, accepted, config.accept)
    keep, parts = coarse, None
    if refused:
        keep = selection[rows]
    else:
        with clock("weigh"):
            weights = _weigh(local, accepted, renderer)
            inside, outside = np.sum([w[:, 1] for w in weights], axis=0), np.sum([w[:, 0] for w in weights], axis=0)
            keep = judge(inside, outside, probability, coarse, config.evidence)
        with clock("prune"):
            if config.evidence.second_evidence and keep.any():
                keep = keep & ~_halo(local, keep, accepted, inside, inside + outside, renderer, config.evidence)
        with clock("split"):
            parts = _split(local, keep, accepted, renderer, config)
        if not keep.any():
            refused, keep, parts = "no Gaussian was left in the object", selection[rows], None
    with clock("assemble"):
        final = selection.copy() if refused else np.zeros(len(scene), np.bool_)
        final[rows] = keep
        return TrimResult(
            scene, *_assemble(scene, selection, final, rows, parts), up, bounds, tuple(judged),
            int(selection.sum() - core.sum()), refused, clock.seconds, renderer.name, segmenter.name,
        )  # fmt: skip


def _check(config: TrimConfig) -> None:
    if config.split.rule not in (*SPLIT_RULES, "none"):
        raise InputError(f"Unknown rule of splitting '{config.split.rule}'; available: {', '.join(SPLIT_RULES)}, none.")
    if config.labels.passes < 1:
        raise InputError("Labels are corrected in at least one pass; use --labels.no-enabled to leave them.")


def _checked(selection: BoolArray, n: int) -> BoolArray:
    selection = np.asarray(selection)
    if selection.dtype != np.bool_ or selection.shape != (n,):
        raise InputError(
            f"The selection has shape {selection.shape} and type {selection.dtype}; {n} booleans are needed."
        )
    if not selection.any():
        raise InputError("The selection is empty: no Gaussian of the scene belongs to the object.")
    return selection


def _surroundings(scene: Gaussians, selection: BoolArray, bounds: Bounds, reach: float) -> tuple[BoolArray, IntArray]:
    """The selection without far floaters (N,), and the rows of it and its neighbours, ascending."""
    offset = scene.means - bounds.centre.astype(np.float32)
    near = np.einsum("ni,ni->n", offset, offset) < (max(reach, 1.8) * bounds.radius) ** 2
    core = selection & near
    if not core.any():
        core = selection
    rows = np.flatnonzero(core)
    if reach > 0:
        rows = np.sort(np.concatenate([rows, neighbours(scene, selection, bounds, reach)]))
    return core, rows


def _visible_weight(local: Gaussians, cameras: Sequence[Camera], renderer: Renderer) -> FloatArray:
    """Blend weight of each Gaussian over all views, in pixels of five views of 512 x 512, (N,)."""
    total = np.zeros(len(local), np.float32)
    for camera in cameras:
        total += renderer.blend_weights(local, camera, np.zeros((camera.height, camera.width), np.uint8), 1)[:, 0]
    pixels = sum(camera.height * camera.width for camera in cameras)
    return total * np.float32(_REFERENCE_PIXELS / pixels)


def _render_views(
    local: Gaussians, coarse: BoolArray, probability: FloatArray, cameras: Sequence[Camera], renderer: Renderer
) -> list[View]:
    alone = local.select(coarse)
    values = np.stack([coarse.astype(np.float32), probability], axis=1)
    views = []
    for camera in cameras:
        picture = renderer.render(local, camera)
        shares = renderer.blend_values(local, camera, values)
        object_alpha = renderer.render(alone, camera).alpha
        views.append(
            View(camera, picture.rgb, picture.depth, picture.alpha, object_alpha,
                 np.ascontiguousarray(shares[..., 0]), np.ascontiguousarray(shares[..., 1]), _box(object_alpha > 0.5))
        )  # fmt: skip
    return views


def _box(mask: BoolArray) -> Box:
    """Bounding box of a mask; the whole image if it is empty."""
    if not mask.any():
        return 0, 0, mask.shape[1], mask.shape[0]
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def _accept(views: Sequence[View], masks: Sequence[BoolArray], config: AcceptConfig) -> list[TrimmedView]:
    """Pair views and masks, with the reason where a mask is not believed."""
    judged = []
    for view, mask in zip(views, masks, strict=True):
        expected = view.expected > 0.5
        union = int(np.count_nonzero(mask | expected))
        overlap = int(np.count_nonzero(mask & expected)) / max(union, 1)
        reason = ""
        if np.count_nonzero(expected) < config.least_silhouette:
            reason = f"the object is expected in only {np.count_nonzero(expected)} pixels"
        elif overlap < config.least_overlap:
            reason = f"the mask overlaps the expected silhouette by {overlap:.2f}; {config.least_overlap} is needed"
        judged.append(TrimmedView(view, mask, reason))
    return judged


def _refusal(judged: Sequence[TrimmedView], accepted: Sequence[TrimmedView], config: AcceptConfig) -> str:
    """Why the coarse selection must stay as it is; empty if the views suffice."""
    if len(accepted) < max(1.0, config.least_views * len(judged)):
        reasons = "; ".join(sorted({view.rejected for view in judged if view.rejected}))
        return f"only {len(accepted)} of {len(judged)} views were accepted ({reasons})"
    return ""


def _weigh(local: Gaussians, accepted: Sequence[TrimmedView], renderer: Renderer) -> list[FloatArray]:
    """Blend weights outside and inside the mask, (N, 2) for each view."""
    return [renderer.blend_weights(local, v.view.camera, v.mask.astype(np.uint8), 2) for v in accepted]


def _halo(
    local: Gaussians, keep: BoolArray, accepted: Sequence[TrimmedView], inside: FloatArray, seen: FloatArray,
    renderer: Renderer, config: EvidenceConfig,
) -> BoolArray:  # fmt: skip
    """Kept Gaussians that paint beside the object when it is rendered alone, (N,)."""
    alone = np.sum(_weigh(local.select(keep), accepted, renderer), axis=0)
    halo = np.zeros(len(local), np.bool_)
    halo[keep] = shows_outside(alone[:, 1], alone[:, 0], inside[keep], seen[keep], config)
    return halo


def _split(
    local: Gaussians, keep: BoolArray, accepted: Sequence[TrimmedView], renderer: Renderer, config: TrimConfig
) -> tuple[IntArray, Gaussians, Gaussians | None] | None:
    """Rows of object Gaussians that straddle the boundary when the object is alone, and their inner and outer parts."""
    if config.split.rule == "none":
        return None
    cameras, masks = [v.view.camera for v in accepted], [v.mask for v in accepted]
    ours = local.select(keep)
    weights = _weigh(ours, accepted, renderer)
    found = find_straddlers(ours, cameras, masks, weights, renderer, config.boundary)
    if len(found.rows) == 0:
        return None
    inner, outer = SPLIT_RULES[config.split.rule](ours.select(found.rows), found.normals, found.offsets)
    return np.flatnonzero(keep)[found.rows], inner, outer


def _assemble(
    scene: Gaussians, selection: BoolArray, final: BoolArray, rows: IntArray,
    parts: tuple[IntArray, Gaussians, Gaussians | None] | None,
) -> tuple[Gaussians, Gaussians, IntArray, NDArray[np.uint8]]:  # fmt: skip
    """Object, outer parts, and source row and label of every output row."""
    whole = final.copy()
    nothing = scene.select(np.zeros(0, np.int64))
    split_rows, inner, outer = (np.zeros(0, np.int64), nothing, nothing)
    if parts is not None:
        split_rows, inner, outer = rows[parts[0]], parts[1], parts[2] or nothing
        whole[split_rows] = False
    inside, beside = np.flatnonzero(whole), np.flatnonzero(~final)
    source = np.concatenate([inside, split_rows, beside, split_rows[: len(outer)]])
    label = np.concatenate([
        np.where(selection[inside], KEPT, RECOVERED), np.full(len(split_rows), SPLIT_INSIDE),
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
