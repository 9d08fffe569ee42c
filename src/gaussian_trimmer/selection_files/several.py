"""Several objects from one file: the selection of each id, whatever kind of file holds them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians, mask_of_rows
from gaussian_trimmer.selection_files import SelectionOptions, load_selection, trimmed
from gaussian_trimmer.selection_files.array_kinds import LABEL_NAMES
from gaussian_trimmer.selection_files.object_ids import check_ids, count_ids
from gaussian_trimmer.selection_files.selection_file import open_selection

_MAX_OBJECTS = 10_000


def load_objects(
    path: str | Path, gaussians: Gaussians, ids: Sequence[int] = (), options: SelectionOptions | None = None
) -> dict[int, BoolArray]:
    """Return the selection (N,) of each object in a file, by its id.

    Args:
        path: one id a Gaussian in an array, `labels.npz` of a trim, or what a method with several objects saved.
        ids: the objects that are meant; without them all those with ids above zero.
        options: how the file is read, but for the ids.

    Raises:
        InputError: the file cannot be read, does not fit the scene, has not one of the ids, or must be told which.
    """
    path, options = Path(path), options or SelectionOptions()
    file = open_selection(path, len(gaussians))
    if trimmed.is_trimmed(file) and options.property is None:
        rows = trimmed.rows_of_objects(file, len(gaussians))
        if ids:
            check_ids(ids, list(rows), [len(found) for found in rows.values()], path)
        return {number: mask_of_rows(rows[number], len(gaussians)) for number in (ids or rows)}
    labels = file.vector(options, *LABEL_NAMES) if options.kind in ("auto", "labels") else None
    if labels is not None and labels.dtype.kind in "iu" and len(labels) == len(gaussians):
        present, counts = count_ids(labels)
        if ids:
            check_ids(ids, present, counts, path)
        wanted = list(ids) or [number for number in present if number > 0]
        if not wanted:
            raise InputError(f"'{path.name}' holds no object: no id is above zero, and 0 is the background.")
        if len(wanted) > _MAX_OBJECTS:
            raise InputError(f"'{path.name}' holds {len(wanted)} objects; choose at most {_MAX_OBJECTS} by their ids.")
        return {number: np.asarray(labels == number) for number in wanted}
    if not ids:
        load_selection(path, gaussians, options)  # says which ids there are, where the kind knows
        raise InputError(
            f"'{path.name}' is the selection of one object: give it without --labels, or name ids with --objects ID ..."
        )
    return {number: load_selection(path, gaussians, replace(options, object_id=(number,))) for number in ids}
