"""glTF's .glb with KHR_gaussian_splatting: attributes of a primitive of points, one accessor each, in float32.

The extension's axes are glTF's, left, up, front; those of a splat PLY are right, down, front. The scene is turned about
z between the two, as the field's converters do. Rotations are (x, y, z, w), scales linear, opacities from 0 to 1. What
is written has all attributes as floats; what is read may have them as integers that are normalised, or altogether as
an .spz (KHR_gaussian_splatting_compression_spz and _spz_2), which here follows its specification: right, up, back.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer._version import __version__
from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.formats import spz
from gaussian_trimmer.formats.half_turns import half_turn
from gaussian_trimmer.formats.packing import linear_scales, log_scales_of
from gaussian_trimmer.gaussians import SH_C0, FloatArray, Gaussians, logit
from gaussian_trimmer.io.reading import file_bytes
from gaussian_trimmer.io.writing import atomic_file

EXTENSION = "KHR_gaussian_splatting"
_SPZ = (f"{EXTENSION}_compression_spz", f"{EXTENSION}_compression_spz_2")
_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
_MAX_JSON_BYTES, _MAX_JSON_VALUES = 1 << 24, 1 << 20
_POINTS, _FLOAT, _VERTICES = 0, 5126, 34962
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", _FLOAT: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_COEFFICIENTS = (1, 3, 5, 7)
"""Number of coefficients of each degree of spherical harmonics."""
_DAMAGE = (LookupError, TypeError, ValueError, AttributeError, OverflowError)
"""What comes of a document that is not built as the standard says."""


def read(path: Path) -> Gaussians:
    """The Gaussians of the first primitive with the extension, rows in file order.

    Raises:
        InputError: the file cannot be read, is no .glb, is damaged, holds no Gaussians, or has them compressed in a way
            that is not known.
    """
    file = _open(path)
    primitive = _primitive(file)
    nested = primitive["extensions"][EXTENSION].get("extensions")
    extensions = {**primitive["extensions"], **(nested if isinstance(nested, dict) else {})}
    packed = [name for name in extensions if name.startswith(f"{EXTENSION}_compression")]
    if not packed:
        gaussians = half_turn(_from_attributes(file, primitive), "z")
    elif packed[0] in _SPZ:
        gaussians = half_turn(spz.decode(_spz_bytes(file, extensions[packed[0]]), path), "x")
    else:
        raise InputError(
            f"'{path}' holds Gaussians that are compressed by {shown(packed[0])}, which cannot be read; export it "
            "again with plain attributes or as .ply."
        )
    return gaussians


@dataclass(frozen=True)
class _File:
    """The two chunks of a .glb."""

    path: Path
    document: dict[str, Any]
    """The JSON, whose structure nobody has checked."""
    binary: memoryview

    def damaged(self, why: str) -> InputError:
        """The error to raise."""
        return InputError(f"'{self.path}' is no .glb file of Gaussians, or damaged: {why}.")

    def view(self, number: int) -> memoryview:
        """The bytes of a buffer view."""
        view = self.document["bufferViews"][number]
        start, size = view.get("byteOffset", 0), view["byteLength"]
        if view.get("buffer", 0) != 0 or not 0 <= start <= start + size <= len(self.binary):
            raise ValueError("a view beyond the data")
        return self.binary[start : start + size]

    def values(self, attributes: dict[str, Any], name: str, width: int, n: int | None = None) -> FloatArray:
        """The values of an attribute, (N, width).

        Raises:
            InputError: there are none, they are of another type or number, or not all of them are in the file.
        """
        try:
            accessor = self.document["accessors"][attributes[name]]
            kind, count = np.dtype(_TYPES[accessor["componentType"]]), accessor["count"]
            stride = self.document["bufferViews"][accessor["bufferView"]].get("byteStride", width * kind.itemsize)
            if _WIDTHS[accessor["type"]] != width or "sparse" in accessor or stride < width * kind.itemsize:
                raise ValueError("another layout")
            data, offset = self.view(accessor["bufferView"]), accessor.get("byteOffset", 0)
            # NumPy refuses what reaches beyond the data.
            rows = np.ndarray((count, width), kind, data, offset, (stride, kind.itemsize))
            scale = np.float32(np.iinfo(kind).max) if kind.kind != "f" and accessor.get("normalized") else None
        except _DAMAGE as error:
            raise self.damaged(f"its {name} is missing, of another type, or not whole") from error
        if n is not None and count != n:
            raise self.damaged(f"{name} has {count} values for {n} Gaussians")
        values = rows.astype(np.float32)
        return values if scale is None else np.maximum(values / scale, -1)


def _open(path: Path) -> _File:
    data = file_bytes(path)
    if len(data) < 20 or struct.unpack_from("<I", data)[0] != _MAGIC:
        raise InputError(f"'{path}' is no .glb file: it does not begin with 'glTF'.")
    _, version, total, length, kind = struct.unpack_from("<IIIII", data)
    text, start = data[20 : 20 + length], 20 + length
    file = _File(path, {}, memoryview(b""))
    if version != 2 or kind != _JSON or length > _MAX_JSON_BYTES or start > len(data) or total > len(data):
        raise file.damaged("its first chunk is not its JSON, or it is truncated")
    if sum(map(text.count, (b",", b"[", b"{"))) > _MAX_JSON_VALUES:
        raise file.damaged(f"its JSON has more than {_MAX_JSON_VALUES} values")
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise file.damaged("its JSON cannot be read") from error
    if start + 8 > len(data) or struct.unpack_from("<I", data, start + 4)[0] != _BINARY:
        return _File(path, document, file.binary)
    (size,) = struct.unpack_from("<I", data, start)
    return _File(path, document, memoryview(data)[start + 8 : start + 8 + size])


def _primitive(file: _File) -> dict[str, Any]:
    """The first primitive with the extension.

    Raises:
        InputError: there is none.
    """
    try:
        for mesh in file.document["meshes"]:
            for primitive in mesh["primitives"]:
                if isinstance(primitive.get("extensions", {}).get(EXTENSION), dict):
                    return dict(primitive)
    except _DAMAGE as error:
        raise file.damaged("its meshes are not those of a glTF") from error
    raise InputError(f"'{file.path}' holds no Gaussians: no primitive has the extension {EXTENSION}.")


def _spz_bytes(file: _File, extension: Any) -> bytes:
    try:
        return bytes(file.view(extension["bufferView"]))
    except _DAMAGE as error:
        raise file.damaged("its .spz is missing or not whole") from error


def _from_attributes(file: _File, primitive: dict[str, Any]) -> Gaussians:
    """The Gaussians of a primitive's attributes, in its own axes."""
    attributes = primitive.get("attributes")
    if not isinstance(attributes, dict):
        raise file.damaged("its primitive has no attributes")
    means = file.values(attributes, "POSITION", 3)
    n = len(means)
    if n == 0:
        raise InputError(f"'{file.path}' holds zero Gaussians.")
    scales, rotations, opacities = (
        file.values(attributes, f"{EXTENSION}:{name}", width, n)
        for name, width in (("SCALE", 3), ("ROTATION", 4), ("OPACITY", 1))
    )
    degrees = [d for d in range(4) if d == 0 or f"{EXTENSION}:SH_DEGREE_{d}_COEF_0" in attributes]
    if degrees != list(range(len(degrees))):
        raise file.damaged("degrees of its spherical harmonics are left out")
    dc, *rest = (
        file.values(attributes, f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{k}", 3, n)
        for degree in degrees
        for k in range(_COEFFICIENTS[degree])
    )
    return Gaussians(
        means=means,
        log_scales=log_scales_of(scales, file.path),
        quaternions=np.roll(rotations, 1, axis=1),
        opacity_logits=logit(np.clip(opacities[:, 0].astype(np.float64), 0, 1)).astype(np.float32),
        sh_dc=dc,
        sh_rest=np.stack(rest, axis=2) if rest else np.zeros((n, 3, 0), np.float32),
    )


def write(gaussians: Gaussians, path: Path) -> None:
    """Write a .glb file in the given order; everything is kept in float32 but extra columns.

    Raises:
        InputError: there are no Gaussians, or the file cannot be written.
    """
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
