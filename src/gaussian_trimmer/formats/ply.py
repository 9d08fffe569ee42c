"""The standard splat PLY: one vertex element with the Inria property names, binary or ascii.

Property order is free, nx/ny/nz are optional, and unknown scalar columns are kept as extras. A binary file whose
columns are all little-endian float32 is memory-mapped, so that columns nobody asks for are never read.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.whole import whole_file
from gaussian_trimmer.gaussians import FloatArray, Gaussians

_SCALAR_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_POSITION = ["x", "y", "z"]
_NORMAL = ["nx", "ny", "nz"]
_DC = ["f_dc_0", "f_dc_1", "f_dc_2"]
_SCALE = ["scale_0", "scale_1", "scale_2"]
_ROTATION = ["rot_0", "rot_1", "rot_2", "rot_3"]
_REQUIRED = [*_POSITION, *_DC, "opacity", *_SCALE, *_ROTATION]
_REST_COUNTS = (0, 9, 24, 45)
_MAX_HEADER_BYTES = 1 << 20
_ROWS_PER_CHUNK = 1 << 16


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
        InputError: the file is missing, is no PLY, or its header is damaged.
    """
    try:
        with path.open("rb") as file:
            return _parse_header(file, path)
    except OSError as error:
        raise InputError(f"Cannot read '{path}': {error.strerror}.") from error


def read_columns(path: Path, header: Header) -> dict[str, NDArray[Any]]:
    """All columns of the vertex element, by name, as views onto the mapped file where it is binary.

    Raises:
        InputError: the vertex element is missing, has list properties, is not the first element, or is truncated.
    """
    vertex = next((element for element in header.elements if element.name == "vertex"), None)
    if vertex is None:
        raise InputError(f"'{path}' has no vertex element, so it holds no Gaussians.")
    if header.elements[0] is not vertex:
        raise InputError(f"'{path}' has other elements before its vertices; save it as a standard splat PLY.")
    if any(kind == "list" for _, kind in vertex.properties):
        raise InputError(f"'{path}' has list properties in its vertices, as a mesh has; a splat PLY has scalars alone.")
    names = [name for name, _ in vertex.properties]
    if len(set(names)) < len(names):
        raise InputError(f"'{path}' names a vertex property twice.")
    if vertex.count == 0:
        raise InputError(f"'{path}' holds zero Gaussians.")
    return _ascii_columns(path, header, vertex) if header.encoding == "ascii" else _binary_columns(path, header, vertex)


def read(path: Path) -> Gaussians:
    """The Gaussians of a splat PLY, rows in file order.

    Raises:
        InputError: the file is missing, is no splat PLY, is truncated, or holds no Gaussians or non-finite values.
    """
    columns = read_columns(path, read_header(path))
    missing = [name for name in _REQUIRED if name not in columns]
    if missing:
        raise InputError(f"'{path}' is no splat PLY: its vertices lack {', '.join(missing)}.")
    rest = sorted((name for name in columns if re.fullmatch(r"f_rest_\d+", name)), key=lambda name: int(name[7:]))
    if len(rest) not in _REST_COUNTS or rest != [f"f_rest_{i}" for i in range(len(rest))]:
        raise InputError(f"'{path}' has {len(rest)} f_rest columns; a splat PLY has 0, 9, 24 or 45, numbered from 0.")
    known = {*_REQUIRED, *_NORMAL, *rest}
    n = len(columns["x"])
    gaussians = Gaussians(
        means=_block(columns, _POSITION),
        log_scales=_block(columns, _SCALE),
        quaternions=_block(columns, _ROTATION),
        opacity_logits=np.asarray(columns["opacity"], np.float32),
        sh_dc=_block(columns, _DC),
        sh_rest=_block(columns, rest).reshape(n, 3, len(rest) // 3),
        extras={name: column for name, column in columns.items() if name not in known},
    )
    check_finite(gaussians, path)
    return gaussians


def write(gaussians: Gaussians, path: Path, *, extras: bool = False) -> None:
    """Write a binary little-endian splat PLY with the Inria properties in the Inria order, normals zero.

    Extra columns are left out unless asked for, since some viewers refuse properties that they do not know.
    """
    rest = gaussians.sh_rest.shape[1] * gaussians.sh_rest.shape[2]
    names = [*_POSITION, *_NORMAL, *_DC, *[f"f_rest_{i}" for i in range(rest)], "opacity", *_SCALE, *_ROTATION]
    fields = [(name, "<f4") for name in names]
    if extras:
        fields += [(name, column.dtype.newbyteorder("<").str) for name, column in gaussians.extras.items()]
    row_type = np.dtype(fields)
    ply_types = {kind: name for name, kind in _SCALAR_TYPES.items() if not name[-1].isdigit()}
    header = "ply\nformat binary_little_endian 1.0\n" + f"element vertex {len(gaussians)}\n"
    header += "".join(f"property {ply_types[kind[1:]]} {name}\n" for name, kind in fields) + "end_header\n"
    with whole_file(path) as part, part.open("wb") as file:
        file.write(header.encode("ascii"))
        for start in range(0, len(gaussians), _ROWS_PER_CHUNK):
            _rows(gaussians.select(slice(start, start + _ROWS_PER_CHUNK)), row_type, len(names)).tofile(file)


def check_finite(gaussians: Gaussians, path: Path) -> None:
    """Refuse NaN, infinities and zero-length quaternions.

    Raises:
        InputError: a value is not finite; the message says in which attribute and row.
    """
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"):
        values = getattr(gaussians, name)
        for start in range(0, len(values), _ROWS_PER_CHUNK):
            chunk = values[start : start + _ROWS_PER_CHUNK]
            chunk = chunk.reshape(len(chunk), int(np.prod(values.shape[1:])))
            # A sum is finite unless an entry is not (or it overflows, which the exact test below decides).
            with np.errstate(invalid="ignore", over="ignore"):
                if np.isfinite(chunk.sum(dtype=np.float64)) and not (name == "quaternions" and (chunk == 0).any()):
                    continue
            bad = ~np.isfinite(chunk).all(axis=1)
            if bad.any():
                row = start + int(np.argmax(bad))
                raise InputError(
                    f"'{path}' holds NaN or infinite {name}, first in row {row}; remove such Gaussians first."
                )
            if name == "quaternions" and (zero := ~chunk.any(axis=1)).any():
                raise InputError(
                    f"'{path}' holds a rotation quaternion of length zero in row {start + int(np.argmax(zero))}."
                )


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
                raise InputError(f"'{path}' has a line in its PLY header that cannot be understood: {line!r}.")
    if not encoding or not elements:
        raise InputError(f"'{path}' has a PLY header without a format or without elements.")
    return Header(encoding, tuple(Element(name, count, tuple(props)) for name, count, props in elements), file.tell())


def _binary_columns(path: Path, header: Header, vertex: Element) -> dict[str, NDArray[Any]]:
    order = "<" if header.encoding == "binary_little_endian" else ">"
    row_type = np.dtype([(name, order + kind) for name, kind in vertex.properties])
    needed, present = vertex.count * row_type.itemsize, path.stat().st_size - header.size
    if present < needed:
        raise InputError(
            f"'{path}' is truncated: {vertex.count} Gaussians need {needed} bytes after the header, not {present}."
        )
    if all(kind == "f4" for _, kind in vertex.properties) and order == "<":
        matrix = np.memmap(path, "<f4", "r", header.size, (vertex.count, len(vertex.properties)))
        return {name: matrix[:, i] for i, (name, _) in enumerate(vertex.properties)}
    rows = np.memmap(path, row_type, "r", header.size, (vertex.count,))
    return {name: rows[name] for name, _ in vertex.properties}


def _ascii_columns(path: Path, header: Header, vertex: Element) -> dict[str, NDArray[Any]]:
    # Two characters a value are the least that ascii takes, so a count beyond that is a lie that must not cost memory.
    if vertex.count * len(vertex.properties) * 2 > path.stat().st_size:
        raise InputError(f"'{path}' is truncated: it is too short for the {vertex.count} Gaussians that it announces.")
    with path.open("rb") as file:
        file.seek(header.size)
        try:
            table = np.loadtxt(file, np.float64, comments=None, max_rows=vertex.count, ndmin=2)
        except ValueError as error:
            raise InputError(
                f"'{path}' is damaged: a row of its ascii data is not {len(vertex.properties)} numbers."
            ) from error
    if table.shape != (vertex.count, len(vertex.properties)):
        raise InputError(
            f"'{path}' is truncated or damaged: {vertex.count} rows of {len(vertex.properties)} numbers are announced, "
            f"{table.shape[0]} rows of {table.shape[1]} are there."
        )
    return {name: table[:, i].astype(kind) for i, (name, kind) in enumerate(vertex.properties)}


def _block(columns: dict[str, NDArray[Any]], names: list[str]) -> FloatArray:
    """Named columns as one (N, len(names)) array: a view where they lie side by side in memory, else a copy."""
    if not names:
        return np.zeros((len(columns["x"]), 0), np.float32)
    first, parent = columns[names[0]], columns[names[0]].base
    if isinstance(parent, np.memmap) and parent.ndim == 2 and first.strides[0] == parent.strides[0]:
        offsets = [columns[name].ctypes.data - parent.ctypes.data for name in names]
        if offsets == [offsets[0] + 4 * i for i in range(len(names))]:
            view: FloatArray = parent[:, offsets[0] // 4 : offsets[0] // 4 + len(names)].view(np.ndarray)
            return view
    return np.column_stack([np.asarray(columns[name], np.float32) for name in names])


def _rows(gaussians: Gaussians, row_type: np.dtype[Any], n_float: int) -> NDArray[Any]:
    """Structured rows of the standard columns, followed by as many extras as the row type asks for."""
    n = len(gaussians)
    standard = [gaussians.means, np.zeros((n, 3), np.float32), gaussians.sh_dc, gaussians.sh_rest.reshape(n, -1)]
    standard += [gaussians.opacity_logits[:, None], gaussians.log_scales, gaussians.quaternions]
    floats = np.concatenate(standard, axis=1, dtype=np.float32)
    assert floats.shape[1] == n_float
    assert row_type.names is not None
    if len(row_type.names) == n_float:
        return floats
    rows = np.empty(n, row_type)
    for i, name in enumerate(row_type.names):
        rows[name] = floats[:, i] if i < n_float else gaussians.extras[name]
    return rows
