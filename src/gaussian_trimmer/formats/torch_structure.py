"""The structure of a torch file: containers, numbers and tensors, unpickled without running anything that it names.

`pickle.Unpickler` asks `find_class` for every function and class in a file. Here it gets a `_Name`, which looks nothing
up: called, it returns the note of a tensor or a number that the call stands for. Before that, the instructions are read
through once: as the key of a dict, a kilobyte of tuples of tuples can mean 2^60 objects to hash.
"""

from __future__ import annotations

import io
import pickle
import pickletools
from dataclasses import dataclass
from typing import Any

import numpy as np

NUMBER_TYPES = ("f2", "f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "b1")
_STORAGES = {
    "FloatStorage": "f4", "DoubleStorage": "f8", "HalfStorage": "f2", "BFloat16Storage": "bfloat16",
    "LongStorage": "i8", "IntStorage": "i4", "ShortStorage": "i2", "CharStorage": "i1", "ByteStorage": "u1",
    "BoolStorage": "b1",
}  # fmt: skip
_DTYPES = {
    "float32": "f4", "float64": "f8", "float16": "f2", "bfloat16": "bfloat16", "int64": "i8", "int32": "i4",
    "int16": "i2", "int8": "i1", "uint8": "u1", "uint16": "u2", "uint32": "u4", "uint64": "u8", "bool": "b1",
}  # fmt: skip
_TORCH_MODULES = ("torch", "torch._utils", "torch._tensor", "torch.storage", "torch.serialization")
_INSTRUCTIONS = """
    PROTO FRAME STOP MARK POP NONE NEWTRUE NEWFALSE BININT1 BININT2 BININT LONG1 BINFLOAT BINUNICODE SHORT_BINUNICODE
    SHORT_BINBYTES EMPTY_TUPLE TUPLE TUPLE1 TUPLE2 TUPLE3 EMPTY_LIST APPEND APPENDS EMPTY_DICT SETITEM SETITEMS BINPUT
    LONG_BINPUT MEMOIZE BINGET LONG_BINGET GLOBAL STACK_GLOBAL REDUCE BUILD BINPERSID
"""
"""What torch.save writes for containers, numbers and tensors, in pickle's protocols 2 to 5."""
_MAX_NUMBER = 1 << 63


class StructureError(ValueError):
    """The pickle is damaged, or has more in it than containers, numbers and tensors."""


class _Sealed:
    """What a file refers to. It cannot give it a state, as it can to other objects."""

    def __setstate__(self, state: Any) -> None:
        raise StructureError("it changes an object")


@dataclass(frozen=True)
class Storage(_Sealed):
    """A run of numbers in the archive."""

    kind: str
    """NumPy's name of their type, 'bfloat16', or torch's name of a type that NumPy lacks."""
    key: str
    """Name of the member that holds them."""


@dataclass(frozen=True)
class TensorEntry(_Sealed):
    """Where a tensor lies."""

    storage: Storage
    offset: int
    """Numbers of the storage before the first of the tensor."""
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    """Numbers of the storage from one entry of each axis to the next."""


@dataclass(frozen=True)
class OtherTensor(_Sealed):
    """A sparse, quantised, nested or otherwise unusual tensor."""


@dataclass(frozen=True)
class TorchObject(_Sealed):
    """Another object of torch's, such as a device; what it holds does not matter."""

    name: str


class _OrderedDict(dict[Any, Any]):
    """A dict of parameters; the attributes that torch gives it are left out."""

    def __setstate__(self, state: Any) -> None:
        pass


class _NumberType:
    """A NumPy dtype, of which pickled NumPy numbers speak."""

    def __init__(self, code: Any, *_: Any) -> None:
        if not isinstance(code, str) or code not in NUMBER_TYPES:
            raise StructureError("it has NumPy numbers of another type than booleans, integers and floats")
        self.dtype = np.dtype(code)

    def __setstate__(self, state: Any) -> None:
        self.dtype = self.dtype.newbyteorder(">" if state[1] == ">" else "<")


@dataclass(frozen=True)
class _Name(_Sealed):
    """A function or class that a file names; it is never looked up."""

    module: str
    name: str

    def __call__(self, *arguments: Any) -> Any:
        """What a call that torch or NumPy writes stands for."""
        match self.module, self.name:
            case "collections", "OrderedDict" if not arguments:
                return _OrderedDict()
            case "torch._utils", "_rebuild_tensor" | "_rebuild_tensor_v2":
                unusual = len(arguments) > 6 and bool(arguments[6])  # negated or conjugated when it is used
                return OtherTensor() if unusual else _tensor(*arguments[:4])
            case "torch._utils", "_rebuild_tensor_v3":
                storage, offset, shape, strides, _, _, dtype, *rest = arguments
                kind = _DTYPES.get(dtype.name, dtype.name)
                return OtherTensor() if any(rest) else _tensor(Storage(kind, storage.key), offset, shape, strides)
            case "torch._utils", "_rebuild_parameter" | "_rebuild_parameter_with_state":
                return arguments[0]
            case (("torch._utils" | "torch._tensor"), name) if name.startswith("_rebuild"):
                return OtherTensor()
            case "numpy", "dtype":
                return _NumberType(*arguments)
            case (("numpy.core.multiarray" | "numpy._core.multiarray"), "scalar"):
                kind, data = arguments
                return np.frombuffer(data, kind.dtype, count=1)[0].item()
            case "_codecs", "encode" if arguments[1] == "latin1":  # bytes, which torch's pickle writes as text
                return arguments[0].encode("latin-1")
            case module, name if module in _TORCH_MODULES:
                return TorchObject(name)
        raise StructureError(f"it calls {self.module}.{self.name}")


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> _Name:
        if module in _TORCH_MODULES or (module, name) in (
            ("collections", "OrderedDict"), ("numpy", "dtype"), ("numpy.core.multiarray", "scalar"),
            ("numpy._core.multiarray", "scalar"), ("_codecs", "encode"),
        ):  # fmt: skip
            return _Name(module, name)
        raise StructureError(f"it names {module}.{name}")

    def persistent_load(self, reference: Any) -> Storage:
        word, kind, key, *_ = reference
        if word != "storage" or not isinstance(kind, _Name) or not isinstance(key, str):
            raise StructureError("it refers to something that is no storage")
        return Storage(_STORAGES.get(kind.name, kind.name), key)


def parse_structure(data: bytes) -> Any:
    """The value of a torch file's pickle: tuples, lists, dicts, numbers, text, and the entries of tensors.

    Raises:
        StructureError: it is damaged, or names something that is neither container, number nor tensor.
    """
    try:
        _check_instructions(data)
        return _Unpickler(io.BytesIO(data)).load()
    except StructureError:
        raise
    except (pickle.UnpicklingError, EOFError, LookupError, TypeError, ValueError, AttributeError) as error:
        raise StructureError(f"it is damaged ({type(error).__name__})") from error


def _check_instructions(data: bytes) -> None:
    """Refuse instructions that torch.save does not write, and keys of dicts that might take years to hash."""
    stack: list[bool | None] = []  # whether each value is made of no others; None for a mark
    memo: dict[int, bool] = {}
    known = frozenset(_INSTRUCTIONS.split())
    for instruction, argument, _ in pickletools.genops(data):
        place: Any = len(memo) if argument is None else argument
        if instruction.name not in known:
            raise StructureError(f"it has the instruction {instruction.name}")
        if instruction.name in ("BINPUT", "LONG_BINPUT", "MEMOIZE"):
            if place > len(data) or stack[-1] is None:
                raise StructureError("it is damaged")
            memo[place] = stack[-1]
        elif instruction.name in ("BINGET", "LONG_BINGET"):
            stack.append(memo[place])
        elif instruction.name == "MARK":
            stack.append(None)
        else:
            parts = _taken(stack, instruction.stack_before)
            if instruction.name in ("SETITEM", "SETITEMS") and not all(parts[1:-1:2]):
                raise StructureError("it has a dict whose keys are neither text nor numbers")
            stack += [not parts] * len(instruction.stack_after)


def _taken(stack: list[bool | None], needed: list[Any]) -> list[bool]:
    """Take from the top of the stack what an instruction needs, which may be all values above the last mark."""
    parts: list[bool | None] = []
    if pickletools.markobject in needed:
        while (part := stack.pop()) is not None:
            parts.append(part)
        needed = needed[: needed.index(pickletools.markobject)]
    parts += [stack.pop() for _ in needed]
    if None in parts:
        raise StructureError("it is damaged")
    return [bool(part) for part in parts]


def _tensor(storage: Any, offset: Any, shape: Any, strides: Any) -> TensorEntry:
    numbers = [offset, *shape, *strides]
    if not isinstance(storage, Storage) or len(shape) != len(strides):
        raise StructureError("it is damaged")
    if not all(type(number) is int and 0 <= number < _MAX_NUMBER for number in numbers):
        raise StructureError("it has a tensor of impossible shape")
    return TensorEntry(storage, offset, tuple(shape), tuple(strides))
