"""Arrays of numbers in .npy, .npz, .txt, .csv and .json files; what would have to be unpickled is not read."""

from __future__ import annotations

import codecs
import json
import re
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.io.reading import file_bytes, open_archive

_MAX_NUMBER_BYTES = 8
_MAX_TEXT_BYTES = 1 << 27
_LARGEST_WHOLE = 2**53
_DAMAGE = (ValueError, TypeError, OverflowError, SyntaxError, TokenError, MemoryError, RecursionError, EOFError)
"""What NumPy raises for damaged arrays, and Python's parsers for their headers."""


def read_npy(path: Path) -> NDArray[Any]:
    """Return the array of numbers in an .npy file.

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
    """Return the arrays of numbers in an .npz file by name, of at most `limit` bytes together; others are left out.

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


def read_text(path: Path) -> NDArray[Any]:
    """Return the whole numbers in a text, between white space, commas and semicolons.

    What stands behind a '#' in its line is left out, and so is a first line of words, the header of a table.

    Raises:
        InputError: the file holds something else, such as a table of several columns.
    """
    text = re.sub(r"#.*", "", _text(path)).lstrip()
    header, _, rest = text.partition("\n")
    if header.lstrip("\"'")[:1].isalpha():
        if min(len(_words(header)), len(_words(rest.partition("\n")[0]))) > 1:
            raise InputError(
                f"'{path}' is a table of {len(_words(header))} columns; give the row numbers alone, one in each line."
            )
        text = rest
    try:
        return np.array([_whole(word) for word in _words(text)], np.int64)
    except (ValueError, OverflowError) as error:
        raise InputError(f"'{path}' is not a list of whole numbers: {clip_name(str(error))}.") from error


def read_json(path: Path) -> NDArray[Any]:
    """Return the whole numbers or booleans of a JSON list, or of the only list in a JSON object.

    Raises:
        InputError: the file holds something else.
    """
    try:
        value = json.loads(_text(path))
    except (ValueError, RecursionError) as error:
        raise InputError(f"'{path}' is not readable JSON: {clip_name(str(error))}.") from error
    if isinstance(value, dict):
        lists = [entry for entry in value.values() if isinstance(entry, list)]
        value = lists[0] if len(lists) == 1 else None
    kinds = {type(entry) for entry in value} if isinstance(value, list) else {None}
    if kinds == {bool}:
        return np.array(value, np.bool_)
    try:
        if kinds <= {bool, int, float}:
            return np.array([_whole(str(entry)) for entry in value], np.int64)
    except (ValueError, OverflowError):
        pass
    raise InputError(f"'{path}' is not a list of whole numbers or booleans; give row numbers as [0, 5, 7].")


def _is_number(array: NDArray[Any]) -> bool:
    return array.dtype.kind in "biuf" and array.dtype.itemsize <= _MAX_NUMBER_BYTES


def _text(path: Path) -> str:
    """Return text in UTF-8, or in UTF-16 as Windows' shell writes it."""
    data = file_bytes(path, _MAX_TEXT_BYTES)
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        return data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"'{path}' is not a list of whole numbers, or its text is damaged.") from error


def _words(text: str) -> list[str]:
    return text.replace(",", " ").replace(";", " ").split()


def _whole(word: str) -> int:
    """Return the whole number that a word says, also as 9.0 or 9e3; ValueError if it says none."""
    try:
        return int(word)
    except ValueError:
        value = float(word)
        if not abs(value) < _LARGEST_WHOLE or value != int(value):
            raise
        return int(value)
