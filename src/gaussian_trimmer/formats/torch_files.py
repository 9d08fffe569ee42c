"""Files of torch.save, read without torch and without running anything that they contain.

Only zip archives without compression are taken (torch has written them since 1.6). Of the numbers, those of the
tensors that are asked for are read, so a checkpoint's optimizer state costs nothing.
"""

from __future__ import annotations

import math
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal, cast

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.formats.torch_structure import (
    NUMBER_TYPES,
    OtherTensor,
    StructureError,
    TensorEntry,
    TorchObject,
    parse_structure,
)
from gaussian_trimmer.io.archives import member_bytes, open_archive
from gaussian_trimmer.io.reading import read_into

SUFFIXES = (".pt", ".pth")
_EXPECTED = "torch file of the zip format"
_MAX_PICKLE_BYTES = 1 << 20
_MAX_DIMENSIONS = 8
_MAX_TENSORS = 1 << 12


@dataclass(frozen=True)
class TorchFile:
    """What a torch file holds, and where its numbers are."""

    path: Path
    value: Any
    """Containers, numbers and text as they are; tensors as `TensorEntry` or `OtherTensor`."""
    home: str
    """Folder in the archive."""
    byte_order: Literal["<", ">"]
    """Of the numbers in the storages."""
    size: int
    """Bytes of the file."""


def load(path: Path) -> TorchFile:
    """The structure of a torch file.

    Raises:
        InputError: the file is damaged, of the old format, compressed, or holds other objects.
    """
    with path.open("rb") as file:
        if file.read(4) != b"PK\3\4":
            raise InputError(f"'{path}' is no {_EXPECTED}, or is damaged; load it and save it again with torch.save.")
    size = path.stat().st_size
    with open_archive(path, _EXPECTED) as archive:
        entries = {entry.filename: entry for entry in archive.infolist()}
        compressed = any(entry.compress_type != zipfile.ZIP_STORED for entry in entries.values())
        if compressed or sum(entry.file_size for entry in entries.values()) > size:
            raise InputError(f"'{path}' is a compressed or damaged archive, which torch.save does not write.")
        structures = [name for name in entries if name.rpartition("/")[2] == "data.pkl"]
        if len(structures) != 1:
            raise InputError(f"'{path}' is no {_EXPECTED}: it has {len(structures)} members 'data.pkl' instead of one.")
        home = structures[0].removesuffix("data.pkl")
        if entries[structures[0]].file_size > _MAX_PICKLE_BYTES:
            raise InputError(
                f"'{path}' holds a structure of more than {_MAX_PICKLE_BYTES >> 20} MB beside its tensors."
            )
        structure = member_bytes(archive, structures[0], _MAX_PICKLE_BYTES, path)
        big = f"{home}byteorder" in entries and member_bytes(archive, f"{home}byteorder", 16, path) == b"big"
    try:
        value = parse_structure(structure)
    except StructureError as error:
        raise InputError(
            f"'{path}' is damaged or holds more than tensors and numbers ({shown(str(error))}), and other objects are "
            "not loaded because they can run code; save the tensors alone with torch.save."
        ) from error
    return TorchFile(path, value, home, ">" if big else "<", size)


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
    # Tensors may share a storage, as tied weights do; beyond that, a small file must not become much memory.
    total = sum(_checked_size(file, tensor) for tensor in tensors.values())
    if total > 2 * file.size:
        raise InputError(
            f"'{file.path}' holds tensors that share their numbers, {total} bytes of them in a file of {file.size}; "
            "save contiguous ones."
        )
    with open_archive(file.path, _EXPECTED) as archive:
        return {name: _read(file, archive, tensor) for name, tensor in tensors.items()}


def as_array(file: TorchFile, tensor: Any) -> NDArray[Any]:
    """A dense tensor as an array; otherwise as `as_arrays`."""
    return as_arrays(file, {"": tensor})[""]


def _checked_size(file: TorchFile, tensor: Any) -> int:
    """Bytes of a tensor, if it can be read.

    Raises:
        InputError: it cannot, or is larger than the file.
    """
    if not isinstance(tensor, TensorEntry):
        raise InputError(f"'{file.path}' holds a sparse or quantised tensor; save it as a dense one.")
    if len(tensor.shape) > _MAX_DIMENSIONS:
        raise InputError(f"'{file.path}' holds a tensor of {len(tensor.shape)} dimensions, which is no selection.")
    kind = tensor.storage.kind
    if kind != "bfloat16" and kind not in NUMBER_TYPES:
        raise InputError(f"'{file.path}' holds values of type {shown(kind)}; booleans or numbers are needed.")
    size = math.prod(tensor.shape) * _number_type(file, tensor).itemsize
    if size > file.size:
        raise InputError(f"'{file.path}' holds an expanded tensor of shape {tensor.shape}; save a contiguous one.")
    return size


def _number_type(file: TorchFile, tensor: TensorEntry) -> np.dtype[Any]:
    """How the tensor's numbers lie in the file."""
    kind = tensor.storage.kind
    return np.dtype({"bfloat16": "u2", "b1": "u1"}.get(kind, kind)).newbyteorder(file.byte_order)


def _read(file: TorchFile, archive: zipfile.ZipFile, tensor: TensorEntry) -> NDArray[Any]:
    kind, number = tensor.storage.kind, _number_type(file, tensor)
    if math.prod(tensor.shape) == 0:
        return np.zeros(0, np.float32 if kind == "bfloat16" else kind)
    member = f"{file.home}data/{tensor.storage.key}"
    if member not in archive.NameToInfo:
        raise InputError(f"'{file.path}' is damaged: it lacks the numbers of a tensor.")
    steps = list(zip(tensor.shape, tensor.strides, strict=True))
    reach = 1 + sum((size - 1) * stride for size, stride in steps)  # numbers from the tensor's first to its last
    if (tensor.offset + reach) * number.itemsize > archive.getinfo(member).file_size:
        raise InputError(f"'{file.path}' is damaged: a tensor of shape {tensor.shape} reaches beyond its numbers.")
    run = np.empty(reach, number)
    with archive.open(member) as stream:
        stream.seek(tensor.offset * number.itemsize)
        read_into(run, cast(BinaryIO, stream), file.path)
    strides = [stride * number.itemsize if size > 1 else 0 for size, stride in steps]
    values = np.ascontiguousarray(np.lib.stride_tricks.as_strided(run, tensor.shape, strides))
    if kind == "bfloat16":
        return (values.astype(np.uint32) << 16).view(np.float32)
    if kind == "b1":
        return np.asarray(values != 0)
    return values.astype(number.newbyteorder("="), copy=False)
