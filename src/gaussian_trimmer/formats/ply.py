"""The standard splat PLY: a vertex element with the Inria property names, binary or ascii.

Property order is free, nx/ny/nz are optional, and unknown scalar columns are kept as extras.

A binary file is read as one table, of which little-endian float32 columns are views; the centres alone are copied,
since nearly every step looks at all of them. The file is not mapped: a mapping of a file that someone shortens kills
the process that looks at it.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured, unstructured_to_structured
from numpy.typing import NDArray

from gaussian_trimmer.cameras import vector_of_up
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.formats.packing import CUT_TO_DEGREE_3, thicken_discs, with_finite_limits
from gaussian_trimmer.gaussians import FloatArray, Gaussians, IntArray, SplatModel
from gaussian_trimmer.io.reading import read_into
from gaussian_trimmer.io.writing import atomic_file, write_array

_POSITION_NAMES = ["x", "y", "z"]
_NORMAL_NAMES = ["nx", "ny", "nz"]
_DC_NAMES = ["f_dc_0", "f_dc_1", "f_dc_2"]
_SCALE_NAMES = ["scale_0", "scale_1", "scale_2"]
_ROTATION_NAMES = ["rot_0", "rot_1", "rot_2", "rot_3"]
_REST_COUNTS = (0, 9, 24, 45, 72)
_KEPT_COEFFICIENTS = 15
_NUMBERED_NAME = r"n?[xyz]|f_dc_[012]|f_rest_\d+|opacity|scale_[012]|rot_[0123]"
_SPLAT_NAME = re.compile(_NUMBERED_NAME)
_CLOUDCOMPARE = re.compile(rf"(?:scalar_|scal_)+(?={_NUMBERED_NAME}$)")
"""What CloudCompare puts before the names of columns, once or twice."""
_VERTICAL = re.compile(r"vertical axis: *(.+)", re.IGNORECASE)
_MODEL = re.compile(r"(?:splatrendermode:|antialiased:?) *(\w+)", re.IGNORECASE)
_MODEL_COMMENTS: dict[SplatModel, tuple[str, ...]] = {
    "default": (),
    "antialiased": ("comment SplatRenderMode: mip",),
    "2dgs": ("comment SplatRenderMode: 2dgs",),
}
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
    header = read_header(path)
    table = read_table(path, header)
    names = table.dtype.names or ()
    scales = _SCALE_NAMES if "scale_2" in names else _SCALE_NAMES[:2]
    required = [*_POSITION_NAMES, *_DC_NAMES, "opacity", *scales, *_ROTATION_NAMES]
    if missing := [name for name in required if name not in names]:
        hint = next((f" {hint}" for name, hint in _RELATIVES.items() if name in names), "")
        if len(missing) == len(required) - len(_POSITION_NAMES):
            hint = hint or " It holds a point cloud or a mesh: export the Gaussian splat instead."
        raise InputError(f"'{path}' is not a splat PLY: its vertices lack {', '.join(missing)}.{hint}")
    rest = [name for name in names if re.fullmatch(r"f_rest_\d+", name)]
    numbered = [f"f_rest_{i}" for i in range(len(rest))]
    if len(rest) not in _REST_COUNTS or {*rest} != {*numbered}:
        raise InputError(
            f"'{path}' has {len(rest)} f_rest columns; a splat PLY has 0, 9, 24, 45 or 72, numbered from 0."
        )
    means = np.ascontiguousarray(_columns(table, _POSITION_NAMES))
    means.flags.writeable = False
    log_scales = _columns(table, scales)
    sh_rest = _columns(table, numbered).reshape(len(table), 3, len(rest) // 3)
    gaussians = Gaussians(
        means=means,
        log_scales=log_scales if len(scales) == 3 else thicken_discs(log_scales),
        quaternions=_columns(table, _ROTATION_NAMES),
        opacity_logits=table["opacity"],
        sh_dc=_columns(table, _DC_NAMES),
        sh_rest=sh_rest[..., :_KEPT_COEFFICIENTS],
        extras={name: table[name] for name in names if name not in {*required, *_NORMAL_NAMES, *rest}},
        format_up=_stated_up(header),
        model="2dgs" if len(scales) == 2 else stated_model(header),
        notes=(CUT_TO_DEGREE_3,) if sh_rest.shape[2] > _KEPT_COEFFICIENTS else (),
    )
    return with_finite_limits(gaussians)


def stated_model(header: Header) -> SplatModel:
    """Return the model that a comment of Brush, splat-transform or Postshot states."""
    said = [found[1].lower() for found in map(_MODEL.fullmatch, header.comments) if found]
    models: dict[str, SplatModel] = {"mip": "antialiased", "1": "antialiased", "2dgs": "2dgs"}
    return models.get(said[-1] if said else "", "default")


def _stated_up(header: Header) -> tuple[float, float, float] | None:
    """Return the vertical axis that nerfstudio and Brush state; a bare y, once a constant of Brush's, is none."""
    found = next(filter(None, map(_VERTICAL.fullmatch, header.comments)), None)
    if found is None or found[1].lower() == "y":
        return None
    try:
        x, y, z = vector_of_up(found[1] if len(found[1].split()) == 1 else [float(word) for word in found[1].split()])
        return x, y, z
    except ValueError:  # InputErrors are such, too
        return None


def write(gaussians: Gaussians, path: Path, *, extras: bool = False) -> None:
    """Write a binary little-endian splat PLY with the Inria properties in the Inria order, normals zero.

    Extra columns are left out unless asked for, since some viewers refuse properties that they do not know.

    Raises:
        ValueError: an extra column is of a type, or has a name, that a PLY cannot hold.
    """
    gaussians = gaussians if extras else gaussians.replace(extras={})
    _write_chunks(_chunks(gaussians), gaussians, len(gaussians), path)


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
    _write_chunks(chain(gathered, _chunks(tail)), bare, len(rows) + len(tail), path)


def _chunks(gaussians: Gaussians) -> Iterator[Gaussians]:
    for start in range(0, len(gaussians), _ROWS_PER_WRITE):
        yield gaussians.select(slice(start, start + _ROWS_PER_WRITE))


def _write_chunks(chunks: Iterable[Gaussians], like: Gaussians, count: int, path: Path) -> None:
    """Write chunks of `count` Gaussians in all, whose columns are those of `like`."""
    rest = [f"f_rest_{i}" for i in range(3 * like.sh_rest.shape[2])]
    names = [*_POSITION_NAMES, *_NORMAL_NAMES, *_DC_NAMES, *rest, "opacity", *_SCALE_NAMES, *_ROTATION_NAMES]
    extras = [(name, column.dtype.newbyteorder("<").str) for name, column in like.extras.items()]
    row_type = np.dtype([*((name, "<f4") for name in names), *extras])
    with atomic_file(path) as part, part.open("wb") as file:
        file.write(header_of({"vertex": (count, row_type)}, model=like.model))
        for chunk in chunks:
            write_array(file, _rows(chunk, row_type, names))


def _rows(gaussians: Gaussians, row_type: np.dtype[Any], names: list[str]) -> NDArray[Any]:
    """Return the rows (N,) of the named columns, in float32, and of the extra ones that the type has."""
    n, rows = len(gaussians), np.empty(len(gaussians), row_type)
    columns = [gaussians.means, np.zeros((n, 3), np.float32), gaussians.sh_dc, gaussians.sh_rest.reshape(n, -1)]
    columns += [gaussians.opacity_logits[:, None], gaussians.log_scales, gaussians.quaternions]
    np.concatenate(columns, axis=1, out=_columns(rows, names))
    for name, column in gaussians.extras.items():
        rows[name] = column
    return rows


def _columns(table: NDArray[Any], names: list[str]) -> FloatArray:
    """Return columns of a table (N,) as (N, K) in float32: a view of it where they are that already, side by side."""
    if not names:
        return np.zeros((len(table), 0), np.float32)
    return np.asarray(structured_to_unstructured(table[names], np.float32, copy=False))


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
    comments: tuple[str, ...] = ()

    def names(self, element: str) -> list[str]:
        """Return the names of an element's properties; none where the file has no such element."""
        return [name for found in self.elements if found.name == element for name, _ in found.properties]

    def row_type(self, element: Element) -> np.dtype[Any]:
        """Return how a row of an element lies in the file."""
        order = ">" if self.encoding == "binary_big_endian" else "<"
        return np.dtype([(name, order + kind) for name, kind in element.properties])


def header_of(elements: Mapping[str, tuple[int, np.dtype[Any]]], *, model: SplatModel) -> bytes:
    """Return the header of a binary little-endian PLY with elements of so many rows of a type, by their names.

    Their model is said as Brush and splat-transform say it.

    Raises:
        ValueError: a PLY has no column of such a type, or cannot hold its name.
    """
    ply_types = {code: word for word, code in _SCALAR_TYPES.items() if not word[-1].isdigit()}
    lines = ["ply", "format binary_little_endian 1.0", *_MODEL_COMMENTS[model]]
    for element, (count, row_type) in elements.items():
        lines.append(f"element {element} {count}")
        for name in row_type.names or ():
            kind = row_type[name].str
            if kind[1:] not in ply_types or not name.isascii() or len(name.split()) != 1:
                raise ValueError(
                    f"A PLY cannot hold a column '{name}' of type {kind}; cast it to float32, int32 or uint8."
                )
            lines.append(f"property {ply_types[kind[1:]]} {name}")
    return "\n".join([*lines, "end_header\n"]).encode("ascii")


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


def _parse_header(file: BinaryIO, path: Path) -> Header:
    if file.readline(8).rstrip() != b"ply":
        raise InputError(f"'{path}' is not a PLY file: it does not begin with 'ply'.")
    encoding = ""
    elements: list[tuple[str, int, list[tuple[str, str]]]] = []
    comments = list[str]()
    while True:
        line = file.readline(4096)
        if not line.endswith(b"\n") or file.tell() > _MAX_HEADER_BYTES:
            raise InputError(f"'{path}' has a PLY header without an end.")
        match line.decode("ascii", "replace").split():
            case ["end_header"]:
                break
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as encoding, "1.0"]:
                pass
            case ["comment", *comment]:
                comments.append(" ".join(comment))
            case [] | ["obj_info", *_]:
                pass
            case ["element", name, count] if count.isascii() and count.isdigit():
                elements.append((name, int(count), []))
            case ["property", kind, name] if kind in _SCALAR_TYPES and elements:
                elements[-1][2].append((_CLOUDCOMPARE.sub("", name), _SCALAR_TYPES[kind]))
            case ["property", "list", _, _, name] if elements:
                elements[-1][2].append((name, "list"))
            case _:
                words = clip_name(line.decode("ascii", "replace").rstrip())
                raise InputError(f"'{path}' has a line in its PLY header that cannot be understood: '{words}'.")
    if not encoding or not elements:
        raise InputError(f"'{path}' has a PLY header without a format or without elements.")
    parsed = tuple(Element(name, count, _half_floats(props)) for name, count, props in elements)
    return Header(encoding, parsed, file.tell(), tuple(comments))


def _half_floats(properties: list[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    """Return the properties of an element, in which ushort columns of splats are what they can only be, half floats."""
    halves = {("x", "u2"), ("opacity", "u2"), ("rot_0", "u2")} <= {*properties}
    return tuple(
        (name, "f2" if halves and kind == "u2" and _SPLAT_NAME.fullmatch(name) else kind) for name, kind in properties
    )


def read_table(path: Path, header: Header, name: str = "vertex") -> NDArray[Any]:
    """Return all columns of one element, the vertices if not named, as a structured array (N,) that nobody writes to.

    Raises:
        InputError: the element is missing or there twice, it or one before it has list properties, or the file is
            truncated.
    """
    names = [element.name for element in header.elements]
    if name not in names:
        raise InputError(f"'{path}' has no {name} element, so it holds no Gaussians.")
    if names.count(name) > 1:
        raise InputError(f"'{path}' has two elements that are named {name}, of which a splat PLY has one.")
    *before, element = header.elements[: names.index(name) + 1]
    if any(kind == "list" for part in (*before, element) for _, kind in part.properties):
        raise InputError(f"'{path}' has list properties, as a mesh has; a splat PLY has only scalars.")
    if len(dict(element.properties)) < len(element.properties):
        raise InputError(f"'{path}' names a property of its {name} element twice.")
    if element.count == 0 or not element.properties:
        raise InputError(f"'{path}' holds zero Gaussians.")
    if header.encoding == "ascii":
        table = _ascii_table(path, header, element, sum(part.count for part in before))
    else:
        start = header.size + sum(part.count * header.row_type(part).itemsize for part in before)
        table = _binary_table(path, header, element, start)
    table.flags.writeable = False
    return table


def _binary_table(path: Path, header: Header, element: Element, start: int) -> NDArray[Any]:
    """Return the rows of an element that begin at a byte of the file."""
    row_type = header.row_type(element)
    needed, present = element.count * row_type.itemsize, max(0, path.stat().st_size - start)
    if present < needed:
        raise InputError(
            f"'{path}' is truncated: {element.count} Gaussians need {needed} bytes after the header, not {present}."
        )
    table = np.empty(element.count, row_type)
    with path.open("rb") as file:
        file.seek(start)
        read_into(table, file, path)
    return table


def _ascii_table(path: Path, header: Header, element: Element, first: int) -> NDArray[Any]:
    """Return the rows of an element that begin at a line of the data."""
    # Two characters a value are the least that ascii takes, so a count beyond that is a lie that must not cost memory.
    width = len(element.properties)
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
    return unstructured_to_structured(table, header.row_type(element))
