"""The trimmer: plan cameras, render views, correct labels, segment, weigh the evidence, split at the boundary."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gaussian_trimmer.cameras import Camera, CameraSet, training_cameras
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
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.geometry.limits import check_magnitudes
from gaussian_trimmer.planning.diagnosis import doubts_about_up, find_wrong_input
from gaussian_trimmer.planning.up_vector import UpVector, find_up
from gaussian_trimmer.rendering import DEFAULT_RENDERER, Renderer, get_renderer
from gaussian_trimmer.result import RowLabel, TrimResult
from gaussian_trimmer.segmentation.acceptance import check_masks, excessive_loss, rejection
from gaussian_trimmer.segmentation.label_crf import correct_labels
from gaussian_trimmer.segmentation.segmenters import (
    DEFAULT_SEGMENTER,
    Segmenter,
    description_of,
    get_segmenter,
    knows_outlines,
)
from gaussian_trimmer.segmentation.view_rendering import complete_views, visible_weight
from gaussian_trimmer.trimming.arguments import check_scene, mask_of_excluded, mask_of_selection, settings
from gaussian_trimmer.trimming.boundary import decompose
from gaussian_trimmer.trimming.finishing import Rows, assemble, clean, fill, refine_boundary, with_filled
from gaussian_trimmer.trimming.plugin_checks import CheckedRenderer, CheckedSegmenter
from gaussian_trimmer.trimming.scope import plan_scope
from gaussian_trimmer.views import TrimmedView

__all__ = [
    "AcceptanceConfig", "BoundaryConfig", "EvidenceConfig", "LabelCrfConfig", "PlanConfig", "RowLabel", "SplitConfig",
    "TrimConfig", "TrimResult", "TrimmedView", "paper_config", "trim",
]  # fmt: skip

_NOT_FILLED = "No flat surface with a hole was found below the object, so nothing was filled."
Progress = Callable[[str], None]
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
        scope = plan_scope(scene, selection, excluded & ~selection, up, config, cameras, view_cameras)
        wrong = find_wrong_input(scene, selection, scope.bounds, known)
        doubt = known_up.doubt if known_up else "" if wrong else doubts_about_up(scene, selection, up)

    def result(rows: Rows, refused: str = "", views: Sequence[TrimmedView] = (), **more: Any) -> TrimResult:
        floaters = int(selection.sum() - scope.coarse.sum()) if views else 0
        return TrimResult(
            scene, *rows, up, scope.bounds, tuple(views), floaters, refused, clock.seconds, renderer.name,
            segmenter.name, description_of(given_segmenter), selection, config, given_renderer, tuple(known), **more,
        )  # fmt: skip

    if wrong:
        _LOG.info("not trimmed: %s", wrong)
        return result(assemble(scene, selection, scope.rows, None, np.zeros(0, np.int64)), wrong)
    with clock("render"):
        pictures = [renderer.render(scope.local, camera, weights=True) for camera in scope.cameras]
        selected = scope.local.select(scope.coarse)
        isolated = [renderer.render(selected, camera, weights=True) for camera in scope.cameras]
        visible, alone = (visible_weight([p.weights for p in shown], scope.cameras) for shown in (pictures, isolated))
    with clock("correct"):
        probability = correct_labels(scope.local, scope.coarse, visible, scope.bounds, config.label_crf)
        probability[scope.excluded] = 0
    with clock("render"):
        unsegmented = complete_views(
            pictures, isolated, scope.local, scope.coarse, probability, scope.cameras, scope.bounds.radius, renderer
        )
    if hasattr(given_segmenter, "report_to"):
        given_segmenter.report_to(lambda part: progress(f"segment {part}"))
    with clock("segment"):
        trimmed = check_masks(
            unsegmented, segmenter.segment_with(unsegmented, scope.local, renderer), config.acceptance
        )
    accepted = [view for view in trimmed if not view.rejected]
    refused = rejection(trimmed, config.acceptance)
    warnings = [doubt] if doubt else []
    dropped = fitted = np.zeros(0, np.int64)
    if not refused:
        parts = decompose(scope, probability, accepted, renderer, config, clock)
        refused = excessive_loss(scope.coarse, parts.keep, visible, alone, config.acceptance)
    if refused:
        with clock("assemble"):
            rows = assemble(scene, selection, scope.rows, None, dropped)
        _LOG.info("not trimmed: %s", refused)
        return result(rows, refused, trimmed, warnings=tuple(warnings))
    if config.background == "clean":
        with clock("clean"):
            parts, dropped = clean(scope, parts, visible, renderer, config)
    with clock("assemble"):
        rows = assemble(scene, selection, scope.rows, parts, dropped)
    not_fitted, filled = "", None
    if config.refine == "fit":
        with clock("refine"):
            seen, trust = (accepted, knows_outlines(given_segmenter)) if view_cameras else ([], False)
            rows, fitted, not_fitted = refine_boundary(scope, rows, dropped, seen, trust, known, config)
            _LOG.info("fitted %d of the object's rows%s", len(fitted), f": {not_fitted}" if not_fitted else "")
    if config.fill:
        with clock("fill"):
            filled = fill(scope, parts, dropped, visible, renderer, config)
            rows = (*rows[:2], *with_filled(rows[2], rows[3], len(filled)))
        warnings += [] if len(filled) else [_NOT_FILLED]
    _LOG.info("object of %d Gaussians from a selection of %d", len(rows[0]), np.count_nonzero(selection))
    return result(
        rows, views=trimmed, dropped=dropped, filled=filled, fitted=fitted, not_fitted=not_fitted,
        warnings=tuple(warnings),
    )  # fmt: skip


def _logged(progress: Progress) -> Progress:
    """`progress`, which also tells the log."""

    def report(stage: str) -> None:
        _LOG.info("stage: %s", stage)
        progress(stage)

    return report


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
