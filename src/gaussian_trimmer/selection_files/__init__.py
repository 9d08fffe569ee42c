"""Selections of one object, from any tool or method: which rows of the scene are the object.

The container of a file is told by its ending, what it means by its content.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.selection_files import array_kinds, feature_kinds, splat_kinds, trimmed
from gaussian_trimmer.selection_files.options import Kind, SelectionOptions, flag
from gaussian_trimmer.selection_files.selection_file import SelectionFile, open_selection
from gaussian_trimmer.settings import check_settings

__all__ = ["KINDS", "Kind", "SelectionKind", "SelectionOptions", "load_selection", "offered_kinds"]

_LISTED_ARRAYS = 12


@dataclass(frozen=True)
class SelectionKind:
    """What a selection file may mean."""

    offers: Callable[[SelectionFile, int, SelectionOptions], bool]
    """Whether a file can be of this kind for a scene of so many Gaussians."""
    select: Callable[[SelectionFile, Gaussians, SelectionOptions], BoolArray]
    """The selection, (N,)."""
    options: tuple[str, ...] = ()
    """Names of the options that the kind understands."""


KINDS = {
    "mask": SelectionKind(array_kinds.offers_mask, array_kinds.select_mask, ("property", "threshold")),
    "labels": SelectionKind(array_kinds.offers_labels, array_kinds.select_labels, ("object_id", "property")),
    "indices": SelectionKind(array_kinds.offers_indices, array_kinds.select_indices, ("property",)),
    "subset": SelectionKind(splat_kinds.offers_subset, splat_kinds.select_subset),
    "property": SelectionKind(
        splat_kinds.offers_property, splat_kinds.select_property, ("property", "threshold", "object_id")
    ),
    "classifier": SelectionKind(
        feature_kinds.offers_classifier, feature_kinds.select_classifier, ("classifier", "object_id", "threshold")
    ),
    "similarity": SelectionKind(
        feature_kinds.offers_similarity, feature_kinds.select_similarity, ("query_row", "threshold")
    ),
    "checkpoint": SelectionKind(feature_kinds.offers_checkpoint, feature_kinds.select_checkpoint, ("threshold",)),
    "flashsplat": SelectionKind(array_kinds.offers_flashsplat, array_kinds.select_flashsplat, ("object_id", "gamma")),
    "trimmed": SelectionKind(trimmed.offers_trimmed, trimmed.select_trimmed, ("object_id",)),
}


@np.errstate(over="ignore", invalid="ignore")  # what damaged numbers become is found where they are used
def load_selection(
    path: str | Path,
    gaussians: Gaussians,
    options: SelectionOptions | None = None,
    say: Callable[[str], None] = lambda note: None,
) -> BoolArray:
    """Which Gaussians of the scene a selection file means, (N,); at least one.

    Args:
        path: the file.
        gaussians: the scene.
        options: how the file is read.
        say: called with what a user should know of how the file was understood, such as rows that matched nothing.

    Raises:
        InputError: an option is not possible, or the file cannot be read, does not fit the scene or the options, could
            be of several kinds, or selects nothing.
    """
    path, options = Path(path), options or SelectionOptions()
    check_settings(options, "selection")
    file = open_selection(path, len(gaussians))
    name = options.kind if options.kind != "auto" else _detect(file, len(gaussians), options)
    if unused := sorted(options.given() - set(KINDS[name].options)):
        raise InputError(
            f"'{path.name}' is read as a selection of the kind '{name}', which has no use for "
            f"{', '.join(map(flag, unused))}; leave that out or choose another kind with {flag('kind')}."
        )
    selection = KINDS[name].select(file, gaussians, options)
    for note in file.notes:
        say(f"{path.name}: {note}")
    if not selection.any():
        raise InputError(f"'{path.name}', read as the kind '{name}', selects none of the {len(gaussians)} Gaussians.")
    return selection


def offered_kinds(file: SelectionFile, n: int, options: SelectionOptions) -> list[str]:
    """The kinds that a file can be of, for a scene of n Gaussians; what the program wrote is that and nothing else."""
    offered = [name for name, kind in KINDS.items() if kind.offers(file, n, options)]
    return ["trimmed"] if "trimmed" in offered else offered


def _detect(file: SelectionFile, n: int, options: SelectionOptions) -> str:
    kinds = offered_kinds(file, n, options)
    if len(kinds) > 1:
        raise InputError(
            f"'{file.path.name}' can be read as {' or as '.join(kinds)}; say which with {flag('kind')} {kinds[0]}."
        )
    if not kinds:
        raise InputError(f"'{file.path.name}' {_content(file)} is no selection for {n} Gaussians with these options.")
    return kinds[0]


def _content(file: SelectionFile) -> str:
    if not file.arrays:
        return "with splats" if file.rows is not None else "with a checkpoint"
    listed = list(file.arrays.items())[:_LISTED_ARRAYS]
    arrays = [f"{shown(name) or 'one'}: {array.dtype} {array.shape}" for name, array in listed]
    more = f"; and {len(file.arrays) - _LISTED_ARRAYS} more" if len(file.arrays) > _LISTED_ARRAYS else ""
    return f"with the arrays ({'; '.join(arrays)}{more})"
