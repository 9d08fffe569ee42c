"""The program's own `labels.npz`: which rows of the scene a trim gave to the object, or to each of several objects."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians, mask_of_rows
from gaussian_trimmer.selection_files.object_ids import check_ids
from gaussian_trimmer.selection_files.selection_file import SelectionFile, SelectionOptions

SOURCE, LABEL, OBJECTS = "source_index", "label", "n_object"
"""Arrays of every such file: scene row of each row of the objects and then of the background, what happened to it, and
the number of rows of all objects together."""
SELECTED = "selected"
"""Array of newer files of one object: the scene rows that were selected before the trim."""
IDS, ROWS, SCENE_SIZE = "object_ids", "object_rows", "n_scene"
"""Arrays that newer files have as well: ids of the objects, number of rows of each, and of Gaussians of the scene."""


def is_trimmed(file: SelectionFile) -> bool:
    """Return whether a file has the arrays that every trim writes."""
    return {SOURCE, LABEL, OBJECTS} <= file.arrays.keys()


def select_trimmed(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """Return the scene's Gaussians that the object has, whole or in part, (N,).

    Raises:
        InputError: as for `rows_of_objects`, or there are several objects and none is chosen, or not the one that is.
    """
    objects = rows_of_objects(file, len(gaussians))
    wanted = options.object_id
    if wanted or len(objects) > 1:
        check_ids(wanted, list(objects), [len(rows) for rows in objects.values()], file.path)
    rows = [rows for number, rows in objects.items() if not wanted or number in wanted]
    return mask_of_rows(np.concatenate(rows), len(gaussians))


def rows_of_objects(file: SelectionFile, n: int) -> dict[int, np.ndarray]:
    """Scene rows of each object by its id; a result of one object has the id 1.

    Args:
        file: the file.
        n: number of Gaussians of the scene.

    Raises:
        InputError: the file is not that of a trim, or is of another scene.
    """
    if not is_trimmed(file):
        raise InputError(f"'{file.path.name}' is not the labels.npz of a trim: it lacks some of its arrays.")
    source, count = file.arrays[SOURCE], file.arrays[OBJECTS].reshape(-1)
    ids, rows = file.arrays.get(IDS, np.array([1])), file.arrays.get(ROWS, count)
    size = int(file.arrays.get(SCENE_SIZE, np.array(n)).reshape(-1)[0])
    if (
        any(array.dtype.kind not in "iu" or array.ndim != 1 for array in (source, count, ids, rows))
        or ids.shape != rows.shape or (rows < 0).any() or rows.sum() > len(source)
    ):  # fmt: skip
        raise InputError(f"'{file.path.name}' is damaged: its arrays are not those of a trim.")
    of_objects, last = source[: rows.sum()], int(source.max(initial=-1))
    if size != n or of_objects.min(initial=0) < 0 or last >= n:
        raise InputError(
            f"'{file.path.name}' was made for another scene: it names rows up to {last} of {max(size, last + 1)}, and "
            f"this one has {n} Gaussians; give the scene that was trimmed."
        )
    parts = np.split(of_objects, np.cumsum(rows)[:-1])
    return {int(number): part for number, part in zip(ids, parts, strict=True)}


def selected_rows(file: SelectionFile, n: int) -> np.ndarray | None:
    """Scene rows that were selected before the trim; None if the file does not say.

    Args:
        file: the file.
        n: number of Gaussians of the scene.

    Raises:
        InputError: what the file says is damaged.
    """
    rows = file.arrays.get(SELECTED)
    if rows is not None and (rows.dtype.kind not in "iu" or rows.min(initial=0) < 0 or rows.max(initial=-1) >= n):
        raise InputError(f"'{file.path.name}' is damaged: its arrays are not those of a trim.")
    return rows
