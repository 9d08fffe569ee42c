"""glTF's .glb with KHR_gaussian_splatting: attributes of a primitive of points, one accessor each, in float32.

The extension's axes are glTF's, left, up, front; those of a splat PLY are right, down, front. The scene is turned about
z between the two, as the field's converters do. Rotations are (x, y, z, w), scales linear, opacities from 0 to 1. What
is written has all attributes as floats; what is read may have them as integers that are normalised, or altogether as
an .spz (KHR_gaussian_splatting_compression_spz and _spz_2), which here follows its specification: right, up, back.
"""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer._version import __version__
from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.formats import spz
from gaussian_trimmer.formats.checks import check_values
from gaussian_trimmer.formats.half_turns import half_turn
from gaussian_trimmer.formats.packing import linear_scales, log_scales_of
from gaussian_trimmer.gaussians import SH_C0, FloatArray, Gaussians, logit
from gaussian_trimmer.io.reading import file_bytes
from gaussian_trimmer.io.writing import atomic_file

EXTENSION = "KHR_gaussian_splatting"
_SPZ = (f"{EXTENSION}_compression_spz", f"{EXTENSION}_compression_spz_2")
_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
_MAX_HEADER = 1 << 24
_POINTS, _FLOAT, _VERTICES = 0, 5126, 34962
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", _FLOAT: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_COEFFICIENTS = (1, 3, 5, 7)
"""Number of coefficients of each degree of spherical harmonics."""


def read(path: Path) -> Gaussians:
    """The Gaussians of the first primitive with the extension, rows in file order.

    Raises:
        InputError: the file cannot be read, is no .glb, is damaged, holds no Gaussians, or has them compressed in a way
            that is not known.
    """
    document, binary = _chunks(file_bytes(path), path)
    primitive, packed = _primitive(document, path)
    table = _Table(document, binary, path)
    if packed is not None:
        gaussians = half_turn(spz.decode(table.bytes_of(packed), path), "x")
    else:
        gaussians = half_turn(_from_attributes(table, primitive, path), "z")
    check_values(gaussians, path)
    return gaussians


def _from_attributes(table: _Table, primitive: dict[str, Any], path: Path) -> Gaussians:
    """The Gaussians of a primitive's attributes, in its own axes."""
    attributes = primitive.get("attributes")
    if not isinstance(attributes, dict):
        raise _damaged(path, "its primitive has no attributes")
    means = table.values(attributes, "POSITION", 3)
    n = len(means)
    if n == 0:
        raise InputError(f"'{path}' holds zero Gaussians.")
    scales, rotations, opacities = (
        table.values(attributes, f"{EXTENSION}:{name}", width, n)
        for name, width in (("SCALE", 3), ("ROTATION", 4), ("OPACITY", 1))
    )
    coefficients = [
        [table.values(attributes, f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{k}", 3, n) for k in range(number)]
        for degree, number in enumerate(_COEFFICIENTS)
        if degree == 0 or f"{EXTENSION}:SH_DEGREE_{degree}_COEF_0" in attributes
    ]
    rest = [values for degree in coefficients[1:] for values in degree]
    if len(rest) not in (0, 3, 8, 15):
        raise _damaged(path, "degrees of its spherical harmonics are left out")
    return Gaussians(
        means=means,
        log_scales=log_scales_of(scales, path),
        quaternions=np.roll(rotations, 1, axis=1),
        opacity_logits=logit(np.clip(opacities[:, 0].astype(np.float64), 0, 1)).astype(np.float32),
        sh_dc=coefficients[0][0],
        sh_rest=np.stack(rest, axis=2) if rest else np.zeros((n, 3, 0), np.float32),
    )


def write(gaussians: Gaussians, path: Path) -> None:
    """Write a .glb file in the given order; everything is kept in float32 but extra columns.

    Raises:
        InputError: there are no Gaussians, or the file cannot be written.
    """
    if len(gaussians) == 0:
        raise InputError(f"Cannot write '{path}': a .glb file cannot hold zero Gaussians.")
    gaussians = half_turn(gaussians, "z")
    unit = gaussians.quaternions / np.linalg.norm(gaussians.quaternions, axis=1, keepdims=True)
    columns: dict[str, FloatArray] = {
        "POSITION": gaussians.means,
        "COLOR_0": np.column_stack([np.clip(0.5 + SH_C0 * gaussians.sh_dc, 0, 1), gaussians.opacities]),
        f"{EXTENSION}:ROTATION": np.roll(unit, -1, axis=1),
        f"{EXTENSION}:SCALE": linear_scales(gaussians),
        f"{EXTENSION}:OPACITY": gaussians.opacities[:, None],
        f"{EXTENSION}:SH_DEGREE_0_COEF_0": gaussians.sh_dc,
    }
    start = 0
    for degree, number in enumerate(_COEFFICIENTS[1 : gaussians.sh_degree + 1], 1):
        for k in range(number):
            columns[f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{k}"] = gaussians.sh_rest[:, :, start + k]
        start += number
    data = [np.ascontiguousarray(column, "<f4") for column in columns.values()]
    header = _header(columns, data)
    header += b" " * (-len(header) % 4)
    size = sum(column.nbytes for column in data)
    total = 12 + 8 + len(header) + 8 + size
    if total >= 1 << 32:
        raise InputError(f"Cannot write '{path}': a .glb file ends at 4 GiB, and this one would have {total} bytes.")
    with atomic_file(path) as part, part.open("wb") as file:
        file.write(struct.pack("<III", _MAGIC, 2, total) + struct.pack("<II", len(header), _JSON) + header)
        file.write(struct.pack("<II", size, _BINARY))
        for column in data:
            file.write(column.data)


def _header(columns: dict[str, FloatArray], data: list[NDArray[Any]]) -> bytes:
    views, accessors, attributes, start = [], [], {}, 0
    for place, (name, column) in enumerate(zip(columns, data, strict=True)):
        width = column.shape[1]
        views.append({"buffer": 0, "byteOffset": start, "byteLength": column.nbytes, "target": _VERTICES})
        accessor: dict[str, Any] = {
            "bufferView": place, "componentType": _FLOAT, "count": len(column),
            "type": "SCALAR" if width == 1 else f"VEC{width}",
        }  # fmt: skip
        if name == "POSITION":
            accessor |= {"min": column.min(axis=0).tolist(), "max": column.max(axis=0).tolist()}
        accessors.append(accessor)
        attributes[name] = place
        start += column.nbytes
    primitive = {
        "mode": _POINTS, "attributes": attributes,
        "extensions": {EXTENSION: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}},
    }  # fmt: skip
    document = {
        "asset": {"version": "2.0", "generator": f"gaussian-trimmer {__version__}"},
        "extensionsUsed": [EXTENSION],
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": start}], "bufferViews": views, "accessors": accessors,
    }  # fmt: skip
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode()


def _chunks(data: bytes, path: Path) -> tuple[dict[str, Any], memoryview]:
    """The JSON and the binary chunk."""
    if len(data) < 20 or struct.unpack_from("<I", data)[0] != _MAGIC:
        raise InputError(f"'{path}' is no .glb file: it does not begin with 'glTF'.")
    _, version, total, length, kind = struct.unpack_from("<IIIII", data)
    if version != 2 or kind != _JSON or length > _MAX_HEADER or 20 + length > len(data) or total > len(data):
        raise _damaged(path, "its first chunk is not its JSON, or it is truncated")
    try:
        document = json.loads(data[20 : 20 + length])
    except (ValueError, RecursionError) as error:
        raise _damaged(path, "its JSON cannot be read") from error
    if not isinstance(document, dict):
        raise _damaged(path, "its JSON is no object")
    start, binary = 20 + length, memoryview(b"")
    if start + 8 <= len(data):
        size, kind = struct.unpack_from("<II", data, start)
        if kind == _BINARY:
            binary = memoryview(data)[start + 8 : start + 8 + size]
    return document, binary


def _primitive(document: dict[str, Any], path: Path) -> tuple[dict[str, Any], Any]:
    """The first primitive with the extension, and the number of the buffer view of its .spz, or None."""
    for mesh in _list(document, "meshes"):
        for primitive in _list(mesh, "primitives"):
            extensions = primitive.get("extensions") if isinstance(primitive, dict) else None
            if isinstance(extensions, dict) and isinstance(found := extensions.get(EXTENSION), dict):
                return dict(primitive), _packed({**extensions, **_dict(found, "extensions")}, path)
    raise InputError(f"'{path}' holds no Gaussians: no primitive has the extension {EXTENSION}.")


def _packed(extensions: dict[str, Any], path: Path) -> Any:
    """The buffer view of the .spz of a primitive with these extensions, or None where it has plain attributes."""
    for name in _SPZ:
        if name in extensions:
            return _dict(extensions, name).get("bufferView", -1)
    if other := sorted(name for name in extensions if name.startswith(f"{EXTENSION}_compression")):
        raise InputError(
            f"'{path}' holds Gaussians that are compressed by {shown(other[0])}, which cannot be read; export it again "
            "with plain attributes or as .ply."
        )
    return None


class _Table:
    """The accessors of a document."""

    def __init__(self, document: dict[str, Any], binary: memoryview, path: Path) -> None:
        self._accessors, self._views = _list(document, "accessors"), _list(document, "bufferViews")
        self._binary, self._path = binary, path

    def values(self, attributes: dict[str, Any], name: str, width: int, n: int | None = None) -> FloatArray:
        """The values of an attribute, (N, width)."""
        entry = self._entry(self._accessors, attributes.get(name), f"it has no {name}")
        view = self._entry(self._views, entry.get("bufferView"), f"{name} has no buffer view")
        kind, count = _TYPES.get(entry.get("componentType", 0)), entry.get("count")
        if kind is None or _WIDTHS.get(str(entry.get("type"))) != width or not _is_count(count) or "sparse" in entry:
            raise _damaged(self._path, f"{name} is not of a type that it can have")
        if n is not None and count != n:
            raise _damaged(self._path, f"{name} has {count} values for {n} Gaussians")
        offsets = [entry.get("byteOffset", 0), view.get("byteOffset", 0), view.get("byteLength", 0)]
        item = width * np.dtype(kind).itemsize
        stride = view.get("byteStride", item)
        if not all(map(_is_count, [*offsets, stride])) or view.get("buffer", 0) != 0 or not item <= stride <= 252:
            raise _damaged(self._path, f"{name} lies nowhere")
        start, end = offsets[0] + offsets[1], offsets[1] + offsets[2]
        needed = stride * (count - 1) + item if count else 0
        if end > len(self._binary) or start + needed > end:
            raise _damaged(self._path, f"{name} goes beyond the end of its data")
        raw = np.frombuffer(self._binary[start : start + needed], np.uint8)
        rows = np.lib.stride_tricks.as_strided(raw, (count, item), (stride, 1)) if count else raw.reshape(0, item)
        values = np.ascontiguousarray(rows).view(kind).astype(np.float32)
        if np.dtype(kind).kind != "f" and entry.get("normalized"):
            values = np.maximum(values / np.float32(np.iinfo(kind).max), -1)
        return values

    def bytes_of(self, number: Any) -> bytes:
        """The contents of a buffer view."""
        view = self._entry(self._views, number, "its .spz has no buffer view")
        start, size = view.get("byteOffset", 0), view.get("byteLength", 0)
        if not all(map(_is_count, (start, size))) or view.get("buffer", 0) != 0 or start + size > len(self._binary):
            raise _damaged(self._path, "its .spz goes beyond the end of its data")
        return bytes(self._binary[start : start + size])

    def _entry(self, entries: list[Any], number: Any, what: str) -> dict[str, Any]:
        if not _is_count(number) or number >= len(entries) or not isinstance(entries[number], dict):
            raise _damaged(self._path, what)
        entry: dict[str, Any] = entries[number]
        return entry


def _list(entry: Any, name: str) -> list[Any]:
    found = entry.get(name) if isinstance(entry, dict) else None
    return found if isinstance(found, list) else []


def _dict(entry: dict[str, Any], name: str) -> dict[str, Any]:
    found = entry.get(name)
    return found if isinstance(found, dict) else {}


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 1 << 40 and math.isfinite(value)


def _damaged(path: Path, why: str) -> InputError:
    return InputError(f"'{path}' is no .glb file of Gaussians, or damaged: {why}.")
