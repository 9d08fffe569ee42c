"""Lists of whole numbers that somebody wrote: .txt, .csv and .json."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.io.reading import file_bytes

_MAX_TEXT_BYTES, _MAX_JSON_BYTES, _MAX_JSON_LISTS = 1 << 27, 1 << 25, 1 << 10
_LARGEST_WHOLE = 2**53
_HEADER = re.compile(rb"[\"']?[A-Za-z_][^\r\n]*(?:[\r\n]+|$)")
_SEPARATORS = bytes.maketrans(b",;", b"  ")
_TEXT_BYTES_AT_ONCE = 1 << 20


def read_numbers(path: Path) -> NDArray[Any]:
    """The whole numbers in a text, between white space, commas and semicolons.

    What stands behind a '#' in its line is left out, and so is a first line of words, the header of a table.
    """
    text = re.sub(rb"#[^\r\n]*", b"", _utf_8(file_bytes(path, _MAX_TEXT_BYTES), path)).lstrip()
    if header := _HEADER.match(text):
        columns = header[0].translate(_SEPARATORS).split()
        if len(columns) > 1 and len(text[header.end() :].split(b"\n", 1)[0].translate(_SEPARATORS).split()) > 1:
            raise InputError(
                f"'{path}' is a table of {len(columns)} columns; give the row numbers alone, one in each line."
            )
        text = text[header.end() :]
    text = text.translate(_SEPARATORS)
    parts = [np.zeros(0, np.int64)]
    start = 0
    try:
        while start < len(text):  # a piece at a time, since a word takes twenty times its bytes
            gap = re.compile(rb"\s|$").search(text, start + _TEXT_BYTES_AT_ONCE)
            end = gap.start() if gap else len(text)
            parts.append(np.array([_whole(word) for word in text[start:end].split()], np.int64))
            start = end
    except (ValueError, OverflowError) as error:
        raise InputError(f"'{path}' is no list of whole numbers: {shown(str(error))}.") from error
    return np.concatenate(parts)


def _utf_8(data: bytes, path: Path) -> bytes:
    """Text without a byte order mark; that of Windows' shell has two bytes for each character."""
    if data[:2] not in (b"\xff\xfe", b"\xfe\xff"):
        return data.removeprefix(b"\xef\xbb\xbf")
    try:
        return data.decode("utf-16").encode()
    except UnicodeDecodeError as error:
        raise InputError(f"'{path}' is no list of whole numbers: it begins as UTF-16 and is damaged.") from error


def _whole(word: bytes) -> int:
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


def read_json(path: Path) -> NDArray[Any]:
    """The whole numbers or booleans of a JSON list, or of the only list in a JSON object.

    Raises:
        InputError: the file holds something else.
    """
    data = file_bytes(path, _MAX_JSON_BYTES).removeprefix(b"\xef\xbb\xbf")
    if data.count(b"[") + data.count(b"{") > _MAX_JSON_LISTS:
        raise InputError(f"'{path}' is no list of whole numbers: it has lists in lists.")
    try:
        value = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise InputError(f"'{path}' is no JSON that can be read: {shown(str(error))}.") from error
    if isinstance(value, dict):
        lists = [entry for entry in value.values() if isinstance(entry, list)]
        value = lists[0] if len(lists) == 1 else None
    if isinstance(value, list):
        if value and all(isinstance(entry, bool) for entry in value):
            return np.array(value, np.bool_)
        try:
            numbers = [_whole(str(entry).encode()) for entry in value if isinstance(entry, int | float)]
            if len(numbers) == len(value):
                return np.array(numbers, np.int64)
        except (ValueError, OverflowError):
            pass
    raise InputError(f"'{path}' is no list of whole numbers or booleans; give row numbers as [0, 5, 7].")
