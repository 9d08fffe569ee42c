"""FlashSplat's `view_num_*_objnum_*.pth`: blend weights of every Gaussian summed by the label of the pixel.

Row 0 is the background. A Gaussian gets the label with the largest share of its weights, after a bias is added to the
background's: FlashSplat (ECCV 2024), section 3.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray
from gaussian_trimmer.selection_files.object_ids import select_ids
from gaussian_trimmer.selection_files.options import SelectionOptions
from gaussian_trimmer.selection_files.selection_file import SelectionFile

OPTIONS = frozenset({"object_id", "gamma"})
_ROWS_PER_CHUNK = 1 << 16


def offers(file: SelectionFile, n: int, options: SelectionOptions) -> bool:
    """Whether the file holds two or more rows of n weights."""
    weights = _weights(file)
    return weights is not None and weights.shape[1] == n


def select(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """The Gaussians of the chosen objects, (N,); where there is one object alone, it need not be chosen.

    Raises:
        InputError: there are no such weights for N Gaussians, or the objects are not chosen or have no Gaussians.
    """
    weights = _weights(file)
    if weights is None or weights.shape[1] != len(gaussians):
        shape = "" if weights is None else f" but {weights.shape}"
        raise InputError(
            f"'{file.path.name}' does not hold weights of shape (objects + 1, {len(gaussians)}){shape}; give the "
            "scene that they were accumulated on."
        )
    wanted = options.object_id or ((1,) if len(weights) == 2 else ())
    return select_ids(assign_labels(weights, options.gamma), wanted, file.path)


def assign_labels(weights: NDArray[Any], gamma: float) -> IntArray:
    """Label of every Gaussian, (N,), from accumulated weights (objects + 1, N) and the background's bias.

    Weights are normalised to length one over the labels. Gaussians that no view saw are background, whatever the bias.

    >>> assign_labels(np.array([[3.0, 1.0, 0.0], [1.0, 3.0, 0.0]]), gamma=-0.9).tolist()
    [1, 1, 0]
    """
    labels = np.zeros(weights.shape[1], np.int64)
    for start in range(0, len(labels), _ROWS_PER_CHUNK):
        chunk = np.array(weights[:, start : start + _ROWS_PER_CHUNK], np.float64)
        length = np.linalg.norm(chunk, axis=0)
        seen = length > 0
        chunk[:, seen] /= length[seen]
        chunk[0] += gamma
        labels[start : start + _ROWS_PER_CHUNK] = np.where(seen, np.argmax(chunk, axis=0), 0)
    return labels


def _weights(file: SelectionFile) -> NDArray[Any] | None:
    if len(file.arrays) != 1:
        return None
    weights = next(iter(file.arrays.values()))
    return weights if weights.ndim == 2 and weights.dtype.kind == "f" and len(weights) >= 2 else None
