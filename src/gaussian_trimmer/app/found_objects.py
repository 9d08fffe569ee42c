"""Marks every object of a scene that is found without a click."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain, count

import numpy as np

from gaussian_trimmer.app.documents import Progress
from gaussian_trimmer.app.snapshots import PALETTE, MarkedObject, Snapshot, contrasting
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.finding.find import find_objects
from gaussian_trimmer.selecting.marks import Rows
from gaussian_trimmer.selecting.row_packing import pack_rows
from gaussian_trimmer.views import HALF


def with_found(now: Snapshot, number: int, progress: Progress) -> tuple[Snapshot, str]:
    """The state with an object for each that is found, and what was found, in a sentence.

    Objects that are marked already stay as they are, and keep their Gaussians; others make room. What the program is
    not sure of is left out.

    Args:
        now: the state before.
        number: from which on numbers of objects are free.
        progress: called with the name of each step when it begins.

    Raises:
        InputError: nothing is found that is sure and not marked yet, or hardly anything shows in the views.
    """
    document = now.document
    found = find_objects(
        document.scene, cameras=document.cameras, up=now.up.direction, renderer=document.renderer, progress=progress
    )
    kept, blank = ([part for part in now.objects if bool(part.marks) is marked] for marked in (True, False))
    taken = np.any([now.nothing().mask, *(part.after for part in kept)], axis=0)
    sure = list(found.selections().values())
    further = [mask & ~taken for mask in sure if (mask & taken).sum() <= HALF * mask.sum()]
    left_out = {"unsure": len(found) - len(sure), "marked already": len(sure) - len(further)}
    rest = ", ".join(f"{many} {why}" for why, many in left_out.items() if many)
    rest = f" Left out: {rest}." if rest else ""
    if not further:
        raise InputError(f"No further object was found; mark by clicks or boxes.{rest}")
    new = (MarkedObject(free, f"object {free}", PALETTE[0], now.nothing()) for free in count(number))
    after = replace(now, objects=tuple(kept), active=len(kept), last="find objects")
    for part, mask in zip(chain(blank, new), further, strict=False):
        mark = Rows(pack_rows(mask), "found")
        marked = part.marked((mark,), now.applied(now.nothing(), (mark,)))
        marked = replace(marked, colour=contrasting(after, mask), hidden=False)
        after = replace(after, objects=(*after.objects, marked))
    return after, f"Found {len(further)} object{'s' * (len(further) > 1)}; the tab 'Objects' lists them.{rest}"
