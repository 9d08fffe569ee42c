"""glTF's .glb with KHR_gaussian_splatting: attributes of a primitive of points, one accessor each, in float32.

The extension's axes are glTF's, left, up, front; those of a splat PLY are right, down, front. The scene is turned about
z between the two, as the field's converters do: centres and rotations change two signs, and so do the spherical
harmonics that are odd in the turned axes. Rotations are (x, y, z, w), scales linear, opacities from 0 to 1. What
is written has all attributes as floats; what is read may have them as integers that are normalised, or altogether as
an .spz (KHR_gaussian_splatting_compression_spz and _spz_2), which here follows its specification: right, up, back.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer._version import __version__
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.formats import spz
from gaussian_trimmer.formats.packing import linear_scales, log_scales_of
from gaussian_trimmer.gaussians import SH_C0, FloatArray, Gaussians, logit
from gaussian_trimmer.io.reading import file_bytes
from gaussian_trimmer.io.writing import atomic_file

EXTENSION = "KHR_gaussian_splatting"
_SPZ_EXTENSIONS = (f"{EXTENSION}_compression_spz", f"{EXTENSION}_compression_spz_2")
_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
_POINTS, _FLOAT, _VERTICES = 0, 5126, 34962
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", _FLOAT: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_MAX_JSON_BYTES = 4 << 20
_COEFFICIENTS = (1, 3, 5, 7)
"""Number of coefficients of each degree of spherical harmonics."""
_ERRORS_OF_DAMAGE = (LookupError, TypeError, ValueError, AttributeError, OverflowError, RecursionError, struct.error)
"""What comes of a document that is not built as the standard says."""
AXIS_SIGNS = {"x": np.array([1, -1, -1], np.float32), "z": np.array([-1, -1, 1], np.float32)}
"""What half a turn about an axis does to a vector, and to the vector part of a quaternion."""
SH_SIGNS = {
    "x": np.array([-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1], np.float32),
    "z": np.array([-1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1], np.float32),
}
"""What it does to the harmonics y, z, x, xy, yz, z2, xz, x2-y2, ... of degrees 1 to 3."""


@dataclass(frozen=True)
class _Glb:
    """The two chunks of a .glb."""

    path: Path
    document: Any
    """The JSON, whose structure nobody has checked."""
    binary: memoryview

    def view(self, number: int) -> memoryview:
        """Return the bytes of a buffer view."""
        view = self.document["bufferViews"][number]
        start, size = view.get("byteOffset", 0), view["byteLength"]
        if view.get("buffer", 0) != 0 or not 0 <= start <= start + size <= len(self.binary):
            raise ValueError(f"view {number} lies beyond the data")
        return self.binary[start : start + size]

    def values(self, attributes: dict[str, Any], name: str, width: int) -> FloatArray:
        """Return the values of an attribute, (N, width)."""
        if name not in attributes:
            raise ValueError(f"{name} is missing")
        accessor = self.document["accessors"][attributes[name]]
        kind = np.dtype(_TYPES[accessor["componentType"]])
        stride = self.document["bufferViews"][accessor["bufferView"]].get("byteStride", width * kind.itemsize)
        if _WIDTHS[accessor["type"]] != width or "sparse" in accessor or stride < width * kind.itemsize:
            raise ValueError(f"{name} has another layout")
        data, offset = self.view(accessor["bufferView"]), accessor.get("byteOffset", 0)
        # NumPy refuses what reaches beyond the data.
        rows = np.ndarray((accessor["count"], width), kind, data, offset, (stride, kind.itemsize))
        if kind.kind == "f" or not accessor.get("normalized"):
            return rows.astype(np.float32)
        return np.asarray(np.maximum(rows.astype(np.float32) / np.float32(np.iinfo(kind).max), -1))


def read(path: Path) -> Gaussians:
    """Return the Gaussians of the first primitive with the extension, rows in file order.

    Raises:
        InputError: the file cannot be read, is not a .glb file, is damaged, holds no Gaussians, or has them compressed
            in a way that is not known.
    """
    try:
        return _decode(_open(path))
    except InputError:
        raise
    except _ERRORS_OF_DAMAGE as error:
        raise InputError(
            f"'{path}' is damaged, or not built as a .glb file of Gaussians must be ({clip_name(str(error))})."
        ) from error


def _open(path: Path) -> _Glb:
    data = file_bytes(path)
    if data[:4] != b"glTF":
        raise InputError(f"'{path}' is not a .glb file: it does not begin with 'glTF'.")
    _, version, total, length, kind = struct.unpack_from("<IIIII", data)
    if version != 2 or kind != _JSON or total > len(data):
        raise ValueError("its first chunk is not its JSON, or it is truncated")
    if length > _MAX_JSON_BYTES:
        raise ValueError(f"its JSON has {length} bytes, more than {_MAX_JSON_BYTES}")
    start = 20 + length
    document = json.loads(data[20:start])
    if start + 8 > len(data) or struct.unpack_from("<I", data, start + 4)[0] != _BINARY:
        return _Glb(path, document, memoryview(b""))
    (size,) = struct.unpack_from("<I", data, start)
    return _Glb(path, document, memoryview(data)[start + 8 : start + 8 + size])


def _decode(file: _Glb) -> Gaussians:
    primitives = [primitive for mesh in file.document["meshes"] for primitive in mesh["primitives"]]
    found = [primitive for primitive in primitives if EXTENSION in primitive.get("extensions", {})]
    if not found:
        raise InputError(f"'{file.path}' holds no Gaussians: no primitive has the extension {EXTENSION}.")
    extensions = found[0]["extensions"]
    extensions = {**extensions, **extensions[EXTENSION].get("extensions", {})}
    packed = [name for name in extensions if name.startswith(f"{EXTENSION}_compression")]
    if not packed:
        return half_turn(_from_attributes(file, found[0]["attributes"]), "z")
    if packed[0] in _SPZ_EXTENSIONS:
        return half_turn(spz.decode(bytes(file.view(extensions[packed[0]]["bufferView"])), file.path), "x")
    raise InputError(
        f"'{file.path}' holds Gaussians that are compressed by {clip_name(packed[0])}, which cannot be read; export it "
        "again with plain attributes or as .ply."
    )


def _from_attributes(file: _Glb, attributes: dict[str, Any]) -> Gaussians:
    """Return the Gaussians of a primitive's attributes, in its own axes."""
    means = file.values(attributes, "POSITION", 3)
    if len(means) == 0:
        raise InputError(f"'{file.path}' holds zero Gaussians.")
    scales, rotations, opacities = (
        file.values(attributes, f"{EXTENSION}:{name}", width)
        for name, width in (("SCALE", 3), ("ROTATION", 4), ("OPACITY", 1))
    )
    degrees = [d for d in range(4) if d == 0 or f"{EXTENSION}:SH_DEGREE_{d}_COEF_0" in attributes]
    dc, *rest = (
        file.values(attributes, f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{k}", 3)
        for degree in degrees
        for k in range(_COEFFICIENTS[degree])
    )
    return Gaussians(
        means=means,
        log_scales=log_scales_of(scales, file.path),
        quaternions=np.roll(rotations, 1, axis=1),
        opacity_logits=logit(np.clip(opacities[:, 0].astype(np.float64), 0, 1)).astype(np.float32),
        sh_dc=dc,
        sh_rest=np.stack(rest, axis=2) if rest else np.zeros((len(means), 3, 0), np.float32),
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
            "bufferView": place,
            "componentType": _FLOAT,
            "count": len(column),
            "type": "SCALAR" if width == 1 else f"VEC{width}",
        }
        if name == "POSITION":
            accessor |= {"min": column.min(axis=0).tolist(), "max": column.max(axis=0).tolist()}
        accessors.append(accessor)
        attributes[name] = place
        start += column.nbytes
    primitive = {
        "mode": _POINTS,
        "attributes": attributes,
        "extensions": {EXTENSION: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}},
    }
    document = {
        "asset": {"version": "2.0", "generator": f"gaussian-trimmer {__version__}"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": start}],
        "bufferViews": views,
        "accessors": accessors,
    }
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode()


def half_turn(gaussians: Gaussians, axis: Literal["x", "z"]) -> Gaussians:
    """Return the Gaussians after half a turn about an axis through the origin, seen as before from the turned side."""
    signs, coefficients = AXIS_SIGNS[axis], gaussians.sh_rest.shape[2]
    return replace(
        gaussians,
        means=gaussians.means * signs,
        quaternions=gaussians.quaternions * np.concatenate([[1], signs]).astype(np.float32),
        sh_rest=gaussians.sh_rest * SH_SIGNS[axis][:coefficients],
    )
