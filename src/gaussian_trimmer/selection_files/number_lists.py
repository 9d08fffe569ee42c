"""Lists of whole numbers that somebody wrote: .txt, .csv and .json."""

from __future__ import annotations

import codecs
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.io.reading import file_bytes

_MAX_BYTES = 1 << 27
_LARGEST_WHOLE = 2**53


def read_numbers(path: Path) -> NDArray[Any]:
    """The whole numbers in a text, between white space, commas and semicolons.

    What stands behind a '#' in its line is left out, and so is a first line of words, the header of a table.

    Raises:
        InputError: the file holds something else, such as a table of several columns.
    """
    text = re.sub(r"#.*", "", _text(file_bytes(path, _MAX_BYTES), path)).lstrip()
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
    """The whole numbers or booleans of a JSON list, or of the only list in a JSON object.

    Raises:
        InputError: the file holds something else.
    """
    try:
        value = json.loads(_text(file_bytes(path, _MAX_BYTES), path))
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


def _text(data: bytes, path: Path) -> str:
    """Text in UTF-8, or in UTF-16 as Windows' shell writes it."""
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        return data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"'{path}' is not a list of whole numbers, or its text is damaged.") from error


def _words(text: str) -> list[str]:
    return text.replace(",", " ").replace(";", " ").split()


def _whole(word: str) -> int:
    """The whole number that a word says, also as 9.0 or 9e3.

    Raises:
        ValueError: it says none.
    """
    try:
        return int(word)
    except ValueError:
        value = float(word)
        if not abs(value) < _LARGEST_WHOLE or value != int(value):
            raise
        return int(value)
