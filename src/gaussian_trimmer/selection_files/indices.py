"""A list of row numbers, from 0: .txt, .csv or integers in an array that are not one a Gaussian."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.selection_files.mask import is_two_valued
from gaussian_trimmer.selection_files.options import SelectionOptions
from gaussian_trimmer.selection_files.selection_file import SelectionFile

OPTIONS = frozenset({"property"})
_NAMES = ("indices", "index", "rows")
_DISTINCT = 0.5
"""Share of the numbers of a list that must be different; else they are labels of some other scene."""


def offers(file: SelectionFile, n: int, options: SelectionOptions) -> bool:
    """Whether the file holds integers whose number is not n, and which are no two-valued mask."""
    rows = file.vector(options, *_NAMES)
    if rows is None or rows.dtype.kind not in "iu" or (len(rows) == n and not file.is_list):
        return False
    return not is_two_valued(rows) or len(rows) <= 2


def select(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """The listed rows as a mask, (N,).

    Raises:
        InputError: there is no such array, or it names a row twice or one that the scene does not have.
    """
    rows, n = file.vector(options, *_NAMES), len(gaussians)
    if rows is None or rows.dtype.kind not in "iu":
        raise InputError(f"'{file.path.name}' holds no one-dimensional array of integers that could be row numbers.")
    distinct = len(np.unique(rows))
    if file.is_list and len(rows) > distinct >= _DISTINCT * len(rows):
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
    mask = np.zeros(n, bool)
    mask[rows] = True
    return mask
