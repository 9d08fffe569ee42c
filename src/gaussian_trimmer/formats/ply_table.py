"""PLY files as tables: the header, and the columns of one element, binary or ascii."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.io.reading import read_into

_SCALAR_TYPES = {
    name: number_type
    for number_type, names in {
        "i1": ("char", "int8"),
        "u1": ("uchar", "uint8"),
        "i2": ("short", "int16"),
        "u2": ("ushort", "uint16"),
        "i4": ("int", "int32"),
        "u4": ("uint", "uint32"),
        "f4": ("float", "float32"),
        "f8": ("double", "float64"),
    }.items()
    for name in names
}
_MAX_HEADER_BYTES = 1 << 20


@dataclass(frozen=True)
class Element:
    """One element of a PLY header."""

    name: str
    count: int
    properties: tuple[tuple[str, str], ...]
    """(name, NumPy type without byte order); the type of a list property is 'list'."""


@dataclass(frozen=True)
class Header:
    """What a PLY file says of itself before its data."""

    encoding: str
    """'ascii', 'binary_little_endian' or 'binary_big_endian'."""
    elements: tuple[Element, ...]
    size: int
    """Bytes before the data."""


def read_header(path: Path) -> Header:
    """Parse the header of a PLY file.

    Raises:
        InputError: the file is missing, is not a PLY, or its header is damaged.
    """
    try:
        with path.open("rb") as file:
            return _parse_header(file, path)
    except OSError as error:
        raise InputError(f"Cannot read '{path}': {error.strerror}.") from error


def read_columns(path: Path, header: Header, name: str = "vertex") -> dict[str, NDArray[Any]]:
    """All columns of one element, the vertices if not named.

    Columns of a binary file are views onto one table of its rows, (N, number of properties) where all of them are
    little-endian float32; nobody writes to them.

    Raises:
        InputError: the element is missing, it or one before it has list properties, or the file is truncated.
    """
    names = [element.name for element in header.elements]
    if name not in names:
        raise InputError(f"'{path}' has no {name} element, so it holds no Gaussians.")
    *before, element = header.elements[: names.index(name) + 1]
    if any(kind == "list" for part in (*before, element) for _, kind in part.properties):
        raise InputError(f"'{path}' has list properties, as a mesh has; a splat PLY has only scalars.")
    if len({name for name, _ in element.properties}) < len(element.properties):
        raise InputError(f"'{path}' names a property of its {name} element twice.")
    if element.count == 0 or not element.properties:
        raise InputError(f"'{path}' holds zero Gaussians.")
    if header.encoding == "ascii":
        return _ascii_columns(path, header, element, before)
    return _binary_columns(path, header, element, before)


def _parse_header(file: BinaryIO, path: Path) -> Header:
    if file.readline(8).rstrip() != b"ply":
        raise InputError(f"'{path}' is not a PLY file: it does not begin with 'ply'.")
    encoding = ""
    elements: list[tuple[str, int, list[tuple[str, str]]]] = []
    while True:
        line = file.readline(4096)
        if not line.endswith(b"\n") or file.tell() > _MAX_HEADER_BYTES:
            raise InputError(f"'{path}' has a PLY header without an end.")
        match line.decode("ascii", "replace").split():
            case ["end_header"]:
                break
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as encoding, "1.0"]:
                pass
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["element", name, count] if count.isascii() and count.isdigit():
                elements.append((name, int(count), []))
            case ["property", kind, name] if kind in _SCALAR_TYPES and elements:
                elements[-1][2].append((name, _SCALAR_TYPES[kind]))
            case ["property", "list", _, _, name] if elements:
                elements[-1][2].append((name, "list"))
            case _:
                words = clip_name(line.decode("ascii", "replace").rstrip())
                raise InputError(f"'{path}' has a line in its PLY header that cannot be understood: '{words}'.")
    if not encoding or not elements:
        raise InputError(f"'{path}' has a PLY header without a format or without elements.")
    return Header(encoding, tuple(Element(name, count, tuple(props)) for name, count, props in elements), file.tell())


def property_line(name: str, kind: str) -> str:
    """Return the header's line for a column of a NumPy type such as '<f4'.

    Raises:
        ValueError: a PLY has no such type, or cannot hold the name.
    """
    ply_types = {code: word for word, code in _SCALAR_TYPES.items() if not word[-1].isdigit()}
    if kind[1:] not in ply_types or not name.isascii() or len(name.split()) != 1:
        raise ValueError(f"A PLY cannot hold a column '{name}' of type {kind}; cast it to float32, int32 or uint8.")
    return f"property {ply_types[kind[1:]]} {name}\n"


def _row_type(header: Header, element: Element) -> np.dtype[Any]:
    order = "<" if header.encoding == "binary_little_endian" else ">"
    return np.dtype([(f"{i}", order + kind) for i, (_, kind) in enumerate(element.properties)])


def _binary_columns(path: Path, header: Header, element: Element, before: list[Element]) -> dict[str, NDArray[Any]]:
    row_type = _row_type(header, element)
    start = header.size + sum(part.count * _row_type(header, part).itemsize for part in before)
    needed, present = element.count * row_type.itemsize, max(0, path.stat().st_size - start)
    if present < needed:
        raise InputError(
            f"'{path}' is truncated: {element.count} Gaussians need {needed} bytes after the header, not {present}."
        )
    names = [name for name, _ in element.properties]
    all_float = all(row_type[i] == np.dtype("<f4") for i in range(len(names)))
    table = np.empty((element.count, len(names)), "<f4") if all_float else np.empty(element.count, row_type)
    with path.open("rb") as file:
        file.seek(start)
        read_into(table, file, path)
    table.flags.writeable = False
    return {name: table[:, i] if all_float else table[f"{i}"] for i, name in enumerate(names)}


def _ascii_columns(path: Path, header: Header, element: Element, before: list[Element]) -> dict[str, NDArray[Any]]:
    # Two characters a value are the least that ascii takes, so a count beyond that is a lie that must not cost memory.
    width, first = len(element.properties), sum(part.count for part in before)
    if first + element.count * width * 2 > path.stat().st_size:
        raise InputError(f"'{path}' is truncated: it is too short for the {element.count} Gaussians that it announces.")
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that there are no rows is said below
        file.seek(header.size)
        lines = islice((line for line in file if line.strip()), first, first + element.count)
        try:
            table = np.loadtxt(lines, np.float64, comments=None, ndmin=2)
        except ValueError as error:
            raise InputError(f"'{path}' is damaged: a row of its ascii data is not {width} numbers.") from error
    if table.shape != (element.count, width):
        raise InputError(
            f"'{path}' is truncated or damaged: {element.count} rows of {width} numbers are announced, "
            f"{table.shape[0]} rows of {table.shape[1]} are there."
        )
    return {name: table[:, i].astype(kind) for i, (name, kind) in enumerate(element.properties)}
