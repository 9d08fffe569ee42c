"""NumPy's .npy and .npz files of numbers, whose sizes are known before any memory is taken."""

from __future__ import annotations

import io
import math
import zipfile
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.lib.format import read_array_header_1_0, read_array_header_2_0, read_magic
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.archives import check_packing, open_archive
from gaussian_trimmer.io.reading import file_bytes

_MAX_ARRAY_BYTES = 1 << 31
_MAX_ARRAYS = 1 << 10
_MAX_NUMBER_BYTES = 8
_DAMAGE = (ValueError, TypeError, OverflowError, SyntaxError, TokenError, MemoryError, RecursionError)
"""What NumPy raises for damaged arrays, and Python's parsers for their headers."""


def read_npy(path: Path) -> NDArray[Any]:
    """The array of numbers in an .npy file.

    Raises:
        InputError: the file cannot be read, is damaged, or holds something else than booleans or numbers.
    """
    array = _array(file_bytes(path, _MAX_ARRAY_BYTES), path)
    if not _is_number(array.dtype):
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
    with open_archive(path, "NumPy .npz archive of numbers") as archive:
        entries = [entry for entry in archive.infolist() if entry.filename.endswith(".npy")]
        if len(entries) > _MAX_ARRAYS:
            raise InputError(f"'{path}' holds {len(entries)} arrays; at most {_MAX_ARRAYS} can be read.")
        if (size := sum(entry.file_size for entry in entries)) > limit:
            raise InputError(f"'{path}' holds arrays of {size} bytes, too many for a selection of this scene.")
        found = {entry.filename.removesuffix(".npy"): _member(archive, entry, path) for entry in entries}
    arrays = {name: array for name, array in found.items() if _is_number(array.dtype)}
    if not arrays:
        raise InputError(f"'{path}' holds no array of numbers.")
    return arrays


def _member(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, path: Path) -> NDArray[Any]:
    check_packing(entry, path)
    with archive.open(entry) as file:
        return _array(file.read(entry.file_size), path)


def _array(data: bytes, path: Path) -> NDArray[Any]:
    """The array in the contents of an .npy file, a view of them; an empty one of a type that is no number."""
    file = io.BytesIO(data)
    try:
        wide = read_magic(file) != (1, 0)  # versions 2 and 3 differ in how they spell names of columns
        shape, in_columns, dtype = (read_array_header_2_0 if wide else read_array_header_1_0)(file)
        if not _is_number(dtype):
            return np.zeros(0, dtype)  # objects would have to be unpickled
        count = math.prod(shape)
        values = np.frombuffer(data, dtype, count, file.tell()) if count else np.zeros(0, dtype)
        array: NDArray[Any] = values.reshape(shape, order="F" if in_columns else "C")
    except _DAMAGE as error:
        raise InputError(f"'{path}' is damaged or no NumPy array of numbers; save it again with NumPy.") from error
    # A boolean that is neither 0 nor 1 would be counted as more than one.
    return array.view(np.uint8) != 0 if array.dtype == np.bool_ else array


def _is_number(dtype: np.dtype[Any]) -> bool:
    return dtype.kind in "biuf" and dtype.itemsize <= _MAX_NUMBER_BYTES
