"""Put together what was decided: each object with its outline fitted, and the scene without all of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.cameras import training_cameras
from gaussian_trimmer.decomposition.refinement import refine
from gaussian_trimmer.decomposition.stroke_cuts import cut_at_stroke
from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray, LabelArray, concatenate, mask_of_rows
from gaussian_trimmer.output.result import RowLabel, TrimmedObject, TrimResult
from gaussian_trimmer.removal.inpainting import scale_radiance
from gaussian_trimmer.removal.remove import Removal
from gaussian_trimmer.segmentation.segmenters import description_of, name_of
from gaussian_trimmer.trimming.arguments import Setup
from gaussian_trimmer.trimming.clock import LOG
from gaussian_trimmer.trimming.decision import Decision


def assemble_object(
    setup: Setup, owner: LabelArray, hidden: BoolArray, decision: Decision, removal: Removal | None, number: int
) -> tuple[TrimmedObject, Gaussians, IntArray]:
    """Put an object together and fit its outline; returns it, the outer parts of split Gaussians, and their scene rows.

    Args:
        setup: what all objects have in common.
        owner: number of the object that has each Gaussian of the scene, 0 for none, (N,).
        hidden: what only objects hid, (N,).
        decision: what belongs to the object.
        removal: the scene without it; None if that was not looked at.
        number: its number in `owner`.
    """
    scene, rough, crop = setup.scene, decision.rough, decision.crop
    rows = decision.owned(owner, number)
    split, inner, outer = _split_rows(decision, scene, rows)
    whole = np.setdiff1d(rows, split, assume_unique=True)
    label = np.where(np.isin(whole, rough.rows, assume_unique=True), RowLabel.KEPT, RowLabel.ADDED)
    gaussians = concatenate([scene.select(whole), inner])
    source = np.concatenate([whole, split])
    label = np.concatenate([label, np.full(len(split), RowLabel.SPLIT_INSIDE)]).astype(np.uint8)
    fitted, not_fitted = np.zeros(0, np.int64), None
    if decision.outline is not None and setup.config.refine == "fit":
        others = (owner[crop.rows] != number) & ~hidden[crop.rows]
        around = concatenate([crop.local.select(others), outer])
        refined = refine(gaussians, around, decision.outline, setup.config.refinement)
        gaussians, source, not_fitted = refined.object, source[refined.parent], refined.skipped_because
        label = np.where(refined.part, RowLabel.SPLIT_INSIDE, label[refined.parent]).astype(np.uint8)
        fitted = np.flatnonzero(refined.fitted)
    cut_off = split[: len(outer)]
    for cut in rough.cuts:
        is_fitted = mask_of_rows(fitted, len(source))
        pieces = (label == RowLabel.SPLIT_INSIDE) | is_fitted
        made = cut_at_stroke(gaussians, ~cut.spared[source], pieces, cut, setup.renderer)
        outer, cut_off = concatenate([outer, made.cut_off]), np.concatenate([cut_off, source[made.cut_off_parent]])
        gaussians, source, fitted = made.object, source[made.parent], np.flatnonzero(is_fitted[made.parent])
        label = label[made.parent]
        label[len(label) - made.n_parts :] = RowLabel.SPLIT_INSIDE
    if decision.refused:
        LOG.info("not trimmed: %s", decision.refused)
    LOG.info("%s: %d Gaussians from a selection of %d", rough.name, len(gaussians), len(rough.rows))
    trimmed = TrimmedObject(
        id=rough.id,
        name=rough.name,
        gaussians=gaussians,
        source_index=source,
        label=label,
        selected_rows=rough.rows,
        up=decision.up,
        bounds=crop.bounds,
        views=decision.views,
        refused=decision.refused,
        warnings=decision.warnings + (removal.warnings if removal else ()),
        floaters=len(rough.rows) - int(crop.selected.sum()) if decision.views else 0,
        lost=int(np.count_nonzero(owner[decision.rows] != number)),
        fitted=fitted,
        not_fitted=not_fitted,
        not_filled=removal.not_filled if removal else None,
        seconds=decision.seconds,
    )
    return trimmed, outer, cut_off


def _split_rows(decision: Decision, scene: Gaussians, rows: IntArray) -> tuple[IntArray, Gaussians, Gaussians]:
    """Scene rows of an object's split Gaussians, and their parts inside and outside, without those it lost."""
    none = scene.select(slice(0))
    if decision.parts is None or decision.parts.inner is None:
        return np.zeros(0, np.int64), none, none
    split = decision.crop.rows[decision.parts.split]
    kept, outer = np.isin(split, rows), decision.parts.outer
    return split[kept], decision.parts.inner.select(kept), none if outer is None else outer.select(kept)


def assemble_result(
    setup: Setup,
    assembled: Sequence[tuple[TrimmedObject, Gaussians, IntArray]],
    owner: LabelArray,
    hidden: BoolArray,
    removals: Sequence[tuple[IntArray, Removal]],
    contested: int,
    seconds: dict[str, float],
) -> TrimResult:
    """Put the scene without the objects together, and all in one result.

    Args:
        setup: what all objects have in common.
        assembled: what `assemble_object` returns for each.
        owner: number of the object that has each Gaussian of the scene, 0 for none, (N,).
        hidden: what only objects hid, (N,).
        removals: the scene without each object that was removed, and the scene rows that this is about.
        contested: number of Gaussians that several objects claimed.
        seconds: time taken by each stage.
    """
    scene, (objects, outer, split) = setup.scene, zip(*assembled, strict=True)
    discarded, selected, gain = hidden.copy(), np.zeros(len(scene), np.bool_), np.ones(len(scene), np.float32)
    for part in objects:
        selected[part.selected_rows] = True
    for rows, removal in removals:
        discarded[rows[removal.replaced]] = True
        gain[rows] = np.maximum(gain[rows], removal.relight_factor)
    unowned = owner == 0
    discarded &= unowned
    relit = np.flatnonzero(unowned & ~discarded & (gain > 1))
    whole = np.flatnonzero(unowned & ~discarded & (gain == 1))
    filled = concatenate([scene.select(slice(0)), *(removal.inpainted for _, removal in removals)])
    labels = [
        np.where(selected[whole], RowLabel.REMOVED, RowLabel.KEPT),
        np.full(sum(map(len, outer)), RowLabel.SPLIT_OUTSIDE),
        np.full(len(relit), RowLabel.RELIT),
        np.full(len(filled), RowLabel.FILLED),
    ]
    return TrimResult(
        scene=scene,
        objects=objects,
        appended=concatenate([*outer, scale_radiance(scene.select(relit), gain[relit]), filled]),
        background_source=np.concatenate([whole, *split, relit, np.full(len(filled), -1, np.int64)]),
        background_label=np.concatenate(labels).astype(np.uint8),
        discarded=np.flatnonzero(discarded),
        contested=contested,
        config=setup.config,
        renderer=name_of(setup.renderer),
        segmenter=description_of(setup.segmenter),
        used_renderer=setup.renderer,
        cameras=tuple(training_cameras(setup.cameras)),
        seconds=seconds,
    )
