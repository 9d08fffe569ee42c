"""FlashSplat's `view_num_*_objnum_*.pth`: blend weights of every Gaussian, summed by the label of the pixel.

Row 0 is the background. The labels are assigned as in FlashSplat itself, see `label_assignment`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.selection_files.label_assignment import assign_labels
from gaussian_trimmer.selection_files.object_ids import select_ids
from gaussian_trimmer.selection_files.options import SelectionOptions
from gaussian_trimmer.selection_files.selection_file import SelectionFile

OPTIONS = frozenset({"object_id", "gamma"})
_LARGEST_WEIGHT = 1e30


def offers(file: SelectionFile, n: int, options: SelectionOptions) -> bool:
    """Whether the file holds two or more rows of n weights."""
    weights = _weights(file)
    return weights is not None and weights.shape[1] == n


def select(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """The Gaussians of the chosen objects, (N,); if there is only one object, it need not be chosen.

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
    if not (np.abs(weights) <= _LARGEST_WEIGHT).all():
        raise InputError(f"'{file.path.name}' holds weights that are NaN, infinite or huge; accumulate them again.")
    wanted = options.object_id or ((1,) if len(weights) == 2 else ())
    return select_ids(assign_labels(weights.T, options.gamma), wanted, file.path)


def _weights(file: SelectionFile) -> NDArray[Any] | None:
    if len(file.arrays) != 1:
        return None
    weights = next(iter(file.arrays.values()))
    return weights if weights.ndim == 2 and weights.dtype.kind == "f" and len(weights) >= 2 else None
