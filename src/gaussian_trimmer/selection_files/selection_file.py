"""Opens a selection file of any container, before it is known what its numbers mean."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.formats import FORMATS
from gaussian_trimmer.gaussians import FloatArray, Gaussians, IntArray
from gaussian_trimmer.reading import file_bytes, is_file, reading
from gaussian_trimmer.selection_files import torch_files
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
SUFFIXES = (".npy", ".npz", *TEXT_SUFFIXES, *torch_files.SUFFIXES)
_MAX_TEXT_BYTES = 1 << 27
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
    """Read a .npy, .npz, .txt, .csv, .pt, .pth or splat file.

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
        return SelectionFile(path, {"": _read_numbers(path)})
    if suffix in torch_files.SUFFIXES:
        return _read_torch(path)
    if path.name.lower().endswith(tuple(FORMATS)):
        return SelectionFile(path, rows=read_splat_rows(path))
    raise InputError(
        f"'{path.name}' is no known selection file; known endings: {', '.join((*SUFFIXES, *FORMATS))}. (Masks of "
        "images are no selection: lift them to the scene with 'gaussian-trimmer select'.)"
    )


def _archive_limit(n: int | None) -> int:
    """Bytes that the arrays of a selection for n Gaussians may have together: some dozens of numbers for each."""
    return _ARCHIVE_BYTES_WITHOUT_SCENE if n is None else _FREE_ARCHIVE_BYTES + _ARCHIVE_BYTES_PER_GAUSSIAN * n


def _read_numbers(path: Path) -> NDArray[Any]:
    """The whole numbers in a text, between white space and commas, without what stands behind a '#' in its line."""
    text = re.sub(rb"#[^\r\n]*", b"", file_bytes(path, _MAX_TEXT_BYTES).removeprefix(b"\xef\xbb\xbf"))
    text = text.replace(b",", b" ")
    parts = [np.zeros(0, np.int64)]
    start = 0
    try:
        while start < len(text):  # a piece at a time, since a word takes twenty times its bytes
            gap = re.compile(rb"\s|$").search(text, start + _TEXT_BYTES_AT_ONCE)
            end = gap.start() if gap else len(text)
            parts.append(np.array([int(word) for word in text[start:end].split()], np.int64))
            start = end
    except (ValueError, OverflowError) as error:
        raise InputError(f"'{path}' is no list of whole numbers: {shown(str(error))}.") from error
    return np.concatenate(parts)


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
