"""NumPy's .npy and .npz, read without NumPy's own reader, which would evaluate what a header says.

A header must be the plain dict of a type, an order and a shape that NumPy writes. How much memory its array takes is
known before any is taken.
"""

from __future__ import annotations

import math
import re
import struct
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.io.archives import check_packing, open_archive
from gaussian_trimmer.io.reading import file_bytes

_MAGIC = b"\x93NUMPY"
_MAX_HEADER_BYTES = 1 << 16
_MAX_ARRAY_BYTES = 1 << 31
_MAX_DIMENSIONS = 8
_MAX_ARRAYS = 1 << 10
_ENTRY = re.compile(
    r"""\s*['"](descr|fortran_order|shape)['"]\s*:\s*(?:['"]([^'"]*)['"]|(True|False)|\(([\dL,\s]*)\))\s*(?:,|\}|$)"""
)
_NUMBER = re.compile(r"[<>|=]?[biuf][1248]")


@dataclass(frozen=True)
class _Header:
    """What a header says of the array that follows."""

    descr: str
    """NumPy's name of the type; 'structured' for rows of several values."""
    fortran_order: bool
    shape: tuple[int, ...]

    @property
    def is_number(self) -> bool:
        """Whether the type is one of booleans, integers and floats of at most 8 bytes."""
        return _NUMBER.fullmatch(self.descr) is not None and self.descr[-2:] not in ("b2", "b4", "b8", "f1")

    @property
    def n_bytes(self) -> int:
        """Size of the array; of numbers alone."""
        return math.prod(self.shape) * int(self.descr[-1])


def read_npy(path: Path) -> NDArray[Any]:
    """The array of numbers in an .npy file.

    Raises:
        InputError: the file cannot be read, is damaged, or holds something else than booleans or numbers.
    """
    data = file_bytes(path, _MAX_ARRAY_BYTES)
    header, start = _parse(data, path)
    if "O" in header.descr:
        raise _damaged(path, "NumPy array of numbers")
    if not header.is_number:
        raise InputError(f"'{path}' holds values of type {shown(header.descr)}; booleans or numbers are needed.")
    return _array(header, memoryview(data)[start:], path)


def read_npz(path: Path, limit: int) -> dict[str, NDArray[Any]]:
    """The arrays of numbers in an .npz file by name; others, such as text, are left out.

    Arguments:
        limit: bytes that all arrays may have together.

    Raises:
        InputError: the file cannot be read, is damaged, holds no numbers, or more than the limit.
    """
    arrays: dict[str, NDArray[Any]] = {}
    with open_archive(path, "NumPy .npz archive of numbers") as archive:
        entries = [entry for entry in archive.infolist() if entry.filename.endswith(".npy")]
        if len(entries) > _MAX_ARRAYS:
            raise InputError(f"'{path}' holds {len(entries)} arrays; at most {_MAX_ARRAYS} can be read.")
        for entry in entries:
            array = _read_member(archive, entry, limit, path)
            if array is not None:
                limit -= array.nbytes
                arrays[entry.filename.removesuffix(".npy")] = array
    if not arrays:
        raise InputError(f"'{path}' holds no array of numbers.")
    return arrays


def _read_member(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, limit: int, path: Path) -> NDArray[Any] | None:
    """One array of an .npz, or None if it is not of numbers."""
    check_packing(entry, path)
    with archive.open(entry) as file:
        header = _parse_stream(file, path)
        if not header.is_number:
            return None
        if header.n_bytes > min(limit, entry.file_size):
            raise InputError(
                f"'{path}' announces {header.n_bytes} bytes for the array '{shown(entry.filename)}', too many to be "
                "true, or to be a selection of this scene."
            )
        data = file.read(header.n_bytes)
        file.read(1)  # at the end the checksum is compared
    return _array(header, memoryview(data), path)


def _parse(data: bytes, path: Path) -> tuple[_Header, int]:
    """The header at the beginning of the bytes, and where the array begins."""
    length, start = _extent(data[:12], path)
    return _parse_text(data[start : start + length], length, path), start + length


def _parse_stream(file: BinaryIO | Any, path: Path) -> _Header:
    """The header at the beginning of a stream, which stands at the array afterwards."""
    head = file.read(10)
    if head[6:7] > b"\1":
        head += file.read(2)
    length, _ = _extent(head, path)
    return _parse_text(file.read(length), length, path)


def _extent(head: bytes, path: Path) -> tuple[int, int]:
    """Length of the header's text and where it begins."""
    wide = head[6:7] > b"\1"
    if head[:6] != _MAGIC or len(head) < (12 if wide else 10) or head[6] not in (1, 2, 3):
        raise _damaged(path, "NumPy array of numbers")
    length = struct.unpack_from("<I" if wide else "<H", head, 8)[0]
    if length > _MAX_HEADER_BYTES:
        raise _damaged(path, "NumPy array of numbers")
    return length, 12 if wide else 10


def _parse_text(text: bytes, length: int, path: Path) -> _Header:
    """What a header's text says, provided that it is the dict of three entries that NumPy writes."""
    words = text.decode("latin-1").strip()
    if len(text) == length and words.startswith("{") and "[" in words:  # only the type of structured rows is a list
        return _Header("structured", False, ())
    fields: dict[str, tuple[str | None, ...]] = {}
    at = 1
    while words[:1] == "{" and len(fields) < 3 and (entry := _ENTRY.match(words, at)):
        fields[entry[1]] = entry.groups()[1:]
        at = entry.end()
    descr, order, shape = (
        fields.get(name, (None,) * 3)[i] for i, name in enumerate(("descr", "fortran_order", "shape"))
    )
    if len(text) < length or words[at:].strip() not in ("", "}") or descr is None or order is None or shape is None:
        raise _damaged(path, "NumPy array of numbers")
    sizes = [size.strip().removesuffix("L") for size in shape.split(",")]
    if sizes[-1] == "":
        sizes.pop()
    if len(sizes) > _MAX_DIMENSIONS or not all(size.isdigit() and len(size) < 16 for size in sizes):
        raise _damaged(path, "NumPy array of numbers")
    return _Header(descr, order == "True", tuple(map(int, sizes)))


def _array(header: _Header, data: memoryview, path: Path) -> NDArray[Any]:
    """The array that a header announces, a view onto the bytes that follow it where they can serve as they are."""
    count = math.prod(header.shape)
    if header.n_bytes > len(data):
        raise _damaged(path, "NumPy array of numbers")
    kind = np.dtype(header.descr)
    values = np.frombuffer(data, np.uint8 if kind.kind == "b" else kind, count) if count else np.zeros(0, kind)
    if kind.kind == "b":
        values = values != 0  # a boolean that is neither 0 nor 1 would be counted as more than one
    try:
        return values.reshape(header.shape, order="F" if header.fortran_order else "C")
    except ValueError as error:  # an empty array with sizes whose product is beyond all bounds
        raise _damaged(path, "NumPy array of numbers") from error


def _damaged(path: Path, expected: str) -> InputError:
    return InputError(f"'{path}' is damaged or no {expected}; save it again with NumPy, without pickled objects.")
