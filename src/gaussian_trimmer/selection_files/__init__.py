"""Selections of one object, from any tool or method: which rows of the scene are the object.

The container of a file is told by its ending, what it means by its content, the scene's size and the options.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray
from gaussian_trimmer.selection_files import kinds, method_kinds
from gaussian_trimmer.selection_files.kinds import check_ids, count_ids
from gaussian_trimmer.selection_files.selection_file import Kind, SelectionFile, SelectionOptions, flag, open_selection
from gaussian_trimmer.settings import check_settings

__all__ = ["KINDS", "Kind", "SelectionOptions", "arrays_that_select", "load_objects", "load_selection", "offered_kinds"]


Select = Callable[[SelectionFile, Gaussians, SelectionOptions], BoolArray]

KINDS: dict[str, tuple[Select, tuple[str, ...]]] = {
    "mask": (kinds.select_mask, ("property", "threshold")),
    "labels": (kinds.select_labels, ("object_id", "property")),
    "indices": (kinds.select_indices, ("property",)),
    "subset": (kinds.select_subset, ()),
    "property": (kinds.select_property, ("property", "threshold", "object_id")),
    "classifier": (method_kinds.select_classifier, ("classifier", "object_id", "threshold")),
    "similarity": (method_kinds.select_similarity, ("query_row", "threshold")),
    "checkpoint": (method_kinds.select_checkpoint, ("threshold",)),
    "flashsplat": (method_kinds.select_flashsplat, ("object_id", "gamma")),
    "trimmed": (kinds.select_trimmed, ("object_id",)),
}
"""Kind -> the function that finds the selection (N,), and names of the options that it understands."""


@np.errstate(over="ignore", invalid="ignore")  # what damaged numbers become is found where they are used
def load_selection(
    path: str | Path,
    gaussians: Gaussians,
    options: SelectionOptions | None = None,
    say: Callable[[str], None] = lambda note: None,
) -> BoolArray:
    """Return which Gaussians of the scene a selection file means, (N,); at least one.

    Args:
        path: the file, or a folder in which a method left one.
        gaussians: the scene.
        options: how the file is read.
        say: called with what a user should know of how the file was understood, such as rows that matched nothing.

    Raises:
        InputError: an option is not possible, or the file cannot be read, does not fit the scene or the options, could
            be of several kinds, or selects nothing.
    """
    path, options = Path(path), options or SelectionOptions()
    check_settings(options, "selection")
    given, path = path, identify(path).selection
    if path != given:
        say(f"selection: {path}")
    file = open_selection(path, len(gaussians))
    name = options.kind if options.kind != "auto" else _detect(file, len(gaussians), options)
    select, understood = KINDS[name]
    if unused := sorted(options.given() - set(understood)):
        raise InputError(
            f"'{path.name}' is read as a selection of the kind '{name}', which does not use "
            f"{', '.join(map(flag, unused))}; leave that out or choose another kind with {flag('kind')}."
        )
    selection = select(file, gaussians, options)
    for note in file.notes:
        say(f"{path.name}: {note}")
    if not selection.any():
        raise InputError(
            f"'{path.name}', read as the kind '{name}', selects none of the {len(gaussians)} Gaussians; check that it "
            f"was made for this scene, or choose another kind with {flag('kind')}."
        )
    return selection


def load_objects(
    path: str | Path, gaussians: Gaussians, ids: Sequence[int] = (), options: SelectionOptions | None = None
) -> IntArray:
    """Return the id of the object that each Gaussian belongs to by a file, (N,), 0 for none.

    Args:
        path: one id a Gaussian in an array, `labels.npz` of a trim, or what a method with several objects saved.
        gaussians: the scene.
        ids: the objects that are meant; without them all those with ids above zero. What several of them have is the
            first one's.
        options: how the file is read, but for the ids.

    Raises:
        InputError: the file cannot be read, does not fit the scene, has not one of the ids, or must be told which.
    """
    path, options, n = Path(path), options or SelectionOptions(), len(gaussians)
    if wrong := [number for number in ids if number < 1]:
        raise InputError(f"There is no object {wrong[0]}: ids of objects begin at 1, and 0 is the background.")
    file, labels = open_selection(path, n), np.zeros(n, np.int64)
    if kinds.is_trimmed(file) and options.property is None:
        rows = kinds.rows_of_objects(file, n)
        if ids:
            check_ids(ids, list(rows), [len(found) for found in rows.values()], path)
        for number in reversed(list(ids or rows)):
            labels[rows[number]] = number
        return labels
    given = file.vector(options, *kinds.LABEL_NAMES) if options.kind in ("auto", "labels") else None
    if given is not None and given.dtype.kind in "iu" and len(given) == n:
        if ids:
            check_ids(ids, *count_ids(given), path)
        labels = np.where(np.isin(given, ids) if len(ids) else given > 0, given, 0).astype(np.int64)
        if not labels.any():
            raise InputError(f"'{path.name}' holds no object: no id is above zero, and 0 is the background.")
        return labels
    if not ids:
        load_selection(path, gaussians, options)  # says which ids there are, where the kind knows
        raise InputError(
            f"'{path.name}' is the selection of one object: give it without --labels, or name ids with --objects ID ..."
        )
    for number in reversed(ids):
        labels[load_selection(path, gaussians, replace(options, object_id=(number,)))] = number
    return labels


def arrays_that_select(file: SelectionFile, n: int, options: SelectionOptions) -> list[str]:
    """Return the names of the arrays of a file that select from a scene of n Gaussians once they are named."""
    return [name for name in file.arrays if name and offered_kinds(file, n, replace(options, property=name))]


def _detect(file: SelectionFile, n: int, options: SelectionOptions) -> str:
    offered = offered_kinds(file, n, options)
    if len(offered) > 1:
        raise InputError(
            f"'{file.path.name}' can be read as {' or as '.join(offered)}; say which with {flag('kind', offered[0])}."
        )
    if not offered:
        names = arrays_that_select(file, n, options)
        choose = f"; name an array, such as {flag('property', names[0])}" if names else ""
        raise InputError(
            f"'{file.path.name}' holds {file.content}, which does not select from {n} Gaussians: that takes {n} "
            f"booleans, scores or ids, or numbers of rows{choose}."
        )
    return offered[0]


def offered_kinds(file: SelectionFile, n: int, options: SelectionOptions) -> list[str]:
    """The kinds that a file can be of, for a scene of n Gaussians; what the program wrote is that and nothing else."""
    if kinds.is_trimmed(file) and options.property is None:
        return ["trimmed"]
    by_features = options.classifier is not None or options.query_row is not None
    with_mask = file.columns is not None and kinds.MASK in file.columns
    weights = method_kinds.flashsplat_weights(file)
    offered = {
        "mask": _may_be_mask(file.vector(options, *kinds.MASK_NAMES), n, options),
        "labels": _may_be_labels(file, n, options),
        "indices": _may_be_indices(file.vector(options, *kinds.INDEX_NAMES), n, file.is_list),
        "subset": file.columns is not None and not (by_features or options.property is not None or with_mask),
        "property": file.columns is not None and not by_features and (options.property is not None or with_mask),
        "classifier": method_kinds.classifier_of(file) is not None
        or (file.has_features and options.classifier is not None),
        "similarity": file.has_features and options.query_row is not None,
        "checkpoint": file.checkpoint is not None and not by_features,
        "flashsplat": weights is not None and weights.shape[1] == n,
    }
    return [name for name, possible in offered.items() if possible]


def _may_be_mask(values: NDArray[Any] | None, n: int, options: SelectionOptions) -> bool:
    """Booleans, scores, or integers of two values that can only be a mask."""
    if values is None or values.dtype.kind in "bf":
        return values is not None
    # Two-valued integers of another length are a mask of another scene, unless they may be the row numbers 0 and 1.
    return kinds.is_two_valued(values) and not options.object_id and (len(values) == n or len(values) > 2)


def _may_be_labels(file: SelectionFile, n: int, options: SelectionOptions) -> bool:
    """OpenGaussian's clusters, or N integers that are more than a mask, or of which an id is asked for."""
    values = file.vector(options, *kinds.LABEL_NAMES)
    if values is None or len(values) != n or kinds.CLUSTERS in file.arrays:
        return values is not None and len(values) == n
    return values.dtype.kind in "iu" and (bool(options.object_id) or not kinds.is_two_valued(values))


def _may_be_indices(values: NDArray[Any] | None, n: int, is_list: bool) -> bool:
    """Integers whose number is not N, and which are not a two-valued mask."""
    if values is None or values.dtype.kind not in "iu" or (len(values) == n and not is_list):
        return False
    return not kinds.is_two_valued(values) or len(values) <= 2
