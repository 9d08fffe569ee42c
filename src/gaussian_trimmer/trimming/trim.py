"""The trimmer: plan cameras, render views, correct labels, segment, weigh the evidence, split, fit, and remove."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from gaussian_trimmer.cameras import Camera, CameraSet, training_cameras
from gaussian_trimmer.config import (
    TrimConfig,
)
from gaussian_trimmer.decomposition.coverage import OutlineViews
from gaussian_trimmer.decomposition.evidence import vote
from gaussian_trimmer.decomposition.isolation import prune_halo
from gaussian_trimmer.decomposition.splitting import Decomposition, split_straddlers
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.planning.diagnosis import find_wrong_input, selection_warning, up_warning
from gaussian_trimmer.planning.place_views import views_of_place
from gaussian_trimmer.planning.up_vector import UpVector, find_up
from gaussian_trimmer.removal.continuation import brightened
from gaussian_trimmer.removal.place import Place
from gaussian_trimmer.removal.removal import Removal, remove
from gaussian_trimmer.rendering import DEFAULT_RENDERER, Renderer
from gaussian_trimmer.result import TrimResult
from gaussian_trimmer.scope import Scope
from gaussian_trimmer.segmentation.acceptance import check_masks, excessive_loss, rejection
from gaussian_trimmer.segmentation.label_crf import correct_labels
from gaussian_trimmer.segmentation.segmenters import DEFAULT_SEGMENTER, Segmenter, description_of, mask_source_of
from gaussian_trimmer.segmentation.view_rendering import complete_views, render_scope
from gaussian_trimmer.trimming.arguments import check_scene, mask_of_excluded, mask_of_selection, settings
from gaussian_trimmer.trimming.assembly import Assembly, assemble, left_as_it_was
from gaussian_trimmer.trimming.clock import LOG, Clock, Progress
from gaussian_trimmer.trimming.outline import fit_outline, outline_views
from gaussian_trimmer.trimming.scope import plan_scope
from gaussian_trimmer.trimming.task import PlugIns, Task
from gaussian_trimmer.views import HALF, TrimmedView


@dataclass(frozen=True, eq=False)
class Decision:
    """What belongs to the object, before anything is fitted and put together."""

    scope: Scope
    up: UpVector
    warnings: tuple[str, ...]
    views: tuple[TrimmedView, ...] = ()
    """All views, accepted or not; none if an input was found wrong."""
    visible: FloatArray | None = None
    """Blend weight of each Gaussian of the scope in the views, (L,)."""
    outline: OutlineViews | None = None
    """Small views of what belongs to the object; None if that was not found out."""
    parts: Decomposition | None = None
    """What the object gets; None if the selection is left as it was."""
    refused: str | None = None
    """Why it is left as it was."""
    given_up: BoolArray | None = None
    """Gaussians of the scene that other objects got, (N,)."""


# More arguments than a function of this package has elsewhere: callers give all but two by name, and most give none.
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
        selection: the object, roughly: booleans (N,), N whole numbers that are 0 and 1 or 0 and 255, or the numbers of
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
    task = Task(
        scene,
        mask_of_selection(selection, len(scene)),
        mask_of_excluded(selection, excluded, len(scene)),
        settings(config, views, up, view_cameras),
        PlugIns.of(renderer, segmenter),
        cameras,
        view_cameras,
    )
    clock = Clock(progress)
    decision, removal = decide(task, clock), None
    if decision.parts is not None and task.config.background != "exact":
        with clock("remove"):
            decision, removal = removed(task, decision)
    return finish(task, decision, removal, clock)


def decide(task: Task, clock: Clock) -> Decision:
    """Decide which Gaussians belong to the object: the stages up to splitting."""
    config, renderer = task.config, task.renderer
    with clock("plan"):
        plan = _plan(task)
    scope = plan.scope
    if plan.refused:
        return plan
    with clock("render"):
        renderings = render_scope(scope, renderer)
    with clock("correct"):
        probability = correct_labels(scope.local, scope.selected, renderings.visible, scope.bounds, config.label_crf)
        probability[scope.excluded] = 0
    with clock("render"):
        unsegmented = complete_views(scope, renderings, probability, renderer)
    task.plug_ins.report_parts_to(lambda part: clock.part(f"segment {part}"))
    with clock("segment"):
        judged = mask_source_of(task.plug_ins.given_segmenter) != "labels"
        masks = task.plug_ins.segmenter.segment_with(unsegmented, scope.shown, renderer)
        views = check_masks(unsegmented, masks, config.acceptance, judged)
    plan = replace(plan, views=tuple(views), visible=renderings.visible)
    refused = rejection(views, config.acceptance)
    if refused:
        return replace(plan, refused=refused)
    accepted = [view for view in views if not view.rejected]
    with clock("split"):
        candidates = scope.selected | (probability > HALF)
        parts = split_straddlers(scope.shown, candidates, accepted, renderer, config.boundary, config.split)
    with clock("weigh"):
        parts = vote(scope.shown, parts, scope.selected, probability, views, renderer, config.evidence)
    with clock("prune"):
        plane = scope.support_plane(parts.members, renderings.visible, config.label_crf.support_plane)
        outline = outline_views(task, scope, accepted, plane)
        if config.evidence.min_in_place > 0:
            parts = prune_halo(scope.local, parts, outline, config.evidence.min_in_place)
    refused = excessive_loss(
        scope.selected, parts.members, renderings.visible, renderings.visible_alone, config.acceptance
    )
    return replace(plan, outline=outline, refused=refused, parts=None if refused else parts)


def _plan(task: Task) -> Decision:
    """Where to look from; refused if an input is wrong."""
    up = task.known_up.up if task.known_up else find_up(task.scene, task.cameras, task.config.up, task.selection)
    scope = plan_scope(task, up.direction)
    wrong = find_wrong_input(task.scene, task.selection, scope.bounds, training_cameras(task.cameras))
    if task.known_up:
        doubt = task.known_up.warning
    else:
        doubt = None if wrong else up_warning(task.scene, task.selection, up)
    found = (selection_warning(task.scene, task.selection), doubt)
    return Decision(scope, up, tuple(warning for warning in found if warning), refused=wrong)


def removed(task: Task, decision: Decision) -> tuple[Decision, Removal]:
    """The decision with what else belongs to the object, and the scene without it."""
    scope, parts = decision.scope, decision.parts
    assert parts is not None
    cameras = views_of_place(scope.bounds, task.config.refinement.size)
    place = Place(scope.local, parts.members, parts.members, scope.bounds, cameras, task.renderer)
    removal = remove(place, fill=task.config.background == "filled")
    joins = removal.to_object & ~scope.excluded & (scope.selected | task.config.evidence.recover)
    return replace(decision, parts=replace(parts, members=parts.members | joins)), removal


def finish(task: Task, decision: Decision, removal: Removal | None, clock: Clock) -> TrimResult:
    """Put object and background together, with the object's outline fitted and the surfaces that it hid continued."""
    config, scope, parts = task.config, decision.scope, decision.parts
    if parts is None:
        LOG.info("not trimmed: %s", decision.refused)
        kept = task.selection if decision.given_up is None else task.selection & ~decision.given_up
        return _result(task, decision, left_as_it_was(task.scene, task.selection, kept), clock)
    with clock("assemble"):
        nobodys = scope.rows[removal.ghosts & ~parts.members] if removal else np.zeros(0, np.int64)
        assembly = assemble(task.scene, task.selection, scope.rows, parts, nobodys)
    if config.refine == "fit":
        with clock("refine"):
            assert decision.outline is not None
            assembly = fit_outline(task, scope, assembly, decision.outline)
        LOG.info("fitted %d of the object's rows (%s)", len(assembly.fitted), assembly.not_fitted or "done")
    if removal:
        assembly = _with_surfaces(assembly, scope, removal)
    LOG.info("object of %d Gaussians from a selection of %d", len(assembly.object), task.selection.sum())
    return _result(task, decision, assembly, clock)


def _with_surfaces(assembly: Assembly, scope: Scope, removal: Removal) -> Assembly:
    if removal.not_filled:
        LOG.info("not filled: %s", removal.not_filled)
        return replace(assembly, not_filled=removal.not_filled)
    relit = np.flatnonzero(removal.gain > 1)
    brighter = brightened(scope.local.select(relit), removal.gain[relit])
    return assembly.with_surfaces(brighter, scope.rows[relit], scope.rows[removal.replaced], removal.filled)


def _result(task: Task, decision: Decision, assembly: Assembly, clock: Clock) -> TrimResult:
    plug_ins, n_floaters = task.plug_ins, int(task.selection.sum() - decision.scope.selected.sum())
    return TrimResult(
        scene=task.scene,
        **vars(assembly),
        up=decision.up,
        bounds=decision.scope.bounds,
        views=decision.views,
        floaters=n_floaters if decision.views else 0,
        refused=decision.refused,
        seconds=clock.seconds,
        renderer=task.renderer.name,
        segmenter=plug_ins.segmenter.name,
        segmenter_description=description_of(plug_ins.given_segmenter),
        selection=task.selection,
        config=task.config,
        used_renderer=plug_ins.given_renderer,
        cameras=tuple(training_cameras(task.cameras)),
        warnings=decision.warnings,
    )
