"""Files of torch.save, read without torch and without running anything that they contain.

`pickle.Unpickler` asks `find_class` for every function and class in a file. Here it gets a placeholder for each, which
looks nothing up: called, it gives the note of a tensor, or itself. Only zip archives without compression are taken
(torch has written them since 1.6), and of the numbers those of the tensors that are asked for are read, so a
checkpoint's optimizer state costs nothing.
"""

from __future__ import annotations

import io
import math
import pickle
import pickletools
import struct
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.formats.packing import thicken_discs, with_finite_limits
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.io.reading import member_bytes, open_archive, read_into
from gaussian_trimmer.io.writing import atomic_file

_EXPECTED = "torch file of the zip format"
_MAX_PICKLE_BYTES = 1 << 20
_BFLOAT16 = "bfloat16"
_NUMBER_TYPES = {
    "FloatStorage": "f4", "DoubleStorage": "f8", "HalfStorage": "f2", "BFloat16Storage": _BFLOAT16,
    "LongStorage": "i8", "IntStorage": "i4", "ShortStorage": "i2", "CharStorage": "i1", "ByteStorage": "u1",
    "BoolStorage": "b1",
    "float32": "f4", "float64": "f8", "float16": "f2", "bfloat16": _BFLOAT16, "int64": "i8", "int32": "i4",
    "int16": "i2", "int8": "i1", "uint8": "u1", "uint16": "u2", "uint32": "u4", "uint64": "u8", "bool": "b1",
}  # fmt: skip
"""Names of torch's storages and number types -> NumPy's, or 'bfloat16'."""
_PLACEHOLDERS = ("torch", "numpy", "collections", "_codecs")
"""Packages that files name; nothing in them is looked up."""
_IGNORED = ("internal", "lightning", "pytorch_lightning", "jsonargparse", "pathlib", "argparse")
"""Packages whose objects trainings leave beside their tensors."""
_MAX_DIMENSIONS = 32
_LARGEST_WHOLE = 1 << 64
_ERRORS_OF_DAMAGE = (
    pickle.UnpicklingError, EOFError, LookupError, TypeError, ValueError, AttributeError, OverflowError, MemoryError,
)  # fmt: skip
"""What `pickle` raises for damaged files, the last two for frames and texts of absurd lengths."""


class _Note:
    """Something that a file refers to; the file cannot change it."""

    def __setstate__(self, state: Any) -> None:
        pass


class OrderedDict(_Note, dict[Any, Any]):
    """The dict of a state, whose `_metadata` is left out."""


@dataclass(frozen=True, eq=False)
class Placeholder(_Note):
    """Any function or class of these packages, or what it returns; what that would be does not matter."""

    name: str

    def __call__(self, *arguments: Any) -> Any:
        """Return the dict, tensor or parameter that a call stands for; all else stays a placeholder."""
        match self.name:
            case "OrderedDict":
                return OrderedDict()
            case "_rebuild_tensor" | "_rebuild_tensor_v2":
                return _tensor(*arguments)
            case "_rebuild_tensor_v3":
                storage, offset, shape, strides, gradient, hooks, kind, *changes = arguments
                return _tensor(_Storage(kind.name, storage.key), offset, shape, strides, gradient, hooks, any(changes))
            case "_rebuild_parameter" | "_rebuild_parameter_with_state" if is_tensor(arguments[0]):
                return arguments[0]
        return self


class Ignored(_Note):
    """Stands for an object of a training's program, whatever is put into it."""

    def __new__(cls, *arguments: Any, **named: Any) -> Ignored:
        """Return the same, whatever it is made of."""
        return super().__new__(cls)

    def __setitem__(self, key: Any, value: Any) -> None:
        pass

    def extend(self, values: Any) -> None:
        """Take nothing."""


@dataclass(frozen=True, eq=False)
class _Storage(_Note):
    """A run of numbers in the archive: torch's name of their type, and the name of the member that holds them."""

    kind: str
    key: str


@dataclass(frozen=True, eq=False)
class Tensor(_Note):
    """Where a tensor lies. Offset and strides count numbers of the storage."""

    storage: _Storage
    offset: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]


@dataclass(frozen=True)
class TorchFile:
    """What a torch file holds, and where its numbers are."""

    path: Path
    value: Any
    """Containers, numbers and text as they are; tensors as `Tensor`, everything else as `Placeholder`."""
    home: str
    """Folder in the archive."""
    byte_order: str
    """Of the numbers in the storages, '<' or '>'."""


def load(path: Path) -> TorchFile:
    """Return the structure of a torch file.

    Raises:
        InputError: the file is damaged, of the old format, compressed, or holds other objects.
    """
    with path.open("rb") as file:
        if file.read(4) != b"PK\3\4":
            raise InputError(
                f"'{path}' is not a {_EXPECTED}, or is damaged; load it and save it again with torch.save."
            )
    with open_archive(path, _EXPECTED) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > path.stat().st_size:
            raise InputError(f"'{path}' is a compressed or damaged archive, which torch.save does not write.")
        structures = [name for name in archive.namelist() if name.rpartition("/")[2] == "data.pkl"]
        if len(structures) != 1:
            raise InputError(
                f"'{path}' is not a {_EXPECTED}: it has {len(structures)} members 'data.pkl' instead of one."
            )
        home = structures[0].removesuffix("data.pkl")
        structure = member_bytes(archive, structures[0], _MAX_PICKLE_BYTES, path)
        big = f"{home}byteorder" in archive.NameToInfo and archive.read(f"{home}byteorder") == b"big"
    try:
        _check(structure)
        value = _Unpickler(io.BytesIO(structure)).load()
    except _ERRORS_OF_DAMAGE as error:
        raise InputError(
            f"'{path}' is damaged or holds more than tensors and numbers ({clip_name(str(error))}), and other objects "
            "are not loaded because they can run code; save the tensors alone with torch.save."
        ) from error
    return TorchFile(path, value, home, ">" if big else "<")


def _check(structure: bytes) -> None:
    """Refuse a pickle that would take more memory or time than its size allows, or end the process.

    The hash of a tuple visits all that is in it, as deep and as often as the file likes. So no tuple may be a key, and
    sets are not taken. The stack that the instructions work on is followed, with a boolean for each value.
    """
    are_tuples: list[bool] = []  # the stack
    marks: list[int] = []  # how high the stack was
    memory: dict[Any, bool] = {}
    for instruction, argument, _ in pickletools.genops(structure):
        name, taken = instruction.name, instruction.stack_before
        if isinstance(argument, int) and abs(argument) > _LARGEST_WHOLE:
            raise pickle.UnpicklingError("it has a number of more than 64 bits")
        if name in ("EMPTY_SET", "ADDITEMS", "FROZENSET"):
            raise pickle.UnpicklingError("it has a set")
        if name in ("PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE"):
            place = len(memory) if name == "MEMOIZE" else cast(int, argument)
            if place > len(structure):
                raise pickle.UnpicklingError("it has a place in memory beyond all that it can fill")
            memory[place] = are_tuples[-1]
        elif name in ("GET", "BINGET", "LONG_BINGET"):
            are_tuples.append(memory[argument])
        elif name == "MARK":
            marks.append(len(are_tuples))
        elif name == "POP" and marks and marks[-1] == len(are_tuples):
            marks.pop()
        else:
            has_mark = pickletools.markobject in taken
            start = marks.pop() - taken.index(pickletools.markobject) if has_mark else len(are_tuples) - len(taken)
            items = are_tuples[start:]
            del are_tuples[start:]
            # A dict comes first where it is filled, and its entries alone where it is made.
            if any({"SETITEM": items[1::2], "SETITEMS": items[1::2], "DICT": items[::2]}.get(name, ())):
                raise pickle.UnpicklingError("it has a tuple as a key")
            are_tuples += ["TUPLE" in name or any(items[:1])] * len(instruction.stack_after)


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Placeholder | type[Ignored]:
        if module.partition(".")[0] in _IGNORED:
            return Ignored
        if module.partition(".")[0] not in _PLACEHOLDERS:
            raise pickle.UnpicklingError(f"it names {module}.{name}")
        return Placeholder(name)

    def persistent_load(self, reference: Any) -> _Storage:
        word, kind, key, *_ = reference
        if word != "storage" or not isinstance(kind, Placeholder) or not isinstance(key, str):
            raise pickle.UnpicklingError("it refers to something that is not a storage")
        return _Storage(kind.name, key)


def _tensor(storage: Any, offset: Any, shape: Any, strides: Any, *rest: Any) -> Tensor | Placeholder:
    """Return what `torch._utils._rebuild_tensor_v2` makes of these arguments."""
    if len(rest) > 2 and rest[2]:  # negated or conjugated when it is used
        return Placeholder("_rebuild_tensor")
    numbers = [offset, *shape, *strides]
    if not isinstance(storage, _Storage) or len(shape) != len(strides) or len(shape) > _MAX_DIMENSIONS:
        raise pickle.UnpicklingError("it has a tensor of impossible shape")
    if not all(type(number) is int and 0 <= number < 1 << 63 for number in numbers):
        raise pickle.UnpicklingError("it has a tensor of impossible shape")
    return Tensor(storage, offset, tuple(shape), tuple(strides))


def write_mask(mask: BoolArray, path: Path) -> None:
    """Write a mask (N,) as `torch.save` writes a tensor of booleans.

    Raises:
        InputError: the file cannot be written.
    """

    def text(word: str) -> bytes:
        return b"X" + struct.pack("<i", len(word)) + word.encode()

    count = b"J" + struct.pack("<i", len(mask))
    storage = text("storage") + b"ctorch\nBoolStorage\n" + text("0") + text("cpu") + count
    tensor = b"ctorch._utils\n_rebuild_tensor_v2\n((" + storage + b"tQK\0" + count + b"\x85K\1\x85"  # a stride of one
    members = {
        "data.pkl": b"\x80\2" + tensor + b"\x89ccollections\nOrderedDict\n)RtR.",
        "byteorder": b"little",
        "data/0": np.ascontiguousarray(mask).view(np.uint8).tobytes(),
        "version": b"3\n",
    }
    with atomic_file(path) as part, zipfile.ZipFile(part, "w") as archive:
        for name, data in members.items():
            archive.writestr(zipfile.ZipInfo(f"archive/{name}"), data)


def is_tensor(value: Any) -> bool:
    """Return whether a loaded value is a tensor or parameter, of whatever kind."""
    return isinstance(value, Tensor) or (isinstance(value, Placeholder) and value.name.startswith("_rebuild"))


def type_name(value: Any) -> str:
    """Return what a loaded value is called in messages."""
    return value.name if isinstance(value, Placeholder) else type(value).__name__


def as_arrays(file: TorchFile, tensors: dict[str, Any]) -> dict[str, NDArray[Any]]:
    """Return dense tensors as arrays; bfloat16 becomes float32.

    Raises:
        InputError: a tensor is sparse or quantised, of no number type, or not whole in the file; or the tensors
            together are larger than the file, because they share numbers.
    """
    # Tensors may share a storage, as tied weights do; beyond that, a small file must not become much memory.
    total = sum(_number_type(file, tensor).itemsize * math.prod(tensor.shape) for tensor in tensors.values())
    if total > 2 * file.path.stat().st_size:
        raise InputError(
            f"'{file.path}' holds expanded tensors, or many that share their numbers, {total} bytes in all; save "
            "contiguous ones."
        )
    with open_archive(file.path, _EXPECTED) as archive:
        return {name: _read(file, archive, tensor) for name, tensor in tensors.items()}


def as_array(file: TorchFile, tensor: Any) -> NDArray[Any]:
    """Return a dense tensor as an array; otherwise as `as_arrays`."""
    return as_arrays(file, {"": tensor})[""]


def as_gaussians(file: TorchFile, tensors: dict[str, Any], expected: str) -> Gaussians:
    """Return the Gaussians of a training.

    Args:
        file: where the tensors are.
        tensors: centres, log scales, rotations, opacity logits and coefficients, by the names of splatfacto's.
        expected: what the file is not, should the tensors not fit each other.

    Raises:
        InputError: they do not, or there are no Gaussians.
    """
    values = {name: np.asarray(array, np.float32) for name, array in as_arrays(file, tensors).items()}
    n, rest, scales = len(np.atleast_1d(values["means"])), values["features_rest"], values["scales"]
    if n == 0:
        raise InputError(f"'{file.path}' holds zero Gaussians.")
    try:
        gaussians = Gaussians(
            means=values["means"],
            log_scales=thicken_discs(scales) if scales.shape == (n, 2) else scales,
            quaternions=values["quats"],
            opacity_logits=values["opacities"].reshape(n),
            sh_dc=values["features_dc"].reshape(n, 3),
            sh_rest=np.ascontiguousarray(rest.transpose(0, 2, 1)) if rest.size else np.zeros((n, 3, 0), np.float32),
            model="2dgs" if scales.shape == (n, 2) else "default",
        )
    except ValueError as error:
        raise InputError(f"'{file.path}' is not a {expected}: {clip_name(str(error))}") from error
    return with_finite_limits(gaussians)


def _number_type(file: TorchFile, tensor: Any) -> np.dtype[Any]:
    """Return how a tensor's numbers lie in the file.

    Raises:
        InputError: it is not a dense tensor of numbers.
    """
    if not isinstance(tensor, Tensor):
        raise InputError(f"'{file.path}' holds a sparse or quantised tensor; save it as a dense one.")
    kind = _NUMBER_TYPES.get(tensor.storage.kind)
    if kind is None:
        raise InputError(
            f"'{file.path}' holds values of type {clip_name(tensor.storage.kind)}; booleans or numbers are needed."
        )
    return np.dtype({_BFLOAT16: "u2", "b1": "u1"}.get(kind, kind)).newbyteorder(file.byte_order)  # type: ignore[arg-type]


def _read(file: TorchFile, archive: zipfile.ZipFile, tensor: Tensor) -> NDArray[Any]:
    kind, number = _NUMBER_TYPES[tensor.storage.kind], _number_type(file, tensor)
    if math.prod(tensor.shape) == 0:
        return np.zeros(0, np.float32 if kind == _BFLOAT16 else kind)
    member = f"{file.home}data/{tensor.storage.key}"
    steps = list(zip(tensor.shape, tensor.strides, strict=True))
    reach = 1 + sum((size - 1) * stride for size, stride in steps)  # numbers from the tensor's first to its last
    present = archive.getinfo(member).file_size if member in archive.NameToInfo else 0
    if (tensor.offset + reach) * number.itemsize > present:
        raise InputError(f"'{file.path}' is damaged: a tensor of shape {tensor.shape} is not whole.")
    run = np.empty(reach, number)
    with archive.open(member) as stream:
        stream.seek(tensor.offset * number.itemsize)
        read_into(run, cast(BinaryIO, stream), file.path)
    strides = [stride * number.itemsize if size > 1 else 0 for size, stride in steps]
    values = np.ascontiguousarray(np.lib.stride_tricks.as_strided(run, tensor.shape, strides))
    if kind == _BFLOAT16:
        return (values.astype(np.uint32) << 16).view(np.float32)
    return values != 0 if kind == "b1" else values.astype(number.newbyteorder("="), copy=False)
