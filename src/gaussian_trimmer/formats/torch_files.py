"""Files of torch.save, read without torch and without running anything that they contain.

Only zip archives without compression are taken (torch has written them since 1.6). Of the numbers, those of the
tensors that are asked for are read, so a checkpoint's optimizer state costs nothing.
"""

from __future__ import annotations

import math
import struct
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.formats.torch_structure import (
    OtherTensor,
    StructureError,
    TensorEntry,
    TorchObject,
    parse_structure,
)
from gaussian_trimmer.io.archives import member_bytes, open_archive
from gaussian_trimmer.io.reading import read_into

SUFFIXES = (".pt", ".pth")
_MAX_PICKLE_BYTES = 1 << 20
_MAX_DIMENSIONS = 8
_MAX_TENSORS = 1 << 12
_LOCAL_HEADER = struct.Struct("<4s5H3I2H")
_NUMBERS = ("f2", "f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "b1")


@dataclass(frozen=True)
class TorchFile:
    """What a torch file holds, and where its storages are."""

    path: Path
    value: Any
    """Containers, numbers and text as they are; tensors as `TensorEntry` or `OtherTensor`."""
    storages: dict[str, tuple[int, int]]
    """Beginning and length in bytes of each storage, by its key."""
    byte_order: Literal["<", ">"]
    """Of the numbers in the storages."""
    size: int
    """Bytes of the file."""


def load(path: Path) -> TorchFile:
    """The structure of a torch file.

    Raises:
        InputError: the file is damaged, of the old format, compressed, or holds other objects.
    """
    try:
        with path.open("rb") as file:
            is_archive = file.read(4) == b"PK\3\4"
    except OSError as error:
        raise InputError(f"Cannot read '{path}': {error.strerror}.") from error
    expected = "torch file of the zip format"
    if not is_archive:
        raise InputError(f"'{path}' is no {expected}, or is damaged; load it and save it again with torch.save.")
    with open_archive(path, expected) as archive:
        entries = _checked_entries(archive, path)
        structures = [name for name in entries if name.rpartition("/")[2] == "data.pkl"]
        if len(structures) != 1:
            raise InputError(f"'{path}' is no {expected}: it has {len(structures)} members 'data.pkl' instead of one.")
        home = structures[0].removesuffix("data.pkl")
        if entries[structures[0]].file_size > _MAX_PICKLE_BYTES:
            raise InputError(
                f"'{path}' holds a structure of more than {_MAX_PICKLE_BYTES >> 20} MB beside its tensors."
            )
        structure = member_bytes(archive, entries[structures[0]], _MAX_PICKLE_BYTES, path)
        big = f"{home}byteorder" in entries and member_bytes(archive, f"{home}byteorder", 16, path) == b"big"
    try:
        value = parse_structure(structure)
    except StructureError as error:
        raise InputError(
            f"'{path}' is damaged or holds more than tensors and numbers ({shown(str(error))}), and other objects are "
            "not loaded because they can run code; save the tensors alone with torch.save."
        ) from error
    prefix = f"{home}data/"
    storages = {
        name.removeprefix(prefix): (entry.header_offset, entry.file_size)
        for name, entry in entries.items()
        if name.startswith(prefix)
    }
    return TorchFile(path, value, storages, ">" if big else "<", path.stat().st_size)


def is_tensor(value: Any) -> bool:
    """Whether a loaded value is a tensor or parameter."""
    return isinstance(value, (TensorEntry, OtherTensor))


def type_name(value: Any) -> str:
    """What a loaded value is called in messages."""
    return value.name if isinstance(value, TorchObject) else type(value).__name__


def as_arrays(file: TorchFile, tensors: dict[str, Any]) -> dict[str, NDArray[Any]]:
    """Dense tensors as arrays; bfloat16 becomes float32.

    Raises:
        InputError: a tensor is sparse or quantised, of no number type, or not whole in the file; or the tensors
            together are larger than the file, because they share numbers.
    """
    if len(tensors) > _MAX_TENSORS:
        raise InputError(f"'{file.path}' holds {len(tensors)} tensors; at most {_MAX_TENSORS} can be read.")
    total = 0
    for tensor in tensors.values():
        if isinstance(tensor, TensorEntry):
            total += math.prod(tensor.shape) * _width(tensor, file.path)
    # Tensors may share a storage, as tied weights do; beyond that, a small file must not become much memory.
    if total > 2 * file.size:
        raise InputError(
            f"'{file.path}' holds an expanded tensor, or tensors that share their numbers, {total} bytes of them in a "
            f"file of {file.size}; save contiguous ones."
        )
    return {name: as_array(file, tensor) for name, tensor in tensors.items()}


def as_array(file: TorchFile, tensor: Any) -> NDArray[Any]:
    """A dense tensor as an array; bfloat16 becomes float32.

    Raises:
        InputError: the tensor is sparse or quantised, of no number type, not whole in the file, or larger than it.
    """
    path = file.path
    if not isinstance(tensor, TensorEntry):
        raise InputError(f"'{path}' holds a sparse or quantised tensor; save it as a dense one.")
    width, count = _width(tensor, path), math.prod(tensor.shape)
    if count * width > file.size:
        raise InputError(f"'{path}' holds an expanded tensor of shape {tensor.shape}; save a contiguous one.")
    if len(tensor.shape) > _MAX_DIMENSIONS:
        raise InputError(f"'{path}' holds a tensor of {len(tensor.shape)} dimensions, which is no selection.")
    kind = tensor.storage.kind
    if count == 0:
        return np.zeros(0, np.float32 if kind == "bfloat16" else kind)
    dtype = np.dtype({"bfloat16": "u2", "b1": "u1"}.get(kind, kind)).newbyteorder(file.byte_order)
    steps = list(zip(tensor.shape, tensor.strides, strict=True))
    run = _read_run(file, tensor, 1 + sum((size - 1) * stride for size, stride in steps), dtype)
    strides = [stride * width if size > 1 else 0 for size, stride in steps]
    values = np.ascontiguousarray(np.lib.stride_tricks.as_strided(run, tensor.shape, strides))
    if kind == "bfloat16":
        return (values.astype(np.uint32) << 16).view(np.float32)
    if kind == "b1":
        return np.asarray(values != 0)
    return values.astype(dtype.newbyteorder("="), copy=False)


def _width(tensor: TensorEntry, path: Path) -> int:
    """Bytes of one entry."""
    kind = tensor.storage.kind
    if kind == "bfloat16":
        return 2
    if kind not in _NUMBERS:
        raise InputError(f"'{path}' holds values of type {shown(kind)}; booleans or numbers are needed.")
    return int(kind[1])


def _read_run(file: TorchFile, tensor: TensorEntry, reach: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """The numbers of a storage from a tensor's first to its last, (reach,)."""
    if tensor.storage.key not in file.storages:
        raise InputError(f"'{file.path}' is damaged: it lacks the numbers of a tensor.")
    header_offset, n_bytes = file.storages[tensor.storage.key]
    if (tensor.offset + reach) * dtype.itemsize > n_bytes:
        raise InputError(f"'{file.path}' is damaged: a tensor of shape {tensor.shape} reaches beyond its numbers.")
    with file.path.open("rb") as stream:
        stream.seek(header_offset)
        header = stream.read(_LOCAL_HEADER.size)
        if len(header) < _LOCAL_HEADER.size or header[:4] != b"PK\3\4":
            raise InputError(f"'{file.path}' is damaged: the numbers of a tensor are not where its list says.")
        *_, name_length, extra_length = _LOCAL_HEADER.unpack(header)
        stream.seek(name_length + extra_length + tensor.offset * dtype.itemsize, 1)
        run = np.empty(reach, dtype)
        read_into(run, stream, file.path)
    return run


def _checked_entries(archive: zipfile.ZipFile, path: Path) -> dict[str, zipfile.ZipInfo]:
    """The members by name; what would unpack to more than the file's own size is refused.

    Raises:
        InputError: a member is compressed, or the members claim more bytes than the file has.
    """
    entries = {entry.filename: entry for entry in archive.infolist()}
    compressed = any(entry.compress_type != zipfile.ZIP_STORED for entry in entries.values())
    if compressed or sum(entry.file_size for entry in entries.values()) > path.stat().st_size:
        raise InputError(f"'{path}' is a compressed or damaged archive, which torch.save does not write.")
    return entries
