"""Opens a selection file of any container, before it is known what its numbers mean."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import FORMATS
from gaussian_trimmer.gaussians import FloatArray, Gaussians, IntArray
from gaussian_trimmer.selection_files import torch_files
from gaussian_trimmer.selection_files.checkpoint_files import Checkpoint, is_checkpoint, parse_checkpoint
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
_MAX_ARRAY_BYTES = 1 << 30
_MAX_TEXT_BYTES = 1 << 28


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


def open_selection(path: Path) -> SelectionFile:
    """Read a .npy, .npz, .txt, .csv, .pt, .pth or splat file.

    Raises:
        InputError: the file is missing, of no known kind, damaged, or too large for its purpose.
    """
    if not path.is_file():
        raise InputError(f"There is no file '{path}'.")
    suffix = path.suffix.lower()
    if suffix == ".npy":
        return SelectionFile(path, {"": _read_npy(path)})
    if suffix == ".npz":
        return SelectionFile(path, _read_npz(path))
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


def _read_npy(path: Path) -> NDArray[Any]:
    # Mapped, so that a header that announces more than the file holds is refused without allocating it.
    try:
        array = np.asarray(np.load(path, mmap_mode="r", allow_pickle=False))
    except (OSError, ValueError, EOFError) as error:
        raise _damaged(path, "NumPy array of numbers") from error
    return _numeric(array, path)


def _read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of numbers in an .npz; others, such as text, are left out."""
    arrays = {}
    try:
        with zipfile.ZipFile(path) as archive:
            for entry in archive.infolist():
                if entry.filename.endswith(".npy") and (array := _read_member(archive, entry, path)) is not None:
                    arrays[entry.filename.removesuffix(".npy")] = array
    except InputError:
        raise
    except (OSError, ValueError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise _damaged(path, "NumPy .npz archive of numbers") from error
    if not arrays:
        raise InputError(f"'{path}' holds no array of numbers.")
    return arrays


def _read_member(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, path: Path) -> NDArray[Any] | None:
    """One array of an .npz, or None if it is not numeric; compression must not hide an array beyond all need."""
    with archive.open(entry) as file:
        version = np.lib.format.read_magic(file)
        read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read_header(file)
        n_bytes = int(np.prod([int(size) for size in shape], dtype=object)) * dtype.itemsize
    if dtype.kind not in "biuf":
        return None
    if n_bytes > min(_MAX_ARRAY_BYTES, entry.file_size):
        raise InputError(f"'{path}' announces {n_bytes} bytes for the array '{entry.filename}', too many to be true.")
    with archive.open(entry) as file:
        return np.asarray(np.lib.format.read_array(file, allow_pickle=False))


def _read_numbers(path: Path) -> NDArray[Any]:
    if path.stat().st_size > _MAX_TEXT_BYTES:
        raise InputError(f"'{path}' has more than {_MAX_TEXT_BYTES >> 20} MB; save so long a list as .npy.")
    lines = path.read_text("utf-8", "replace").splitlines()
    words = " ".join(line.partition("#")[0] for line in lines).replace(",", " ").split()
    try:
        return np.array([int(word) for word in words], np.int64)
    except (ValueError, OverflowError) as error:
        raise InputError(f"'{path}' is no list of whole numbers: {error}.") from error


def _read_torch(path: Path) -> SelectionFile:
    value = torch_files.load(path)
    if torch_files.is_tensor(value):
        return SelectionFile(path, {"": _numeric(torch_files.as_array(value, path), path)})
    if is_checkpoint(value):
        return SelectionFile(path, checkpoint=parse_checkpoint(value, path))
    if isinstance(value, dict):
        tensors = {str(name): entry for name, entry in value.items() if torch_files.is_tensor(entry)}
        if tensors:
            return SelectionFile(path, {name: torch_files.as_array(entry, path) for name, entry in tensors.items()})
    raise InputError(
        f"'{path}' holds a {type(value).__name__} that is no selection; a tensor, a dict of tensors or a training "
        "checkpoint is needed."
    )


def _numeric(array: NDArray[Any], path: Path) -> NDArray[Any]:
    if array.dtype.kind not in "biuf":
        raise InputError(f"'{path}' holds values of type {array.dtype}; booleans or numbers are needed.")
    return array


def _damaged(path: Path, expected: str) -> InputError:
    return InputError(f"'{path}' is damaged or no {expected}; save it again with NumPy, without pickled objects.")
