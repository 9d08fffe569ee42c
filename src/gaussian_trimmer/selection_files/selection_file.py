"""A selection file of any container, before it is known what its numbers mean, and what the user may say of it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from tokenize import TokenError
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.formats import FORMATS, torch_files
from gaussian_trimmer.formats.checkpoints import Checkpoint, is_checkpoint, parse_checkpoint
from gaussian_trimmer.formats.identify import SELECTION_SUFFIXES, TEXT_SUFFIXES, TORCH_SUFFIXES, identify
from gaussian_trimmer.gaussians import FloatArray, Gaussians, IntArray
from gaussian_trimmer.geometry.limits import blank_unusable
from gaussian_trimmer.io.reading import file_bytes, is_file, open_archive, read_json, reading
from gaussian_trimmer.selection_files.row_matching import (
    Columns,
    attributes_of,
    has_identity_features,
    identity_features,
    match_rows,
    read_splat_columns,
)
from gaussian_trimmer.settings import Range

Kind = Literal[
    "auto", "mask", "labels", "indices", "subset", "property", "classifier", "similarity", "checkpoint", "flashsplat",
    "trimmed",
]  # fmt: skip
_LISTED_ARRAYS = 12
_FREE_ARCHIVE_BYTES = 1 << 26
_ARCHIVE_BYTES_PER_GAUSSIAN = 1 << 9
_ARCHIVE_BYTES_WITHOUT_SCENE = 1 << 28

_MAX_NUMBER_BYTES = 8
_MAX_TEXT_BYTES = 1 << 27
_LARGEST_WHOLE = 2**53
_DAMAGE = (ValueError, TypeError, OverflowError, SyntaxError, TokenError, MemoryError, RecursionError, EOFError)
"""What NumPy raises for damaged arrays, and Python's parsers for their headers."""


@dataclass(frozen=True)
class SelectionOptions:
    """How a selection file is read. The defaults suffice unless the file can be understood in several ways."""

    kind: Kind = "auto"
    """What the file holds; detected from its content by default."""
    object_id: tuple[Annotated[int, Range(-(1 << 31), 1 << 31)], ...] = ()
    """Id of the object, if the file has several; several ids are selected together."""
    property: str | None = None
    """Name of the PLY property, or of the array in an .npz, that holds the selection."""
    threshold: Annotated[float, Range(-1e30, 1e30)] | None = None
    """Values above it are selected. Default: 0 for a property, 0.3 for a classifier's probability, 0.9 for a similarity
    and for a checkpoint's probability; scores in an array have no default."""
    classifier: Path | None = None
    """Classifier of the identity features that the PLY or the checkpoint holds."""
    query_row: Annotated[int, Range(0, 1 << 32)] | None = None
    """Row number, from 0, of a Gaussian on the object; Gaussians with similar identity features are selected."""
    query_point: tuple[Annotated[int, Range(0, 1 << 20)], Annotated[int, Range(0, 1 << 20)]] | None = None
    """The same by a pixel X Y on the object, in the view that --view or --view-index names."""
    gamma: Annotated[float, Range(-1, 1)] = 0.0
    """FlashSplat's background bias: positive values select less, negative ones more; -1 to 1 is useful."""

    def given(self) -> frozenset[str]:
        """Return names of the options other than `kind` that differ from their defaults."""
        changed = (field.name for field in fields(self) if getattr(self, field.name) != field.default)
        return frozenset(changed) - {"kind"}


def flag(option: str, value: str = "VALUE") -> str:
    """Return how an option is given on the command line.

    >>> flag("object_id")
    '--set selection.object-id=VALUE'
    """
    return f"--set selection.{option.replace('_', '-')}={value}"


@dataclass(frozen=True, eq=False)
class SelectionFile:
    """What a selection file holds: arrays, splat rows or a checkpoint."""

    path: Path
    arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """Arrays by name; the only array of a file without names has the name ''."""
    columns: Columns | None = None
    """All columns of a splat file, each (M,)."""
    checkpoint: Checkpoint | None = None
    is_list: bool = False
    """Whether the numbers are a list that somebody wrote, in which some may stand twice."""
    notes: list[str] = field(default_factory=list)
    """What a user should know of how the file was understood."""

    @property
    def _own_columns(self) -> Columns:
        if self.columns is not None:
            return self.columns
        return {} if self.checkpoint is None else self.checkpoint.gaussians.extras

    @property
    def has_features(self) -> bool:
        """Return whether the file's own Gaussians have identity features; cheaper than reading them."""
        return has_identity_features(self._own_columns)

    @property
    def features(self) -> FloatArray | None:
        """Identity features of the file's own Gaussians, (M, D), or None."""
        return identity_features(self._own_columns)

    def scene_rows(self, gaussians: Gaussians) -> IntArray:
        """Scene row of each Gaussian of the file, (M,).

        Raises:
            InputError: the file's Gaussians are not the scene's.
        """
        if self.checkpoint is not None:
            return match_rows(dict(zip("xyz", self.checkpoint.gaussians.means.T, strict=True)), gaussians, self.path)
        assert self.columns is not None, "only files with Gaussians have rows"
        return match_rows(attributes_of(self.columns), gaussians, self.path)

    def vector(self, options: SelectionOptions, *names: str) -> NDArray[Any] | None:
        """Return the one-dimensional array that may be the selection, (M,), or None.

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

    @property
    def content(self) -> str:
        """Return what the file holds, for messages."""
        if not self.arrays:
            return "splats" if self.columns is not None else "a checkpoint"
        listed = [f"{clip_name(name) or 'one'}: {array.dtype} {array.shape}" for name, array in self.arrays.items()]
        more = f"; and {len(listed) - _LISTED_ARRAYS} more" if len(listed) > _LISTED_ARRAYS else ""
        return f"the arrays ({'; '.join(listed[:_LISTED_ARRAYS])}{more})"


@np.errstate(over="ignore", invalid="ignore")  # what damaged numbers become is found where they are used
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
        return SelectionFile(path, {"": _read_npy(path)})
    if suffix == ".npz":
        limit = _ARCHIVE_BYTES_WITHOUT_SCENE if n is None else _FREE_ARCHIVE_BYTES + _ARCHIVE_BYTES_PER_GAUSSIAN * n
        return SelectionFile(path, _read_npz(path, limit))
    if suffix in TEXT_SUFFIXES:
        return SelectionFile(path, {"": _read_text(path)}, is_list=True)
    if suffix in TORCH_SUFFIXES:
        return _read_torch(path)
    if identify(path).kind == "splats":
        return SelectionFile(path, columns=read_splat_columns(path))
    if suffix == ".json":
        return SelectionFile(path, {"": _read_list(path)}, is_list=True)
    raise InputError(
        f"'{path.name}' is not a known selection file; known endings: {', '.join((*SELECTION_SUFFIXES, *FORMATS))}. "
        "(Masks of images are not a selection: lift them to the scene with 'gaussian-trimmer select'.)"
    )


def _read_torch(path: Path) -> SelectionFile:
    file = torch_files.load(path)
    value = file.value
    if torch_files.is_tensor(value):
        return SelectionFile(path, {"": torch_files.as_array(file, value)})
    if is_checkpoint(value):
        checkpoint = parse_checkpoint(file)
        usable = blank_unusable(checkpoint.gaussians, f"'{path}': ")
        return SelectionFile(path, checkpoint=replace(checkpoint, gaussians=usable))
    if isinstance(value, dict):
        tensors = {str(name): entry for name, entry in value.items() if torch_files.is_tensor(entry)}
        if tensors:
            return SelectionFile(path, torch_files.as_arrays(file, tensors))
    raise InputError(
        f"'{path}' holds a {torch_files.type_name(value)} that is not a selection; a tensor, a dict of tensors or a "
        "training checkpoint is needed."
    )


def _read_npy(path: Path) -> NDArray[Any]:
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


def _read_npz(path: Path, limit: int) -> dict[str, NDArray[Any]]:
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


def _read_text(path: Path) -> NDArray[Any]:
    """Return the whole numbers in a text in UTF-8 or UTF-16, between white space, commas and semicolons.

    What stands behind a '#' in its line is left out, and so is a first line of words, the header of a table.

    Raises:
        InputError: the file holds something else, such as a table of several columns.
    """
    data = file_bytes(path, _MAX_TEXT_BYTES)
    try:
        text = data.decode(json.detect_encoding(data))
    except UnicodeDecodeError as error:
        raise InputError(f"'{path}' is not a list of whole numbers, or its text is damaged.") from error
    text = re.sub(r"#.*", "", text).lstrip()
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


def _read_list(path: Path) -> NDArray[Any]:
    """Return the whole numbers or booleans of a JSON list, or of the only list in a JSON object.

    Raises:
        InputError: the file holds something else.
    """
    value = read_json(path, _MAX_TEXT_BYTES)
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
