"""The trimmer: plan cameras, render views, correct labels, segment, weigh the evidence, split at the boundary."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaussian_trimmer.arguments import check_scene, mask_of_excluded, mask_of_selection, settings
from gaussian_trimmer.cameras import Camera, CameraSet, training_cameras
from gaussian_trimmer.config import (
    CONTEXT_RADIUS,
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
from gaussian_trimmer.decomposition.evidence import classify_gaussians, find_halo, find_large_halo, find_outsiders
from gaussian_trimmer.decomposition.filling import fill_hole, without_what_shows
from gaussian_trimmer.decomposition.ghosts import clean_background
from gaussian_trimmer.decomposition.refinement import refine
from gaussian_trimmer.decomposition.soft_coverage import resized_mask
from gaussian_trimmer.decomposition.split_rules import SPLIT_RULES
from gaussian_trimmer.decomposition.straddlers import find_straddlers
from gaussian_trimmer.decomposition.underside import find_underside, reaching_into_ground
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.bounds import Bounds, touching
from gaussian_trimmer.geometry.support_plane import SupportPlane, find_support_plane
from gaussian_trimmer.planning.coverage import limit_yaw_to_observed
from gaussian_trimmer.planning.diagnosis import doubts_about_up, find_wrong_input
from gaussian_trimmer.planning.observed_angles import cameras_that_see
from gaussian_trimmer.planning.outline_views import close_up_of, views_at_heights
from gaussian_trimmer.planning.up_vector import UpVector, find_up
from gaussian_trimmer.planning.virtual_cameras import plan_cameras, small_views_around, small_views_from
from gaussian_trimmer.plugin_checks import CheckedRenderer, CheckedSegmenter
from gaussian_trimmer.rendering import DEFAULT_RENDERER, Renderer, get_renderer
from gaussian_trimmer.result import RowLabel, TrimResult
from gaussian_trimmer.scene_limits import check_magnitudes
from gaussian_trimmer.segmentation.acceptance import check_masks, excessive_loss, rejection
from gaussian_trimmer.segmentation.label_crf import correct_labels
from gaussian_trimmer.segmentation.segmenters import DEFAULT_SEGMENTER, Segmenter, description_of, get_segmenter
from gaussian_trimmer.segmentation.view_rendering import complete_views, visible_weight
from gaussian_trimmer.views import TrimmedView

__all__ = [
    "AcceptanceConfig", "BoundaryConfig", "EvidenceConfig", "LabelCrfConfig", "PlanConfig", "RowLabel", "SplitConfig",
    "TrimConfig", "TrimResult", "TrimmedView", "paper_config", "trim",
]  # fmt: skip

_OCCLUDER_DISTANCE = 0.1
"""Distance in front of the object, in object radii, from which on something hides the object instead of touching it."""
_MAX_WIDTH = 4.0
"""Largest standard deviation of a Gaussian of the object, in object radii."""
_HEIGHTS = (12.0, 45.0)
"""Pitches in degrees of the small views that look for what stands in the object's place."""
_LOW = 8.0
"""Pitch in degrees of those that look for what hangs below the object."""
_TINY = 160
"""Their size in pixels."""
_AROUND, _SMALL = 5, 256
"""Their number at each pitch, and their size in pixels."""
_VISIBLE = 0.5
"""Blend weight in pixels of the default views from which on a Gaussian of a surface counts as seen."""
_NOT_FILLED = "No flat surface with a hole was found below the object, so nothing was filled."
_CONNECTING_STEPS = 8
"""Steps from Gaussian to touching Gaussian in which what is selected hangs together with the object."""
Progress = Callable[[str], None]
_Rows = tuple[Gaussians, Gaussians, IntArray, NDArray[np.uint8]]
"""Object, outer parts, and source row and label of every output row."""
_LOG = logging.getLogger("gaussian_trimmer")


def trim(
    scene: Gaussians,
    selection: ArrayLike,
    *,
    config: TrimConfig | None = None,
    renderer: Renderer | str = DEFAULT_RENDERER,
    segmenter: Segmenter | str = DEFAULT_SEGMENTER,
    cameras: CameraSet | None = None,
    views: int | None = None,
    view_cameras: Sequence[Camera] | None = None,
    up: str | ArrayLike | None = None,
    excluded: ArrayLike | None = None,
    progress: Progress = lambda stage: None,
) -> TrimResult:
    """Sharpen a rough selection of one object. Each stage is also logged to "gaussian_trimmer" when it begins.

    Args:
        scene: all N Gaussians; the object alone also works, without background augmentation.
        selection: the rough object: booleans (N,), N whole numbers that are 0 and 1 or 0 and 255, or the numbers of
            the object's rows, from 0, each once.
        config: settings of all stages.
        renderer: a renderer, or the name of one.
        segmenter: a segmenter, or the name of one.
        cameras: the cameras that the scene was trained with, if known: they give the up vector and the range of
            angles from which the object was observed.
        views: number of virtual views, in place of `config.plan.views`.
        view_cameras: cameras to look from in place of virtual ones: the "no virtual cameras" ablation, or those of
            given masks.
        up: the up vector in the scene's coordinates, in place of `config.up`: three numbers, or an axis, "z" or "-y".
        excluded: booleans (N,), which Gaussians never become part of the object unless they are selected; by default
            what marks removed, if the selection was made by `select`.
        progress: called with the name of each stage when it begins; segmenters that take seconds a view add which
            one they are at, as in "segment 2 of 5".

    Raises:
        InputError: the selection does not fit the scene, is empty or can be understood in two ways; a setting is out
            of its range; the scene holds numbers with which nothing can be computed; or a renderer or segmenter of the
            caller's gives something else than its contract says.
    """
    check_scene(scene, cameras)
    config = settings(config, views, up, view_cameras)
    check_config(config)
    check_magnitudes(scene)
    excluded = mask_of_excluded(selection, excluded, len(scene))
    selection = mask_of_selection(selection, len(scene))
    return trim_checked(
        scene, selection, excluded, config, renderer, segmenter, cameras, view_cameras=view_cameras, progress=progress
    )


@dataclass(frozen=True)
class KnownUp:
    """The up vector of a scene, which several of its objects have in common."""

    up: UpVector
    doubt: str
    """What speaks against it, a sentence; empty if nothing does."""


def trim_checked(
    scene: Gaussians, selection: BoolArray, excluded: BoolArray, config: TrimConfig, renderer: Renderer | str,
    segmenter: Segmenter | str, cameras: CameraSet | None, *, view_cameras: Sequence[Camera] | None = None,
    known_up: KnownUp | None = None, progress: Progress = lambda stage: None,
) -> TrimResult:  # fmt: skip
    """`trim` after its arguments were checked; `known_up` is not looked for again."""
    given_renderer = get_renderer(renderer) if isinstance(renderer, str) else renderer
    given_segmenter = get_segmenter(segmenter) if isinstance(segmenter, str) else segmenter
    renderer, segmenter = CheckedRenderer(given_renderer), CheckedSegmenter(given_segmenter)
    clock = _Clock(_logged(progress))
    known = training_cameras(cameras)
    with clock("plan"):
        up = known_up.up if known_up else find_up(scene, cameras, config.up, selection)
        scope = _plan(scene, selection, excluded & ~selection, up, config, cameras, view_cameras)
        wrong = find_wrong_input(scene, selection, scope.bounds, known)
        doubt = known_up.doubt if known_up else "" if wrong else doubts_about_up(scene, selection, up)
    if wrong:
        _LOG.info("not trimmed: %s", wrong)
        return TrimResult(
            scene, *_assemble(scene, selection, scope.rows, None, np.zeros(0, np.int64)), scope.up, scope.bounds, (),
            0, wrong, clock.seconds, renderer.name, segmenter.name, description_of(given_segmenter), selection, config,
            given_renderer, tuple(known),
        )  # fmt: skip
    with clock("render"):
        pictures = [renderer.render(scope.local, camera, weights=True) for camera in scope.cameras]
        visible = visible_weight([picture.weights for picture in pictures], scope.cameras)
    with clock("correct"):
        probability = correct_labels(scope.local, scope.coarse, visible, scope.bounds, config.label_crf)
        probability[scope.excluded] = 0
    with clock("render"):
        unsegmented = complete_views(pictures, scope.local, scope.coarse, probability, scope.cameras, renderer)
    if hasattr(given_segmenter, "report_to"):
        given_segmenter.report_to(lambda part: progress(f"segment {part}"))
    with clock("segment"):
        trimmed = check_masks(
            unsegmented, segmenter.segment_with(unsegmented, scope.local, renderer), config.acceptance
        )
    refused, parts = rejection(trimmed, config.acceptance), None
    accepted = [view for view in trimmed if not view.rejected]
    if not refused:
        parts = _decompose(scope, probability, accepted, renderer, config, clock)
        refused = excessive_loss(scope.coarse, parts.keep, visible, config.acceptance)
    dropped = np.zeros(0, np.int64)
    if parts is not None and not refused and config.background == "clean":
        with clock("clean"):
            parts, dropped = _clean(scope, parts, visible, renderer, config)
    with clock("assemble"):
        rows = _assemble(scene, selection, scope.rows, None if refused else parts, dropped)
    fitted, left = np.zeros(0, np.int64), ""
    if parts is not None and not refused and config.refine == "fit":
        with clock("refine"):
            seen = accepted if view_cameras or segmenter.name != DEFAULT_SEGMENTER else []
            rows, fitted, left = _refine(
                scope, rows, dropped, seen, segmenter.name != DEFAULT_SEGMENTER, bool(view_cameras), known, config
            )
            _LOG.info("fitted %d of the object's rows%s", len(fitted), f": {left}" if left else "")
    filled, doubts = None, [doubt] if doubt else []
    if parts is not None and not refused and config.fill:
        with clock("fill"):
            filled = _fill(scope, parts, dropped, visible, renderer, config)
            rows = (*rows[:2], *_with_filled(rows[2], rows[3], len(filled)))
        doubts += [] if len(filled) else [_NOT_FILLED]
    floaters = int(selection.sum() - scope.coarse.sum())
    _LOG.info("object of %d Gaussians from a selection of %d", len(rows[0]), np.count_nonzero(selection))
    return TrimResult(
        scene, *rows, scope.up, scope.bounds, tuple(trimmed), floaters, refused, clock.seconds, renderer.name,
        segmenter.name, description_of(given_segmenter), selection, config, given_renderer, tuple(known), dropped,
        filled, fitted, left, tuple(doubts),
    )  # fmt: skip


def _logged(progress: Progress) -> Progress:
    """`progress`, which also tells the log."""

    def report(stage: str) -> None:
        _LOG.info("stage: %s", stage)
        progress(stage)

    return report


@dataclass(frozen=True, eq=False)
class _Scope:
    """The part of the scene that the views show, and the cameras of the views."""

    up: UpVector
    bounds: Bounds
    cameras: list[Camera]
    rows: IntArray
    """Scene rows of the object and of the Gaussians around it, ascending, (L,)."""
    local: Gaussians
    """Those Gaussians."""
    coarse: BoolArray
    """Which of them are selected, without floaters far from the object, (L,)."""
    excluded: BoolArray
    """Which of them may not become part of the object, (L,)."""


@dataclass(frozen=True, eq=False)
class _Decomposition:
    """How the Gaussians of a scope are divided between object and background."""

    keep: BoolArray
    """Which ones belong to the object, whole or in part, (L,)."""
    split: IntArray
    """Rows of the scope of those that are cut in two, (S,)."""
    inner: Gaussians | None
    """Their parts inside the object."""
    outer: Gaussians | None
    """Their parts outside it."""


def _plan(
    scene: Gaussians, selection: BoolArray, excluded: BoolArray, up: UpVector, config: TrimConfig,
    cameras: CameraSet | None, views: Sequence[Camera] | None,
) -> _Scope:  # fmt: skip
    """Cameras, and the object with the Gaussians around it."""
    known = training_cameras(cameras)
    planned, bounds = plan_cameras(scene.select(selection), up.direction, config.plan, known)
    rows, coarse = _surroundings(scene, selection, bounds, config.context_radius)
    local = scene.select(rows)
    if views:
        planned = list(views)
    elif not cameras_that_see(known, bounds):
        plan = limit_yaw_to_observed(scene, selection, bounds, config.plan)
        if plan is not config.plan:
            planned, bounds = plan_cameras(local.select(coarse), up.direction, plan)
    return _Scope(up, bounds, planned, rows, local, coarse, excluded[rows])


def _surroundings(
    scene: Gaussians, selection: BoolArray, bounds: Bounds, context_radius: float
) -> tuple[IntArray, BoolArray]:
    """Scene rows of the object and of the Gaussians around it (eq. 7), and which of them are the object.

    Selected Gaussians far from the object that nothing connects with it, floaters, are neither; nor are those that are
    several times as wide as the whole object.
    """
    offset = scene.means - bounds.centre.astype(np.float32)
    squared = np.einsum("ni,ni->n", offset, offset)
    possible = selection & (scene.log_scales.max(axis=1) < np.log(_MAX_WIDTH * bounds.radius))
    coarse = possible & (squared < (max(context_radius, CONTEXT_RADIUS) * bounds.radius) ** 2)
    coarse = _with_connected(scene, possible, coarse) if coarse.any() else selection
    rows = np.flatnonzero(coarse | (~selection & (squared < (context_radius * bounds.radius) ** 2)))
    return rows, coarse[rows]


def _with_connected(scene: Gaussians, selection: BoolArray, coarse: BoolArray) -> BoolArray:
    """The coarse object with those of the other selected Gaussians that hang together with it, (N,)."""
    rows = np.flatnonzero(selection)
    selected, member = scene.select(rows), coarse[rows]
    for _ in range(_CONNECTING_STEPS):
        found = touching(selected, member) if not member.all() else np.zeros(0, np.bool_)
        if not found.any():
            break
        member = member | found
    connected = np.zeros(len(scene), np.bool_)
    connected[rows[member]] = True
    return connected


def _decompose(
    scope: _Scope, probability: FloatArray, accepted: Sequence[TrimmedView], renderer: Renderer, config: TrimConfig,
    clock: _Clock,
) -> _Decomposition:  # fmt: skip
    """Evidence from the views of the whole scene, evidence from the object in isolation, and splits."""
    with clock("weigh"):
        outside, inside = np.sum(_weigh(scope.local, accepted, renderer), axis=0).T
        keep = classify_gaussians(inside, outside, probability, scope.coarse, config.evidence)
    rows = np.flatnonzero(keep)
    with clock("prune"):
        isolated = scope.local.select(rows)
        weights = _weigh_isolated(isolated, accepted, scope.bounds.radius, renderer) if len(rows) else []
        if config.evidence.second_evidence and len(rows):
            plane = _support_plane(scope, keep, inside + outside, config)
            free = plane.above[rows] if plane else np.ones(len(rows), np.bool_)
            alone = np.sum(weights, axis=0)
            widths = np.exp(isolated.log_scales.max(axis=1) - np.log(scope.bounds.radius))
            seen = alone, inside[rows], outside[rows]
            wrong = find_halo(*seen, free, config.evidence) | find_outsiders(*seen, probability[rows], widths)
            wrong |= find_large_halo(alone, inside[rows], widths)
            keep[rows[wrong]] = False
            if plane is not None:
                keep &= ~_underside(scope, keep, plane, renderer)
    if not keep.any():
        return _Decomposition(keep, np.zeros(0, np.int64), None, None)
    with clock("split"):
        cut, inner, outer = _split(isolated, keep[rows], accepted, weights, renderer, config)
        parts = _Decomposition(keep, rows[cut], inner, outer)
        if config.split.at_support_plane.enabled and config.evidence.recover:
            parts = _with_splits_at_support_plane(scope, parts, inside + outside, accepted, renderer, config)
    return parts


def _weigh(part: Gaussians, accepted: Sequence[TrimmedView], renderer: Renderer) -> list[FloatArray]:
    """Blend weights outside and inside the mask, (N, 2) for each view."""
    return [renderer.blend_weights(part, v.view.camera, v.mask.astype(np.uint8), 2) for v in accepted]


def _support_plane(scope: _Scope, keep: BoolArray, seen: FloatArray, config: TrimConfig) -> SupportPlane | None:
    """The plane that the object stands on, if there is one."""
    positions = scope.local.means / np.float32(scope.bounds.radius)
    return find_support_plane(positions, keep, seen.astype(np.float64), scope.bounds, config.label_crf.support_plane)


def _underside(scope: _Scope, keep: BoolArray, plane: SupportPlane, renderer: Renderer) -> BoolArray:
    """What hangs below the object, as it is seen from just above the plane, (L,)."""
    cameras = small_views_from(scope.cameras, scope.bounds, _LOW, _TINY)
    in_ground = reaching_into_ground(scope.local, keep, scope.bounds, plane)
    return find_underside(scope.local, keep, in_ground, cameras, renderer)


def _with_splits_at_support_plane(
    scope: _Scope, parts: _Decomposition, seen: FloatArray, accepted: Sequence[TrimmedView], renderer: Renderer,
    config: TrimConfig,
) -> _Decomposition:  # fmt: skip
    """The decomposition, with hidden Gaussians that cross the support plane below the object split there."""
    plane = _support_plane(scope, parts.keep, seen, config)
    if plane is None:
        return parts
    rows, inner, outer = split_at_support_plane(
        scope.local, parts.keep, seen, plane, scope.bounds, accepted, renderer, config.split.at_support_plane
    )
    allowed = ~scope.excluded[rows]
    rows, inner, outer = rows[allowed], inner.select(allowed), outer.select(allowed)
    keep = parts.keep.copy()
    keep[rows] = True
    # These come first, since they have outer parts under every rule.
    return _Decomposition(
        keep, np.concatenate([rows, parts.split]), _joined(inner, parts.inner), _joined(outer, parts.outer)
    )


def _clean(
    scope: _Scope, parts: _Decomposition, visible: FloatArray, renderer: Renderer, config: TrimConfig
) -> tuple[_Decomposition, IntArray]:
    """The decomposition with what the background must not have, and the rows of the scene that nobody gets."""
    plane = _support_plane(scope, parts.keep, visible, config)
    cameras = small_views(scope.bounds)
    cleaning = clean_background(scope.local, parts.keep, scope.bounds, plane, cameras, renderer)
    joins = cleaning.to_object if config.evidence.recover else cleaning.to_object & scope.coarse
    return replace(parts, keep=parts.keep | (joins & ~scope.excluded)), scope.rows[cleaning.dropped]


def small_views(bounds: Bounds) -> list[Camera]:
    """Views from all sides that look for what stands in an object's place."""
    return small_views_around(bounds, _AROUND, _HEIGHTS, _SMALL)


def _refine(
    scope: _Scope, rows: _Rows, dropped: IntArray, seen: Sequence[TrimmedView], trust: bool, given: bool,
    known: Sequence[Camera], config: TrimConfig,
) -> tuple[_Rows, IntArray, str]:  # fmt: skip
    """All rows, with the object's boundary fitted, the object's rows that are, and why none is, if the views forbid it.

    The views that were `seen` are fitted to their masks if these can be trusted to be more than what labels show, and
    small views from several heights to that; these are left out where the cameras were given.
    """
    inner, outer, source, label = rows
    how, n = config.refinement, len(inner)
    cameras: list[Camera] = []
    masks: list[FloatArray | None] = []
    for trimmed in seen[:: max(1, len(seen) // how.views)]:
        camera, part = close_up_of(trimmed.view.camera, scope.bounds, how.size)
        cameras.append(camera)
        masks.append(resized_mask(trimmed.mask[part], camera) if trust else None)
    if not given:
        near = views_at_heights(scope.bounds, scope.cameras, known, how.views, how.size)
        cameras, masks = cameras + near, masks + [None] * len(near)
    others = ~np.isin(scope.rows, source[:n]) & ~np.isin(scope.rows, dropped)
    around = concatenate([scope.local.select(others), outer])
    refined = refine(inner, around, cameras, masks, scope.bounds.radius, how)
    ours = np.where(refined.part, RowLabel.SPLIT_INSIDE, label[refined.parent]).astype(np.uint8)
    source = np.concatenate([source[refined.parent], source[n:]])
    labels = np.concatenate([ours, label[n:]])
    return (refined.object, outer, source, labels), np.flatnonzero(refined.fitted), refined.left


def _fill(
    scope: _Scope, parts: _Decomposition, dropped: IntArray, visible: FloatArray, renderer: Renderer,
    config: TrimConfig,
) -> Gaussians:  # fmt: skip
    """New Gaussians that close the hole which the object leaves in the plane that it stands on; perhaps none."""
    plane = _support_plane(scope, parts.keep, visible, config)
    if plane is None:
        return scope.local.select(np.zeros(0, np.int64))
    left = ~np.isin(scope.rows, dropped)
    surface = plane.on_surface & ~parts.keep & left & (visible > _VISIBLE)
    filled = fill_hole(scope.local, parts.keep, surface, scope.bounds, plane, renderer)
    cameras = small_views(scope.bounds)
    return without_what_shows(filled, scope.local.select(left), parts.keep[left], cameras, renderer)


def _with_filled(source: IntArray, label: NDArray[np.uint8], count: int) -> tuple[IntArray, NDArray[np.uint8]]:
    """Source rows and labels of all output rows, those of filled Gaussians at the end."""
    new = np.full(count, RowLabel.FILLED, np.uint8)
    return np.concatenate([source, np.full(count, -1, np.int64)]), np.concatenate([label, new])


def _joined(first: Gaussians, second: Gaussians | None) -> Gaussians:
    return first if second is None else concatenate([first, second])


def _weigh_isolated(
    isolated: Gaussians, accepted: Sequence[TrimmedView], radius: float, renderer: Renderer
) -> list[FloatArray]:
    """Blend weights of the object in isolation, (N, 3) for each view.

    The columns are pixels outside the mask, inside it, and outside it but hidden in the scene by something nearer.
    """
    weights = []
    for trimmed in accepted:
        camera, nearest_depth = trimmed.view.camera, trimmed.view.depth
        depth = renderer.render(isolated, camera).depth
        occluded = (nearest_depth > 0) & (nearest_depth < depth - _OCCLUDER_DISTANCE * radius)
        labels = np.where(trimmed.mask, np.uint8(1), np.where(occluded, np.uint8(2), np.uint8(0)))
        weights.append(renderer.blend_weights(isolated, camera, labels, 3))
    return weights


def _split(
    isolated: Gaussians, keep: BoolArray, accepted: Sequence[TrimmedView], weights: Sequence[FloatArray],
    renderer: Renderer, config: TrimConfig,
) -> tuple[IntArray, Gaussians | None, Gaussians | None]:  # fmt: skip
    """Rows of Gaussians that straddle the boundary of the object in isolation, and their inner and outer parts."""
    if config.split.rule == "none":
        return np.zeros(0, np.int64), None, None
    sides = [weight[:, :2] for weight in weights]
    found = find_straddlers(isolated, accepted, sides, renderer, config.boundary)
    ours = keep[found.rows]
    rows = found.rows[ours]
    return rows, *SPLIT_RULES[config.split.rule](isolated.select(rows), found.normals[ours], found.offsets[ours])


def _assemble(
    scene: Gaussians, selection: BoolArray, rows: IntArray, parts: _Decomposition | None, dropped: IntArray
) -> tuple[Gaussians, Gaussians, IntArray, NDArray[np.uint8]]:
    """Object, outer parts, and source row and label of every output row.

    Without a decomposition the object is the selection as it was. The dropped rows of the scene are in no part.
    """
    final = selection.copy() if parts is None else np.zeros(len(scene), np.bool_)
    nothing = scene.select(np.zeros(0, np.int64))
    split, inner, outer = np.zeros(0, np.int64), nothing, nothing
    if parts is not None:
        final[rows] = parts.keep
        split, inner, outer = rows[parts.split], parts.inner or nothing, parts.outer or nothing
    whole = final.copy()
    whole[split] = False
    final[dropped] = True
    inside, outside = np.flatnonzero(whole), np.flatnonzero(~final)
    source = np.concatenate([inside, split, outside, split[: len(outer)]])
    label = np.concatenate([
        np.where(selection[inside], RowLabel.KEPT, RowLabel.RECOVERED), np.full(len(split), RowLabel.SPLIT_INSIDE),
        np.where(selection[outside], RowLabel.PRUNED, RowLabel.KEPT), np.full(len(outer), RowLabel.SPLIT_OUTSIDE),
    ]).astype(np.uint8)  # fmt: skip
    return concatenate([scene.select(inside), inner]), outer, source, label


class _Clock:
    """Adds up the time that each stage takes, over all its parts, and announces each part when it begins."""

    def __init__(self, progress: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self._progress = progress

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        self._progress(stage)
        start = time.perf_counter()
        yield
        self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start
