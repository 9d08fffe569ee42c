"""The structure of a torch file: containers, numbers and tensors, read from its pickle without running any of it.

A pickle is a program for a small stack machine, and some of its instructions call what they name. Here is a machine
that knows the instructions which torch.save writes for containers, numbers and tensors. It calls nothing: it notes
which tensor lies where, and refuses every other name.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

_STORAGES = {
    "FloatStorage": "f4", "DoubleStorage": "f8", "HalfStorage": "f2", "BFloat16Storage": "bfloat16",
    "LongStorage": "i8", "IntStorage": "i4", "ShortStorage": "i2", "CharStorage": "i1", "ByteStorage": "u1",
    "BoolStorage": "b1",
}  # fmt: skip
_TYPES = {
    "float32": "f4", "float64": "f8", "float16": "f2", "bfloat16": "bfloat16", "int64": "i8", "int32": "i4",
    "int16": "i2", "int8": "i1", "uint8": "u1", "uint16": "u2", "uint32": "u4", "uint64": "u8", "bool": "b1",
}  # fmt: skip
_NUMBERS = ("f2", "f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "b1")
_LONGEST_NUMBER = 8
"""Bytes of an integer: longer ones could be chosen so that a dict takes hours to hold them."""
_LONGEST_ENCODED = 64
_PLAIN_MODULES = ("collections", "torch", "torch._utils", "torch._tensor", "torch.storage", "torch.serialization")


class StructureError(ValueError):
    """The pickle is damaged, or has more in it than containers, numbers and tensors."""


@dataclass(frozen=True)
class Name:
    """A function or class that a file refers to; it is never looked up."""

    module: str
    name: str


@dataclass(frozen=True)
class Storage:
    """A run of numbers in the archive."""

    kind: str
    """NumPy's name of their type, 'bfloat16', or torch's name of a type that NumPy lacks."""
    key: str
    """Name of the member that holds them."""


@dataclass(frozen=True)
class TensorEntry:
    """Where a tensor lies."""

    storage: Storage
    offset: int
    """Numbers of the storage before the first of the tensor."""
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    """Numbers of the storage from one entry of each axis to the next."""


@dataclass(frozen=True)
class OtherTensor:
    """A sparse, quantised, nested or otherwise unusual tensor."""

    how: str
    """The function that would rebuild it."""


@dataclass(frozen=True)
class TorchObject:
    """Something else of torch's own, such as a device; what it is does not matter."""

    name: str


@dataclass
class _NumberType:
    """A number type of NumPy's, of which pickled NumPy numbers speak."""

    code: str
    byte_order: str = "<"


_MARK = object()


def parse_structure(pickle: bytes) -> Any:
    """The value of a torch file's pickle: tuples, lists, dicts, numbers, text, and the entries of tensors.

    Raises:
        StructureError: it is damaged, or names something that is neither container, number nor tensor.
    """
    machine = _Machine(pickle)
    try:
        return machine.run()
    except StructureError:
        raise
    except (IndexError, KeyError, TypeError, ValueError, AttributeError, struct.error) as error:
        raise StructureError(f"it is damaged ({type(error).__name__})") from error


class _Machine:
    """A stack, a memory of what may be referred to again, and the instructions."""

    def __init__(self, code: bytes) -> None:
        self.code = code
        self.at = 0
        self.stack: list[Any] = []
        self.memory: dict[int, Any] = {}

    def run(self) -> Any:
        """The value at the end of the program."""
        while (instruction := self.take(1)) != b".":
            if instruction not in _INSTRUCTIONS:
                raise StructureError(f"it has the instruction {instruction!r}")
            _INSTRUCTIONS[instruction](self)
        return self.pop()

    def take(self, count: int) -> bytes:
        """The next bytes."""
        piece = self.code[self.at : self.at + count]
        if len(piece) < count:
            raise StructureError("it ends too early")
        self.at += count
        return piece

    def number(self, layout: str) -> Any:
        """The next number in a layout of `struct`."""
        return struct.unpack(layout, self.take(struct.calcsize(layout)))[0]

    def line(self) -> str:
        """Text up to the end of a line."""
        end = self.code.index(b"\n", self.at)
        text = self.code[self.at : end].decode("utf-8")
        self.at = end + 1
        return text

    def push(self, value: Any) -> None:
        """Put a value on the stack."""
        self.stack.append(value)

    def pop(self) -> Any:
        """Take the top of the stack, which may not be a mark."""
        value = self.stack.pop()
        if value is _MARK:
            raise StructureError("it is damaged")
        return value

    def pop_to_mark(self) -> list[Any]:
        """Take what lies above the last mark."""
        start = len(self.stack) - 1
        while self.stack[start] is not _MARK:
            if start == 0:
                raise StructureError("it is damaged")
            start -= 1
        values = self.stack[start + 1 :]
        del self.stack[start:]
        return values

    def pop_tuple(self, count: int) -> tuple[Any, ...]:
        """Take so many values."""
        return tuple([self.pop() for _ in range(count)][::-1])

    def top(self, kind: type) -> Any:
        """The container on top of the stack."""
        if not isinstance(self.stack[-1], kind):
            raise StructureError("it is damaged")
        return self.stack[-1]

    def extend(self, values: list[Any]) -> None:
        """Append to the list on top of the stack."""
        self.top(list).extend(values)

    def update(self, values: list[Any]) -> None:
        """Enter keys and values in the dict on top of the stack."""
        target = self.top(dict)
        for key, value in zip(values[::2], values[1::2], strict=True):
            if not isinstance(key, (str, int)):  # a tuple of tuples of tuples could take years to hash
                raise StructureError("it has a dict whose keys are neither text nor numbers")
            target[key] = value

    def remember(self, place: int) -> None:
        """Keep the top of the stack in memory."""
        if self.stack[-1] is _MARK:
            raise StructureError("it is damaged")
        self.memory[place] = self.stack[-1]

    def long(self) -> int:
        """An integer of any number of bytes, of which few are taken."""
        data = self.take(self.number("<B"))
        if len(data) > _LONGEST_NUMBER:
            raise StructureError("it has an integer beyond 64 bits")
        return int.from_bytes(data, "little", signed=True)

    def name(self, module: str, name: str) -> None:
        """Put a name on the stack, if it may be there."""
        numpy_name = (module, name) in (
            ("numpy", "dtype"), ("numpy.core.multiarray", "scalar"), ("numpy._core.multiarray", "scalar"),
            ("_codecs", "encode"),
        )  # fmt: skip
        if not numpy_name and module not in _PLAIN_MODULES:
            raise StructureError(f"it names {module}.{name}")
        self.push(Name(module, name))

    def stack_name(self) -> None:
        """As `name`, of two texts on the stack."""
        module, name = self.pop_tuple(2)
        self.name(str(module)[:200], str(name)[:200])

    def call(self) -> None:
        """Replace a name and its arguments by what the call would give, without calling it."""
        function, arguments = self.pop_tuple(2)
        if not isinstance(function, Name) or not isinstance(arguments, tuple):
            raise StructureError("it calls something")
        self.push(_result(function, arguments))

    def build(self) -> None:
        """Give the top of the stack a state: the byte order of a number type; others are passed over."""
        state = self.pop()
        if isinstance(self.stack[-1], _NumberType):
            self.stack[-1].byte_order = ">" if state[1] == ">" else "<"

    def refer(self) -> None:
        """Replace a reference to what lies beside the pickle by the storage that it means."""
        word, kind, key, *_ = self.pop()
        if word != "storage" or not isinstance(kind, Name) or not isinstance(key, str):
            raise StructureError("it refers to something that is no storage")
        self.push(Storage(_STORAGES.get(kind.name, kind.name), key))


def _result(function: Name, arguments: tuple[Any, ...]) -> Any:
    """What a call that torch or NumPy writes stands for."""
    match function.module, function.name:
        case "collections", "OrderedDict":
            return _ordered_dict(*arguments)
        case "torch._utils", "_rebuild_tensor" | "_rebuild_tensor_v2":
            unusual = len(arguments) > 6 and bool(arguments[6])  # negated or conjugated when it is used
            return OtherTensor(function.name) if unusual else _tensor(*arguments[:4])
        case "torch._utils", "_rebuild_tensor_v3":
            storage, offset, shape, strides, _, _, kind, *rest = arguments
            return OtherTensor(function.name) if any(rest) else _tensor(_typed(storage, kind), offset, shape, strides)
        case "torch._utils", "_rebuild_parameter" | "_rebuild_parameter_with_state":
            return arguments[0]
        case (("torch._utils" | "torch._tensor"), name) if name.startswith("_rebuild"):
            return OtherTensor(name[:40])
        case "numpy", "dtype":
            return _number_type(*arguments)
        case (("numpy.core.multiarray" | "numpy._core.multiarray"), "scalar"):
            return _number(*arguments)
        case "_codecs", "encode":
            return _bytes(*arguments)
    return TorchObject(function.name[:40])


def _ordered_dict(items: Any = ()) -> dict[Any, Any]:
    if items:
        raise StructureError("it is damaged")
    return {}


def _tensor(storage: Any, offset: Any, shape: Any, strides: Any) -> TensorEntry:
    numbers = [offset, *shape, *strides]
    if not isinstance(storage, Storage) or len(shape) != len(strides):
        raise StructureError("it is damaged")
    if not all(type(number) is int and number >= 0 for number in numbers):
        raise StructureError("it has a tensor of impossible shape")
    return TensorEntry(storage, offset, tuple(shape), tuple(strides))


def _typed(storage: Any, kind: Any) -> Storage:
    if not isinstance(storage, Storage) or not isinstance(kind, Name):
        raise StructureError("it is damaged")
    return Storage(_TYPES.get(kind.name, kind.name[:40]), storage.key)


def _number_type(code: Any, *_: Any) -> _NumberType:
    if code not in _NUMBERS:
        raise StructureError(f"it has a number of the type {str(code)[:20]}")
    return _NumberType(code)


def _number(kind: Any, data: Any) -> int | float | bool:
    if not isinstance(kind, _NumberType) or not isinstance(data, bytes):
        raise StructureError("it is damaged")
    number: int | float | bool = np.frombuffer(data, kind.byte_order + kind.code, count=1)[0].item()
    return number


def _bytes(text: Any, encoding: Any) -> bytes:
    """Bytes, which torch's version of pickle writes as text."""
    if not isinstance(text, str) or len(text) > _LONGEST_ENCODED or encoding != "latin1":
        raise StructureError("it has text that is encoded")
    return text.encode("latin-1")


def _text(machine: _Machine, layout: str) -> None:
    machine.push(machine.take(machine.number(layout)).decode("utf-8", "surrogatepass"))


_INSTRUCTIONS: dict[bytes, Callable[[_Machine], Any]] = {
    b"\x80": lambda m: m.take(1),  # version
    b"\x95": lambda m: m.take(8),  # frame
    b"(": lambda m: m.push(_MARK),
    b"0": lambda m: m.pop(),
    b"N": lambda m: m.push(None),
    b"\x88": lambda m: m.push(True),
    b"\x89": lambda m: m.push(False),
    b"K": lambda m: m.push(m.number("<B")),
    b"M": lambda m: m.push(m.number("<H")),
    b"J": lambda m: m.push(m.number("<i")),
    b"\x8a": lambda m: m.push(m.long()),
    b"G": lambda m: m.push(m.number(">d")),
    b"X": lambda m: _text(m, "<I"),
    b"\x8c": lambda m: _text(m, "<B"),
    b"C": lambda m: m.push(m.take(m.number("<B"))),
    b")": lambda m: m.push(()),
    b"t": lambda m: m.push(tuple(m.pop_to_mark())),
    b"\x85": lambda m: m.push(m.pop_tuple(1)),
    b"\x86": lambda m: m.push(m.pop_tuple(2)),
    b"\x87": lambda m: m.push(m.pop_tuple(3)),
    b"]": lambda m: m.push([]),
    b"a": lambda m: m.extend([m.pop()]),
    b"e": lambda m: m.extend(m.pop_to_mark()),
    b"}": lambda m: m.push({}),
    b"s": lambda m: m.update(list(m.pop_tuple(2))),
    b"u": lambda m: m.update(m.pop_to_mark()),
    b"q": lambda m: m.remember(m.number("<B")),
    b"r": lambda m: m.remember(m.number("<I")),
    b"\x94": lambda m: m.remember(len(m.memory)),
    b"h": lambda m: m.push(m.memory[m.number("<B")]),
    b"j": lambda m: m.push(m.memory[m.number("<I")]),
    b"c": lambda m: m.name(m.line(), m.line()),
    b"\x93": lambda m: m.stack_name(),
    b"R": lambda m: m.call(),
    b"b": lambda m: m.build(),
    b"Q": lambda m: m.refer(),
}
"""What each instruction does, by its byte in a pickle of version 2 to 5."""
