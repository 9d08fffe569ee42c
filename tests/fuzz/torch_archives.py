"""Files as torch.save writes them, made without torch: a pickle of its few instructions, and storages beside it."""

from __future__ import annotations

import io
import struct
import zipfile
from typing import Any

import numpy as np

_STORAGES = {
    "f4": "FloatStorage", "f8": "DoubleStorage", "f2": "HalfStorage", "i8": "LongStorage", "i4": "IntStorage",
    "i2": "ShortStorage", "i1": "CharStorage", "u1": "ByteStorage", "b1": "BoolStorage",
}  # fmt: skip


class Raw(bytes):
    """Instructions that leave one value on the stack."""


def torch_file(value: Any, *, name: str = "archive", storages: dict[str, bytes] | None = None) -> bytes:
    """The archive of a value made of tuples, lists, dicts, numbers, text, None, arrays and `Raw`."""
    found: dict[str, bytes] = {}
    structure = b"\x80\x02" + _code(value, found) + b"."
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr(f"{name}/data.pkl", structure)
        archive.writestr(f"{name}/byteorder", "little")
        for key, data in (found | (storages or {})).items():
            archive.writestr(f"{name}/data/{key}", data)
        archive.writestr(f"{name}/version", "3\n")
    return target.getvalue()


def named(module: str, name: str) -> bytes:
    """The instruction that puts a function or class on the stack."""
    return b"c" + module.encode() + b"\n" + name.encode() + b"\n"


def storage(kind: str, key: str, count: int) -> Raw:
    """A storage of torch's, by the name of its class."""
    return Raw(
        b"(" + _text("storage") + named("torch", kind) + _text(key) + _text("cpu") + _integer(count) + b"tQ"
    )  # a tuple, and the instruction that refers to something outside


def tensor(numbers: Raw, offset: int, shape: tuple[int, ...], strides: tuple[int, ...]) -> Raw:
    """A tensor that lies in a storage in some way."""
    empty = named("collections", "OrderedDict") + b")R"
    return Raw(
        named("torch._utils", "_rebuild_tensor_v2")
        + b"("
        + numbers
        + _integer(offset)
        + _code(shape, {})
        + _code(strides, {})
        + b"\x89"
        + empty
        + b"tR"
    )


def _code(value: Any, found: dict[str, bytes]) -> bytes:
    match value:
        case Raw():
            return bytes(value)
        case None:
            return b"N"
        case bool():
            return b"\x88" if value else b"\x89"
        case int():
            return _integer(value)
        case float():
            return b"G" + struct.pack(">d", value)
        case str():
            return _text(value)
        case np.ndarray():
            key = str(len(found))
            found[key] = np.ascontiguousarray(value).tobytes()
            strides = tuple(step // value.itemsize for step in np.ascontiguousarray(value).strides)
            return tensor(storage(_STORAGES[value.dtype.str[1:]], key, value.size), 0, value.shape, strides)
        case tuple():
            return b"(" + b"".join(_code(entry, found) for entry in value) + b"t"
        case list():
            return b"](" + b"".join(_code(entry, found) for entry in value) + b"e"
        case dict():
            entries = (_code(key, found) + _code(entry, found) for key, entry in value.items())
            return b"}(" + b"".join(entries) + b"u"
    raise TypeError(type(value))


def _text(text: str) -> bytes:
    data = text.encode("utf-8", "surrogatepass")
    return b"X" + struct.pack("<I", len(data)) + data


def _integer(number: int) -> bytes:
    if -(2**31) <= number < 2**31:
        return b"J" + struct.pack("<i", number)
    data = number.to_bytes(number.bit_length() // 8 + 1, "little", signed=True)
    return b"\x8a" + bytes([len(data)]) + data
