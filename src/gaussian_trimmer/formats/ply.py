"""The standard splat PLY: a vertex element with the Inria property names, binary or ascii.

Property order is free, nx/ny/nz are optional, and unknown scalar columns are kept as extras.

A binary file whose columns are all little-endian float32 is read as one table, of which the arrays are views; the
centres alone are copied, since nearly every step looks at all of them. The file is not mapped: a mapping of a file that
someone shortens kills the process that looks at it.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.formats.packing import thicken_discs, with_finite_limits
from gaussian_trimmer.gaussians import FloatArray, Gaussians, IntArray
from gaussian_trimmer.io.reading import read_into
from gaussian_trimmer.io.writing import atomic_file, write_array

_POSITION_NAMES = ["x", "y", "z"]
_NORMAL_NAMES = ["nx", "ny", "nz"]
_DC_NAMES = ["f_dc_0", "f_dc_1", "f_dc_2"]
_SCALE_NAMES = ["scale_0", "scale_1", "scale_2"]
_ROTATION_NAMES = ["rot_0", "rot_1", "rot_2", "rot_3"]
_REQUIRED_NAMES = [*_POSITION_NAMES, *_DC_NAMES, "opacity", *_SCALE_NAMES, *_ROTATION_NAMES]
_REST_COUNTS = (0, 9, 24, 45)
_RELATIVES = {
    "f_anchor_feat_0": "It is of Scaffold-GS, as InstanceGaussian's: anchors, of which networks make each view's "
    "Gaussians. Train 3D Gaussian Splatting on the same pictures and cameras, and carry the object over by masks that "
    "the method renders: 'gaussian-trimmer select SCENE --masks DIR --cameras PATH'.",
}
"""Column that tells another kind of file -> what it is, and what to do."""
# What is written together stays in the cache: 4096 rows of SH degree 3 have about a megabyte.
_ROWS_PER_WRITE = 1 << 12
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


def read(path: Path) -> Gaussians:
    """Return the Gaussians of a splat PLY, rows in file order.

    Opacity logits of plus or minus infinity and log scales of minus infinity, which converters write for opacities of
    0 and 1 and for scales of 0, become the finite values that stand for these in all formats. Discs of 2D Gaussian
    Splatting, without a scale_2, become thin Gaussians.

    Raises:
        InputError: the file is missing, is not a splat PLY, is truncated, or holds no Gaussians, or values that are not
            finite or extreme.
    """
    columns = read_columns(path, read_header(path))
    if "scale_2" not in columns and {"scale_0", "scale_1"} <= columns.keys():
        columns["scale_2"] = thicken_discs(_block(columns, _SCALE_NAMES[:2]))[:, 2]
    missing = [name for name in _REQUIRED_NAMES if name not in columns]
    if missing:
        hint = next((f" {hint}" for name, hint in _RELATIVES.items() if name in columns), "")
        raise InputError(f"'{path}' is not a splat PLY: its vertices lack {', '.join(missing)}.{hint}")
    rest = sorted((name for name in columns if re.fullmatch(r"f_rest_\d+", name)), key=lambda name: int(name[7:]))
    if len(rest) not in _REST_COUNTS or rest != [f"f_rest_{i}" for i in range(len(rest))]:
        raise InputError(f"'{path}' has {len(rest)} f_rest columns; a splat PLY has 0, 9, 24 or 45, numbered from 0.")
    known = {*_REQUIRED_NAMES, *_NORMAL_NAMES, *rest}
    n = len(columns["x"])
    means = np.ascontiguousarray(_block(columns, _POSITION_NAMES))
    means.flags.writeable = False
    gaussians = Gaussians(
        means=means,
        log_scales=_block(columns, _SCALE_NAMES),
        quaternions=_block(columns, _ROTATION_NAMES),
        opacity_logits=_block(columns, ["opacity"])[:, 0],
        sh_dc=_block(columns, _DC_NAMES),
        sh_rest=_block(columns, rest).reshape(n, 3, len(rest) // 3),
        extras={name: column for name, column in columns.items() if name not in known},
    )
    return with_finite_limits(gaussians)


def write(gaussians: Gaussians, path: Path, *, extras: bool = False) -> None:
    """Write a binary little-endian splat PLY with the Inria properties in the Inria order, normals zero.

    Extra columns are left out unless asked for, since some viewers refuse properties that they do not know.

    Raises:
        ValueError: an extra column is of a type, or has a name, that a PLY cannot hold.
    """
    _write_chunks(_chunks(gaussians), gaussians, len(gaussians), path, extras=extras)


def write_selected(gaussians: Gaussians, rows: IntArray, appended: Gaussians, path: Path) -> None:
    """Write `concatenate([gaussians.select(rows), appended])`, gathering few rows at a time, without extra columns.

    A background is nearly as large as its scene; gathered whole it would need that memory again, and several times
    as long.

    Raises:
        ValueError: the SH degrees of the two parts differ.
    """
    if len(appended) and appended.sh_degree != gaussians.sh_degree:
        raise ValueError(f"The parts have SH degrees {gaussians.sh_degree} and {appended.sh_degree}; equal are needed.")
    bare, tail = gaussians.replace(extras={}), appended.replace(extras={})
    starts = range(0, len(rows), _ROWS_PER_WRITE)
    gathered = (bare.select(rows[start : start + _ROWS_PER_WRITE]) for start in starts)
    _write_chunks(chain(gathered, _chunks(tail)), bare, len(rows) + len(tail), path, extras=False)


def _chunks(gaussians: Gaussians) -> Iterator[Gaussians]:
    for start in range(0, len(gaussians), _ROWS_PER_WRITE):
        yield gaussians.select(slice(start, start + _ROWS_PER_WRITE))


def _write_chunks(chunks: Iterable[Gaussians], like: Gaussians, count: int, path: Path, *, extras: bool) -> None:
    """Write chunks of `count` Gaussians in all, whose columns are those of `like`."""
    rest = like.sh_rest.shape[1] * like.sh_rest.shape[2]
    names = [
        *_POSITION_NAMES,
        *_NORMAL_NAMES,
        *_DC_NAMES,
        *[f"f_rest_{i}" for i in range(rest)],
        "opacity",
        *_SCALE_NAMES,
        *_ROTATION_NAMES,
    ]
    fields = [(name, "<f4") for name in names]
    if extras:
        fields += [(name, column.dtype.newbyteorder("<").str) for name, column in like.extras.items()]
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
    header += "".join(property_line(name, kind) for name, kind in fields) + "end_header\n"
    row_type = np.dtype(fields)
    with atomic_file(path) as part, part.open("wb") as file:
        file.write(header.encode("ascii"))
        for chunk in chunks:
            write_array(file, _rows(chunk, row_type, len(names)))


def _block(columns: dict[str, NDArray[Any]], names: list[str]) -> FloatArray:
    """Named columns as one (N, len(names)) array: a view where they lie side by side in memory, else a copy."""
    if not names:
        return np.zeros((len(columns["x"]), 0), np.float32)
    parent = columns[names[0]].base
    if isinstance(parent, np.ndarray) and parent.ndim == 2:
        offsets = [columns[name].ctypes.data - parent.ctypes.data for name in names]
        if offsets == [offsets[0] + 4 * i for i in range(len(names))]:
            view: FloatArray = parent[:, offsets[0] // 4 : offsets[0] // 4 + len(names)]
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
