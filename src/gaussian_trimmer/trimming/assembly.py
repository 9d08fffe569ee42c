"""Put together what was decided: each object with its outline fitted, and the scene without all of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.cameras import training_cameras
from gaussian_trimmer.gaussians import Gaussians, IntArray, LabelArray, concatenate
from gaussian_trimmer.geometry.graphs import nearest
from gaussian_trimmer.removal.inpainting import scale_radiance
from gaussian_trimmer.removal.remove import Removal
from gaussian_trimmer.trimming.arguments import Setup, StrokeCut
from gaussian_trimmer.trimming.clock import LOG
from gaussian_trimmer.trimming.decision import Decision
from gaussian_trimmer.trimming.refinement import Pieces, refine
from gaussian_trimmer.trimming.result import Once, RowLabel, SceneWithoutObjects, TrimmedObject, TrimResult

_VOTING_NEIGHBOURS = 8
"""Number of nearest Gaussians that decide to which of several objects one belongs."""


def resolve_overlaps(
    scene: Gaussians, claims: Sequence[IntArray], selections: Sequence[IntArray]
) -> tuple[LabelArray, int]:
    """Give each Gaussian to one object: the one whose selection had it, or else the one of most of its neighbours.

    Of equal votes the first object wins. Whoever does not ask for a Gaussian never gets it.

    Args:
        scene: all N Gaussians.
        claims: scene rows of what each object asks for, ascending.
        selections: scene rows of what was selected of each, ascending.

    Returns:
        The number of each Gaussian's object, counted from 1, or 0 for none, (N,), and how many were contested.
    """
    owner, count = np.zeros(len(scene), np.int32), np.zeros(len(scene), np.int32)
    for number, rows in enumerate(claims, 1):
        owner[rows] = np.where(count[rows] > 0, owner[rows], number)
        count[rows] += 1
    contested = np.flatnonzero(count > 1)
    if not len(contested):
        return owner, 0
    claims = [rows[count[rows] > 1] for rows in claims]
    selectors = np.zeros(len(scene), np.int32)
    for rows, selected in zip(claims, selections, strict=True):
        selectors[np.intersect1d(rows, selected, assume_unique=True)] += 1
    for number, (rows, selected) in enumerate(zip(claims, selections, strict=True), 1):
        chosen = np.intersect1d(rows, selected, assume_unique=True)
        owner[chosen[selectors[chosen] == 1]] = number
    _vote(scene, owner, [rows[selectors[rows] != 1] for rows in claims], np.flatnonzero(count == 1))
    return owner, len(contested)


def _vote(scene: Gaussians, owner: LabelArray, claims: Sequence[IntArray], settled: IntArray) -> None:
    """Write into `owner` which of the objects that claim a Gaussian most of its settled neighbours belong to."""
    unclear = np.unique(np.concatenate(claims))
    if not len(unclear) or not len(settled):
        return
    _, near = nearest(scene.means[settled], scene.means[unclear], min(_VOTING_NEIGHBOURS, len(settled)))
    voters, most = owner[settled[near]], np.full(len(unclear), -1)
    for number, rows in enumerate(claims, 1):
        places = np.searchsorted(unclear, rows)
        votes = (voters[places] == number).sum(axis=1)
        better = votes > most[places]
        owner[rows[better]], most[places[better]] = number, votes[better]


def assemble_object(setup: Setup, owner: LabelArray, decision: Decision, number: int) -> tuple[TrimmedObject, Pieces]:
    """Put an object together and fit its outline; return it, and what was cut off from it.

    Args:
        setup: what all objects have in common.
        owner: number of the object that has each Gaussian of the scene, 0 for none, (N,).
        decision: what belongs to the object.
        number: its number in `owner`.
    """
    rough, crop, rows, not_fitted = decision.rough, decision.crop, decision.considered, None
    finally_own = own = owner[rows] == number
    if decision.before_strokes is not None:
        own = np.where(np.isin(rows, rough.touched), decision.before_strokes, own)
    pieces, cut_off = _split(decision, setup.scene, rows[own])
    outline = decision.outline if setup.config.refine == "fit" else None
    if outline is not None and decision.cut is not None:
        around = concatenate([crop.local.select(~own), cut_off.gaussians])
        renders = outline.render(pieces.gaussians, around, colours=True)
        pieces, not_fitted = refine(pieces, renders, setup.config.refinement)
    elif outline is not None and (own | setup.scene.blank[rows]).all():
        not_fitted = "nothing lies around the object"
    elif outline is not None:
        pieces, not_fitted = refine(pieces, outline.render_part(crop.local, own, colours=True), setup.config.refinement)
    if rough.cuts or decision.before_strokes is not None:
        taken, added = rows[own & ~finally_own], rows[finally_own & ~own]
        pieces, cut_off = _after_strokes(setup.scene, rough.cuts, taken, added, pieces, cut_off)
    unsplit = np.where(np.isin(pieces.source, rough.rows), RowLabel.KEPT, RowLabel.ADDED)
    if decision.refused:
        LOG.info("not trimmed: %s", decision.refused)
    LOG.info("%s: %d Gaussians from a selection of %d", rough.name, len(pieces.source), len(rough.rows))
    trimmed = TrimmedObject(
        id=rough.id,
        name=rough.name,
        gaussians=pieces.gaussians,
        source_index=pieces.source,
        label=np.where(pieces.part, RowLabel.SPLIT_INSIDE, unsplit).astype(np.uint8),
        selected_rows=rough.rows,
        up=decision.up,
        bounds=crop.bounds,
        views=decision.views,
        refused=decision.refused,
        warnings=decision.warnings,
        floaters=len(rough.undecided.rows) - int(crop.selected.sum()) if decision.views else 0,
        lost=int(np.count_nonzero(owner[decision.rows] != number)),
        fitted=np.flatnonzero(pieces.fitted),
        not_fitted=not_fitted,
        seconds=decision.seconds,
    )
    return trimmed, cut_off


def _split(decision: Decision, scene: Gaussians, rows: IntArray) -> tuple[Pieces, Pieces]:
    """Return an object's Gaussians, parts of split ones last, and the outer parts, by its scene rows."""
    nothing = Pieces.of(scene.select(slice(0)), np.zeros(0, np.int64))
    cut = decision.cut
    if cut is None:
        return Pieces.of(scene.select(rows), rows), nothing
    split = decision.crop.rows[cut.rows]
    kept, whole = np.isin(split, rows), np.setdiff1d(rows, split, assume_unique=True)
    inner = Pieces.of(cut.inner.select(kept), split[kept], part=True)
    outer = nothing if cut.outer is None else Pieces.of(cut.outer.select(kept), split[kept], part=True)
    return Pieces.of(scene.select(whole), whole).followed_by(inner), outer


def _after_strokes(
    scene: Gaussians,
    cuts: Sequence[StrokeCut],
    taken: IntArray,
    added: IntArray,
    pieces: Pieces,
    cut_off: Pieces,
) -> tuple[Pieces, Pieces]:
    """Return an object's pieces, and what was cut off from it, as strokes leave them.

    Args:
        scene: all Gaussians.
        cuts: strokes at which it is cut.
        taken: scene rows of what strokes on its cut-out took away whole.
        added: scene rows of what they put back.
        pieces, cut_off: the object before the strokes, and what was cut off from it.
    """
    gone = np.isin(pieces.source, taken)
    hiding, pieces = pieces.select(np.flatnonzero(gone)), pieces.select(np.flatnonzero(~gone))
    cut_off = cut_off.select(np.flatnonzero(~np.isin(cut_off.source, taken)))
    if len(added):
        pieces = pieces.followed_by(Pieces.of(scene.select(added), added))
        pieces = pieces.select(np.lexsort((np.where(pieces.part, 0, pieces.source), pieces.part)))
    for cut in cuts:
        from gaussian_trimmer.trimming.straddlers import cut_at_stroke  # late, since hardly anybody draws a stroke

        before = hiding.gaussians.select(np.flatnonzero(cut.taken[hiding.source]))
        pieces, fallen = cut_at_stroke(pieces, cut, before)
        cut_off = cut_off.followed_by(fallen)
    return pieces, cut_off


def assemble_result(
    setup: Setup,
    trimmed: Sequence[TrimmedObject],
    owner: LabelArray,
    decisions: Sequence[Decision],
    rest: Once[SceneWithoutObjects],
    contested: int,
    seconds: dict[str, float],
) -> TrimResult:
    """Put all in one result.

    Args:
        setup: what all objects have in common.
        trimmed: the objects.
        owner: number of the object that has each Gaussian of the scene, 0 for none, (N,).
        decisions: what belongs to each object.
        rest: the scene without them, once it is asked for.
        contested: number of Gaussians that several objects claimed.
        seconds: time taken by each stage.
    """
    share = np.zeros(len(setup.scene), np.float32)
    for decision in decisions:
        share[decision.considered] = np.maximum(share[decision.considered], decision.share)
    for number, decision in enumerate(decisions, 1):
        own = owner[decision.considered] == number
        share[decision.considered[own]] = decision.share[own]
    return TrimResult(
        scene=setup.scene,
        objects=tuple(trimmed),
        made_later=rest,
        share=share,
        contested=contested,
        config=setup.config,
        cameras=tuple(training_cameras(setup.cameras)),
        seconds=seconds,
    )


def assemble_rest(
    scene: Gaussians,
    assembled: Sequence[tuple[TrimmedObject, Pieces]],
    owner: LabelArray,
    changes: Sequence[tuple[IntArray, Removal] | None],
) -> SceneWithoutObjects:
    """Put the scene without the objects together.

    Args:
        scene: all N Gaussians.
        assembled: what `assemble_object` returns for each object.
        owner: number of the object that has each Gaussian of the scene, 0 for none, (N,).
        changes: what changes where each object was, and in which rows of the scene; None for those that were left as
            they were.
    """
    trimmed, cut_off = zip(*assembled, strict=True)
    outer, split = [pieces.gaussians for pieces in cut_off], [pieces.source for pieces in cut_off]
    discarded, selected = np.zeros(len(scene), np.bool_), np.zeros(len(scene), np.bool_)
    gain, warnings, not_filled = np.ones(len(scene), np.float32), dict[int, tuple[str, ...]](), dict[int, str]()
    for part, change in zip(trimmed, changes, strict=True):
        selected[part.selected_rows] = True
        if not change:
            continue
        rows, removal = change
        discarded[rows[removal.discarded | removal.replaced]] = True
        gain[rows] = np.maximum(gain[rows], removal.relight_factor)
        warnings[part.id] = removal.warnings
        if removal.not_filled:
            LOG.info("not filled: %s", removal.not_filled)
            not_filled[part.id] = removal.not_filled
    unowned = owner == 0
    discarded = unowned & (discarded | scene.blank)
    relit = np.flatnonzero(unowned & ~discarded & (gain > 1))
    whole = np.flatnonzero(unowned & ~discarded & (gain == 1))
    filled = concatenate([scene.select(slice(0)), *(change[1].inpainted for change in changes if change)])
    labels = [
        np.where(selected[whole], RowLabel.REMOVED, RowLabel.KEPT),
        np.full(sum(map(len, outer)), RowLabel.SPLIT_OUTSIDE),
        np.full(len(relit), RowLabel.RELIT),
        np.full(len(filled), RowLabel.FILLED),
    ]
    return SceneWithoutObjects(
        scene=scene,
        appended=concatenate([*outer, scale_radiance(scene.select(relit), gain[relit]), filled]),
        source=np.concatenate([whole, *split, relit, np.full(len(filled), -1, np.int64)]),
        label=np.concatenate(labels).astype(np.uint8),
        discarded=np.flatnonzero(discarded),
        warnings=warnings,
        not_filled=not_filled,
    )
