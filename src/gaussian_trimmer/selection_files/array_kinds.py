"""Selections in arrays: masks, labels, row numbers, and the weights that FlashSplat saves."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians, mask_of_rows
from gaussian_trimmer.selection_files.label_assignment import assign_labels
from gaussian_trimmer.selection_files.object_ids import select_ids
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
_LARGEST_WEIGHT = 1e30


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


def select_flashsplat(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """Return the Gaussians of the chosen objects, (N,); if there is only one object, it need not be chosen.

    FlashSplat's `view_num_*_objnum_*.pth` holds the blend weights of every Gaussian, summed by the label of the pixel;
    row 0 is the background.

    Raises:
        InputError: there are no such weights for N Gaussians, or the objects are not chosen or have no Gaussians.
    """
    weights = flashsplat_weights(file)
    if weights is None or weights.shape[1] != len(gaussians):
        shape = "" if weights is None else f" but {weights.shape}"
        raise InputError(
            f"'{file.path.name}' does not hold weights of shape (objects + 1, {len(gaussians)}){shape}; give the "
            "scene that they were accumulated on."
        )
    if not (np.abs(weights) <= _LARGEST_WEIGHT).all():
        raise InputError(f"'{file.path.name}' holds weights that are NaN, infinite or huge; accumulate them again.")
    wanted = options.object_id or ((1,) if len(weights) == 2 else ())
    return select_ids(assign_labels(weights.T, options.gamma), wanted, file.path)


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


def flashsplat_weights(file: SelectionFile) -> NDArray[Any] | None:
    """Return the weights (L, M) that FlashSplat saves, if the file holds such an array."""
    if len(file.arrays) != 1:
        return None
    weights = next(iter(file.arrays.values()))
    return weights if weights.ndim == 2 and weights.dtype.kind == "f" and len(weights) >= 2 else None
