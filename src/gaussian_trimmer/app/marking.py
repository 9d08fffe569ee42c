"""What a mark makes of a state: what may change, what did, and which marks are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gaussian_trimmer.app.snapshots import PALETTE, Snapshot, contrasting
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.geometry.neighbours import nearest
from gaussian_trimmer.selecting.interpretation import INTERPRETATIONS, SelectionState
from gaussian_trimmer.selecting.marks import Effect, Mark, Rows
from gaussian_trimmer.selecting.row_packing import pack_rows

_GAP_SHARE = 0.1
"""Gap between a selection and what a click adds at its boundary, at most, relative to the selection's diagonal."""


def after_marks(now: Snapshot, marks: tuple[Mark, ...], among: BoolArray | None) -> tuple[Snapshot, str]:
    """The state after further marks of the active object, and what they changed, in a sentence.

    Args:
        now: the state before.
        marks: what to select, in order.
        among: Gaussians that may change, (N,); all that no other object hides or has locked if they are not given.

    Raises:
        InputError: a mark is not possible, it changes nothing, or after it nothing is selected.
    """
    before = now.object
    selected = now.applied(before.selected, marks)
    way = selected.interpretations[-1]
    added = selected.mask & ~before.selected.mask
    strays = way == INTERPRETATIONS["region"] and added.any() and before.n_selected > 0
    if strays and not touches(now.document.scene.means, before.selected.mask, added):
        raise InputError("What you clicked on does not touch the object, so it was not added; draw over it to add it.")
    kept = now.locked if among is None else now.locked | ~among
    undone: tuple[tuple[Effect, BoolArray], ...] = (
        ("remove", added & kept),
        ("add", before.selected.mask & ~selected.mask & kept),
    )
    for effect, rows in undone:
        if rows.any():
            marks = (*marks, Rows(pack_rows(rows), "what is not shown stays", effect))
            selected = now.applied(selected, marks[-1:])
    if not selected.mask.any():
        raise InputError("After this mark nothing would be selected, so it was not made. To start over, clear.")
    change = _change(before.selected, selected)
    if not change:
        raise InputError(f"This mark changes nothing that is shown, so it was not made: {way}.")
    marked = before.marked(before.marks + marks, selected, further=True)
    if not before.marks and before.colour in PALETTE:
        marked = replace(marked, colour=contrasting(now, selected.mask))
    return now.with_object(marked, f"mark ({way})"), f"{change} {way}. {marked.n_selected:,} Gaussians selected."


def touches(means: FloatArray, selected: BoolArray, added: BoolArray) -> bool:
    """Whether some Gaussians lie beside a selection, (N,) each, and not far from it in the scene."""
    size = float(np.linalg.norm(np.ptp(means[selected], axis=0)))
    squared, _ = nearest(means[selected], means[added], 1)
    return float(np.sqrt(squared.min())) <= _GAP_SHARE * size


def _change(before: SelectionState, after: SelectionState) -> str:
    """What a mark changed, in a sentence; empty if nothing."""
    added, removed = (int(np.count_nonzero(part)) for part in (after.mask & ~before.mask, before.mask & ~after.mask))
    if added and removed:
        return f"Added {added:,} and removed {removed:,}:"
    if added or removed:
        return f"Added {added:,}:" if added else f"Removed {removed:,}:"
    kept_out = int(np.count_nonzero(after.excluded & ~before.excluded))
    return f"Removed nothing that is selected; the trim will leave out {kept_out:,}:" if kept_out else ""
