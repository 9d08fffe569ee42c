"""Opens a selection file of any container, before it is known what its numbers mean."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.formats import FORMATS, has_splats, torch_files
from gaussian_trimmer.gaussians import FloatArray, Gaussians, IntArray
from gaussian_trimmer.io.reading import file_bytes, is_file, reading
from gaussian_trimmer.selection_files.checkpoint_files import Checkpoint, is_checkpoint, parse_checkpoint
from gaussian_trimmer.selection_files.numpy_files import read_npy, read_npz
from gaussian_trimmer.selection_files.options import SelectionOptions
from gaussian_trimmer.selection_files.row_matching import match_centres, match_rows
from gaussian_trimmer.selection_files.splat_rows import (
    SplatRows,
    has_identity_features,
    identity_features,
    read_splat_rows,
)

TEXT_SUFFIXES = (".txt", ".csv")
SUFFIXES = (".npy", ".npz", *TEXT_SUFFIXES, ".json", *torch_files.SUFFIXES)
_MAX_TEXT_BYTES, _MAX_JSON_BYTES, _MAX_JSON_LISTS = 1 << 27, 1 << 25, 1 << 10
_LARGEST_WHOLE = 2**53
_HEADER = re.compile(rb"[\"']?[A-Za-z_][^\r\n]*(?:[\r\n]+|$)")
_SEPARATORS = bytes.maketrans(b",;", b"  ")
_TEXT_BYTES_AT_ONCE = 1 << 20
_FREE_ARCHIVE_BYTES = 1 << 26
_ARCHIVE_BYTES_PER_GAUSSIAN = 1 << 9
_ARCHIVE_BYTES_WITHOUT_SCENE = 1 << 28


@dataclass(frozen=True, eq=False)
class SelectionFile:
    """What a selection file holds: arrays, splat rows or a checkpoint."""

    path: Path
    arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """Arrays by name; the only array of a file without names has the name ''."""
    rows: SplatRows | None = None
    checkpoint: Checkpoint | None = None
    is_list: bool = False
    """Whether the numbers are a list that somebody wrote, in which some may stand twice."""
    notes: list[str] = field(default_factory=list)
    """What a user should know of how the file was understood."""

    @property
    def has_features(self) -> bool:
        """Whether the file's own Gaussians have identity features; cheaper than reading them."""
        if self.rows is not None:
            return has_identity_features(self.rows.columns)
        return self.checkpoint is not None and self.checkpoint.features is not None

    @property
    def features(self) -> FloatArray | None:
        """Identity features of the file's own Gaussians, (M, D), or None."""
        if self.rows is not None:
            return identity_features(self.rows.columns)
        return self.checkpoint.features if self.checkpoint is not None else None

    def scene_rows(self, gaussians: Gaussians) -> IntArray:
        """Scene row of each Gaussian of the file, (M,).

        Raises:
            InputError: the file's Gaussians are not the scene's.
        """
        if self.checkpoint is not None:
            return match_centres(self.checkpoint.gaussians.means, gaussians, self.path)
        assert self.rows is not None, "only files with Gaussians have rows"
        return match_rows(self.rows, gaussians, self.path)

    def vector(self, options: SelectionOptions, *names: str) -> NDArray[Any] | None:
        """The one-dimensional array that may be the selection, (M,), or None.

        That is the array that `options.property` names, else the file's only array, else the only one with one of
        the given names. Shapes (M, 1) and (1, M) count as one-dimensional.
        """
        if options.property is not None:
            array = self.arrays.get(options.property)
        elif len(self.arrays) == 1:
            array = next(iter(self.arrays.values()))
        else:
            known = [name for name in names if name in self.arrays]
            array = self.arrays[known[0]] if len(known) == 1 else None
        if array is None or array.ndim == 0 or array.size != max(array.shape):
            return None
        return array.reshape(-1)


def open_selection(path: Path, n: int | None = None) -> SelectionFile:
    """Read a .npy, .npz, .txt, .csv, .json, .pt, .pth or splat file.

    Arguments:
        n: number of Gaussians of the scene, where there is one. It bounds what a compressed file may unpack to.

    Raises:
        InputError: the file is missing, of no known kind, damaged, too large for its purpose, or changes meanwhile.
    """
    if not is_file(path):
        raise InputError(f"There is no file '{path}'.")
    with reading(path):
        return _open(path, n)


def _open(path: Path, n: int | None) -> SelectionFile:
    suffix = path.suffix.lower()
    if suffix == ".npy":
        return SelectionFile(path, {"": read_npy(path)})
    if suffix == ".npz":
        return SelectionFile(path, read_npz(path, _archive_limit(n)))
    if suffix in TEXT_SUFFIXES:
        return SelectionFile(path, {"": _read_numbers(path)}, is_list=True)
    if has_splats(path):
        return SelectionFile(path, rows=read_splat_rows(path))
    if suffix == ".json":
        return SelectionFile(path, {"": _read_json(path)}, is_list=True)
    if suffix in torch_files.SUFFIXES:
        return _read_torch(path)
    raise InputError(
        f"'{path.name}' is no known selection file; known endings: {', '.join((*SUFFIXES, *FORMATS))}. (Masks of "
        "images are no selection: lift them to the scene with 'gaussian-trimmer select'.)"
    )


def _archive_limit(n: int | None) -> int:
    """Bytes that the arrays of a selection for n Gaussians may have together: some dozens of numbers for each."""
    return _ARCHIVE_BYTES_WITHOUT_SCENE if n is None else _FREE_ARCHIVE_BYTES + _ARCHIVE_BYTES_PER_GAUSSIAN * n


def _read_numbers(path: Path) -> NDArray[Any]:
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


def _read_json(path: Path) -> NDArray[Any]:
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


def _read_torch(path: Path) -> SelectionFile:
    file = torch_files.load(path)
    value = file.value
    if torch_files.is_tensor(value):
        return SelectionFile(path, {"": torch_files.as_array(file, value)})
    if is_checkpoint(value):
        return SelectionFile(path, checkpoint=parse_checkpoint(file))
    if isinstance(value, dict):
        tensors = {str(name): entry for name, entry in value.items() if torch_files.is_tensor(entry)}
        if tensors:
            return SelectionFile(path, torch_files.as_arrays(file, tensors))
    raise InputError(
        f"'{path}' holds a {torch_files.type_name(value)} that is no selection; a tensor, a dict of tensors or a "
        "training checkpoint is needed."
    )
