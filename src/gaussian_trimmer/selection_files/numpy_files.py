"""NumPy's .npy and .npz files of numbers; what would have to be unpickled is not read."""

from __future__ import annotations

from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.io.archives import open_archive

_MAX_NUMBER_BYTES = 8
_DAMAGE = (ValueError, TypeError, OverflowError, SyntaxError, TokenError, MemoryError, RecursionError, EOFError)
"""What NumPy raises for damaged arrays, and Python's parsers for their headers."""


def read_npy(path: Path) -> NDArray[Any]:
    """The array of numbers in an .npy file.

    Raises:
        InputError: the file cannot be read, is damaged, or holds something else than booleans or numbers.
    """
    try:
        with path.open("rb") as file:
            array: NDArray[Any] = np.lib.format.read_array(file)
    except _DAMAGE as error:
        raise InputError(
            f"'{path}' is damaged, or is not a NumPy array of numbers ({clip_name(str(error))}); save it again with "
            "NumPy."
        ) from error
    if not _is_number(array):
        raise InputError(f"'{path}' holds values of type {array.dtype.str:.20}; booleans or numbers are needed.")
    return array


def read_npz(path: Path, limit: int) -> dict[str, NDArray[Any]]:
    """The arrays of numbers in an .npz file by name; others, such as text, are left out.

    Args:
        path: the file.
        limit: bytes that all arrays may have together.

    Raises:
        InputError: the file cannot be read, is damaged, holds no numbers, or more than the limit.
    """
    arrays = {}
    with open_archive(path, "NumPy .npz archive of numbers") as archive:
        entries = [entry for entry in archive.infolist() if entry.filename.endswith(".npy")]
        if (size := sum(entry.file_size for entry in entries)) > limit:
            raise InputError(f"'{path}' holds arrays of {size} bytes, too many for a selection of this scene.")
        for entry in entries:
            with archive.open(entry) as file:
                try:
                    array = np.lib.format.read_array(file)
                except _DAMAGE:  # objects, which would have to be unpickled
                    continue
            if _is_number(array):
                arrays[entry.filename.removesuffix(".npy")] = array
    if not arrays:
        raise InputError(f"'{path}' holds no array of numbers.")
    return arrays


def _is_number(array: NDArray[Any]) -> bool:
    return array.dtype.kind in "biuf" and array.dtype.itemsize <= _MAX_NUMBER_BYTES
