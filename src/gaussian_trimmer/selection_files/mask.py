"""One yes or no a Gaussian: booleans, 0/1, 0/255, or scores with a threshold.

SAGA writes a boolean tensor `<name>.pt` (N,) or `final_mask.pt` (N, 1); SA3D-GS writes a boolean tensor (N, 1).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.selection_files.options import SelectionOptions, flag
from gaussian_trimmer.selection_files.selection_file import SelectionFile

OPTIONS = frozenset({"property", "threshold"})
_NAMES = ("mask", "masks", "selection")


def offers(file: SelectionFile, n: int, options: SelectionOptions) -> bool:
    """Whether the file holds booleans, scores, or integers of two values that can only be a mask of n Gaussians."""
    values = file.vector(options, *_NAMES)
    if values is None or values.dtype.kind not in "biuf":
        return False
    if values.dtype.kind in "bf":
        return True
    # Two-valued integers of another length are a mask of another scene, unless they may be the row numbers 0 and 1.
    return is_two_valued(values) and not options.object_id and (len(values) == n or len(values) > 2)


def select(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """The mask, (N,).

    Raises:
        InputError: there is no such array, its length is not N, or scores come without a threshold.
    """
    values = file.vector(options, *_NAMES)
    if values is None:
        raise InputError(f"'{file.path.name}' holds no one-dimensional array that could be a mask.")
    if len(values) != len(gaussians):
        raise InputError(
            f"The mask in '{file.path.name}' has {len(values)} entries, but the scene has {len(gaussians)} Gaussians; "
            "give the scene that the mask was made for."
        )
    if options.threshold is not None:
        return np.asarray(values > options.threshold)
    if values.dtype.kind == "b" or is_two_valued(values):
        return np.asarray(values != 0)
    raise InputError(
        f"'{file.path.name}' holds scores from {values.min():g} to {values.max():g}; choose with {flag('threshold')} "
        "above which a Gaussian is selected (0 takes the positive ones)."
    )


def is_two_valued(values: NDArray[Any]) -> bool:
    """Whether all values are 0 or 1, or all 0 or 255.

    >>> is_two_valued(np.array([0, 255, 0])), is_two_valued(np.array([0, 1, 255]))
    (True, False)
    """
    return bool(((values == 0) | (values == 1)).all() or ((values == 0) | (values == 255)).all())
