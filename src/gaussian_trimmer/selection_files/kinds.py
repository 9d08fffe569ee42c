"""Selections in arrays and splat files: masks, labels, row numbers, rows cut out of the scene, results of a trim.

Editors such as SuperSplat, and the interfaces of OmniSeg3D-GS and others, save the object's rows as they are. SAGD
also saves `point_cloud_seg_gd.ply`, in which boundary Gaussians have been moved and shrunk. Compressed formats round,
and the program's own objects have children of split Gaussians: such rows are matched with what is nearest. SA3D-GS
writes `seg_point_cloud.ply`, some rows of the scene with a float property `mask` that is positive on the object. The
program's own `labels.npz` says which rows of the scene a trim gave to each object.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.gaussians import BoolArray, Gaussians, mask_of_rows
from gaussian_trimmer.selection_files.row_matching import attributes_of, match_changed_rows
from gaussian_trimmer.selection_files.selection_file import SelectionFile, SelectionOptions, flag

CLUSTERS = "leaf_ind"
"""OpenGaussian's array of cluster ids, beside others in `cluster_lang.npz`."""
LABEL_NAMES = ("labels", "label", "ids", "instance", "instances", CLUSTERS)
MASK_NAMES = ("mask", "masks", "selection")
INDEX_NAMES = ("indices", "index", "rows")
REMOVED = "remove_source.pt"
"""GaussianCut's mask of what is not the object."""
LOGITS = re.compile(r"seg_point_cloud_\d+\.npy")
"""SA3D-GS's scores, which are positive on the object."""
_LEAST_DISTINCT = 0.5
"""Share of the numbers of a list that must be different; else they are labels of some other scene."""
MASK = "mask"
"""The property that SA3D-GS adds."""
_LARGEST_ID = 2**53
SOURCE, IDS, ROWS, SCENE_SIZE = "source_index", "object_ids", "object_rows", "n_scene"
"""Arrays of every result of a trim: scene row of each row of the objects and then of the background, the objects' ids,
number of rows of each, and of Gaussians of the scene."""
SELECTED = "selected"
"""Array of a result of one object: the scene rows that were selected before the trim."""
_LISTED = 24
_LISTED_IN_MESSAGES = 8


def is_two_valued(values: NDArray[Any]) -> bool:
    """Return whether all values are 0 or 1, or all 0 or 255.

    >>> is_two_valued(np.array([0, 255, 0])), is_two_valued(np.array([0, 1, 255]))
    (True, False)
    """
    return bool(((values == 0) | (values == 1)).all() or ((values == 0) | (values == 255)).all())


def select_mask(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """Return the mask, (N,): booleans, 0/1, 0/255, or scores above the threshold.

    Raises:
        InputError: there is no such array, its length is not N, or scores come without a threshold.
    """
    values = _one_each(file, file.vector(options, *MASK_NAMES), gaussians, "mask")
    if options.threshold is not None:
        return np.asarray(values > options.threshold)
    if file.path.name == REMOVED and is_two_valued(values):
        file.notes.append("GaussianCut's mask of the background; the rest is the object")
        return np.asarray(values == 0)
    if LOGITS.fullmatch(file.path.name) and not is_two_valued(values):
        file.notes.append("SA3D-GS's scores, above 0 on the object")
        return np.asarray(values > 0)
    if is_two_valued(values):
        return np.asarray(values != 0)
    raise InputError(
        f"'{file.path.name}' holds scores from {values.min():g} to {values.max():g}; choose with {flag('threshold')} "
        "above which a Gaussian is selected (0 takes the positive ones)."
    )


def select_labels(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """Return the Gaussians of the chosen ids, (N,).

    Raises:
        InputError: there is no such array, its length is not N, or the ids are not chosen or do not occur.
    """
    labels = _one_each(file, file.vector(options, *LABEL_NAMES), gaussians, "array of labels")
    return select_ids(labels, options.object_id, file.path)


def select_indices(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """Return the rows whose numbers, from 0, are listed, (N,).

    Raises:
        InputError: there is no such array, or it names a row twice or one that the scene does not have.
    """
    rows, n = file.vector(options, *INDEX_NAMES), len(gaussians)
    if rows is None or rows.dtype.kind not in "iu":
        raise InputError(f"'{file.path.name}' holds no one-dimensional array of integers that could be row numbers.")
    if not rows.size:
        raise InputError(f"'{file.path.name}' holds no number; give the numbers of the selected rows, from 0.")
    distinct = len(np.unique(rows))
    if file.is_list and len(rows) > distinct >= _LEAST_DISTINCT * len(rows):
        file.notes.append(f"{len(rows) - distinct} of {len(rows)} numbers stand there more than once")
    elif distinct < len(rows):
        raise InputError(
            f"'{file.path.name}' holds {len(rows)} integers, some of them equal, for a scene of {n} Gaussians: a list "
            "of row numbers names each row once, and labels or a mask have one entry a Gaussian."
        )
    if len(rows) and (rows.min() < 0 or rows.max() >= n):
        wrong = rows.min() if rows.min() < 0 else rows.max()
        raise InputError(
            f"'{file.path.name}' lists row {wrong}, but the scene's {n} Gaussians have the row numbers 0 to {n - 1}."
        )
    return mask_of_rows(rows, n)


def _one_each(file: SelectionFile, values: NDArray[Any] | None, gaussians: Gaussians, what: str) -> NDArray[Any]:
    """Return the values, if they are one for each Gaussian of the scene."""
    if values is None:
        raise InputError(f"'{file.path.name}' holds no one-dimensional array that could be a {what}.")
    if len(values) != len(gaussians):
        raise InputError(
            f"The {what} in '{file.path.name}' has {len(values)} entries, but the scene has {len(gaussians)} Gaussians;"
            " give the scene that it was made for."
        )
    return values


def select_subset(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """Return the scene rows that the file holds, (N,).

    Raises:
        InputError: the file holds no splats, as many as the scene or more, or mostly rows that are not in the scene.
    """
    if file.columns is None:
        raise InputError(f"'{file.path.name}' holds no splats.")
    if (n := len(file.columns["x"])) >= len(gaussians):
        hint = f"{flag('classifier')} or {flag('query_row')}" if file.has_features else flag("property")
        raise InputError(
            f"'{file.path.name}' holds {n} Gaussians and the scene {len(gaussians)}, so it is not a part "
            f"of the scene; to select by what its Gaussians carry, use {hint}."
        )
    found, notes = match_changed_rows(attributes_of(file.columns), gaussians, file.path)
    file.notes.extend(notes)
    return mask_of_rows(found[found >= 0], len(gaussians))


def select_property(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """Return the scene rows whose property is above the threshold (default 0), or one of the chosen ids, (N,).

    Raises:
        InputError: the file has no such property, rows that are not the scene's, or no Gaussians of an id.
    """
    if file.columns is None:
        raise InputError(f"'{file.path.name}' holds no splats, so it has no properties.")
    name = options.property or MASK
    if name not in file.columns:
        raise InputError(
            f"'{file.path.name}' has no property '{clip_name(name)}'; choose with {flag('property')} among: "
            f"{list_names(file.columns)}."
        )
    values = np.asarray(file.columns[name])
    if options.object_id:
        if not ((values == np.rint(values)) & (np.abs(values) <= _LARGEST_ID)).all():
            raise InputError(
                f"The property '{name}' of '{file.path.name}' is not an id: it has values that are not whole, or huge; "
                f"use {flag('threshold')} instead of {flag('object_id')}."
            )
        chosen = select_ids(values.astype(np.int64), options.object_id, file.path)
    else:
        chosen = values > (options.threshold or 0.0)
    return mask_of_rows(file.scene_rows(gaussians)[chosen], len(gaussians))


def is_trimmed(file: SelectionFile) -> bool:
    """Return whether a file has the arrays that every trim writes."""
    return {SOURCE, IDS, ROWS, SCENE_SIZE} <= file.arrays.keys()


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
    """Return the scene rows of each object by its id.

    Args:
        file: the file.
        n: number of Gaussians of the scene.

    Raises:
        InputError: the file is not that of a trim, or is of another scene.
    """
    if not is_trimmed(file):
        raise InputError(f"'{file.path.name}' is not the labels.npz of a trim: it lacks some of its arrays.")
    source, ids, rows, size = (file.arrays[name].reshape(-1) for name in (SOURCE, IDS, ROWS, SCENE_SIZE))
    if any(array.dtype.kind not in "iu" for array in (source, ids, rows, size)) or not (
        len(size) == 1 and len(ids) == len(rows) and (rows >= 0).all() and rows.sum() <= len(source)
    ):
        raise InputError(f"'{file.path.name}' is damaged: its arrays are not those of a trim.")
    of_objects = source[: rows.sum()]
    if size[0] != n or of_objects.min(initial=0) < 0 or source.max(initial=-1) >= n:
        raise InputError(
            f"'{file.path.name}' was made for another scene, of {size[0]} Gaussians, and this one has {n}; give the "
            "scene that was trimmed."
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


def list_ids(ids: Sequence[int], counts: Sequence[int], most: int = _LISTED) -> str:
    """Return ids with their numbers of Gaussians; if there are many, those with most of them, in this order.

    >>> list_ids([0, 3], [10, 90])
    '0 (10), 3 (90)'
    >>> list_ids([1, 2, 3], [5, 10, 90], most=2)
    '3 (90), 2 (10) and 1 more, with fewer'
    """
    listed = range(len(ids)) if len(ids) <= most else sorted(range(len(ids)), key=lambda i: -counts[i])[:most]
    left_out = f" and {len(ids) - most} more, with fewer" if len(ids) > most else ""
    return ", ".join(f"{ids[i]} ({counts[i]})" for i in listed) + left_out


def list_names(names: Iterable[str]) -> str:
    """Names of columns from a file, the first ones if there are many; runs that differ in their last number are one.

    >>> list_names(["mask", "obj_dc_0", "obj_dc_1", "obj_dc_2"])
    'mask, obj_dc_0 to obj_dc_2'
    """
    runs: dict[str, list[str]] = {}
    for name in names:
        runs.setdefault(re.sub(r"\d+$", "#", name), []).append(name)
    listed = [
        clip_name(run[0]) if len(run) == 1 else f"{clip_name(run[0])} to {clip_name(run[-1])}" for run in runs.values()
    ]
    left_out = f" and {len(listed) - _LISTED} more" if len(listed) > _LISTED else ""
    return ", ".join(listed[:_LISTED]) + left_out


def count_ids(labels: NDArray[Any]) -> tuple[list[int], list[int]]:
    """Return the ids among labels (N,) and how many entries have each."""
    ids, counts = np.unique(labels, return_counts=True)
    return ids.tolist(), counts.tolist()


def select_ids(labels: NDArray[Any], wanted: Sequence[int], path: Path) -> BoolArray:
    """Return which labels (M,) are among the wanted ids.

    Raises:
        InputError: no id is wanted, or one does not occur.
    """
    check_ids(wanted, *count_ids(labels), path)
    return np.isin(labels, wanted)


def check_ids(wanted: Sequence[int], ids: Sequence[int], counts: Sequence[int], path: Path) -> None:
    """Refuse a choice of nothing, or of ids that no Gaussian has; the message lists the objects that there are.

    Raises:
        InputError: no id is wanted, or one does not occur.
    """
    present = {i: count for i, count in zip(ids, counts, strict=True) if count}
    objects = {i: n for i, n in present.items() if i > 0 or len(present) <= _LISTED_IN_MESSAGES}  # 0 is mostly none
    listing = list_ids(list(objects), list(objects.values()), _LISTED_IN_MESSAGES) or "none"
    if not wanted:
        raise InputError(
            f"'{path.name}' holds several objects; choose with {flag('object_id')}, or trim several with --labels, "
            f"among these ids (Gaussians): {listing}."
        )
    if absent := sorted(set(wanted) - present.keys()):
        raise InputError(
            f"'{path.name}' has no Gaussians of object {', '.join(map(str, absent))}; its ids (Gaussians): {listing}."
        )
