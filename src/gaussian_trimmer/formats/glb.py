"""glTF's .glb and .gltf with KHR_gaussian_splatting: attributes of primitives of points, an accessor each, in float32.

A file may hold several splats, each placed by its node: they are read as one, with the node's number as a column.

The extension's axes are glTF's, left, up, front; those of a splat PLY are right, down, front. The scene is turned about
z between the two, as the field's converters do: centres and rotations change two signs, and so do the spherical
harmonics that are odd in the turned axes. Rotations are (x, y, z, w), scales linear, opacities from 0 to 1. What
is written has all attributes as floats; what is read may have them as integers that are normalised, or altogether as
an .spz (KHR_gaussian_splatting_compression_spz and _spz_2), which here follows its specification: right, up, back.
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer._version import __version__
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.formats import spz
from gaussian_trimmer.formats.packing import check_count, linear_scales, log_scales_of, sh_dc_of
from gaussian_trimmer.gaussians import (
    SH_C0,
    Float64Array,
    FloatArray,
    Gaussians,
    concatenate,
    logit,
    of_one_degree,
    quaternions_of,
    rotation_matrices,
)
from gaussian_trimmer.geometry.harmonics import turned
from gaussian_trimmer.io.reading import file_bytes, path_inside, read_json
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


_SCALED_EVENLY = 1e-3
NODE = "node"
"""Column with the number of the splat that a Gaussian is of, from 1, where a file holds several."""


@dataclass(frozen=True, eq=False)
class _Glb:
    """The JSON and the data of a .glb or .gltf."""

    path: Path
    document: Any
    """The JSON, whose structure nobody has checked."""
    binary: memoryview
    """The second chunk of a .glb."""
    read: dict[int, memoryview] = field(default_factory=dict)
    """Buffers that have been read from other files."""

    def buffer(self, number: int) -> memoryview:
        """Return a buffer: the second chunk, a file beside, or what is written in the JSON itself.

        Raises:
            InputError: the file leads out of the folder, or cannot be read.
        """
        uri: str | None = self.document["buffers"][number].get("uri") if "buffers" in self.document else None
        if uri is None:
            return self.binary
        if number not in self.read:
            if uri.startswith("data:"):
                data = base64.b64decode(uri.partition(",")[2], validate=True)
            elif (path := path_inside(self.path.parent, unquote(uri))) is None:
                raise InputError(f"'{self.path}' refers to '{clip_name(uri)}', outside its own folder.")
            else:
                data = file_bytes(path)
            self.read[number] = memoryview(data)
        return self.read[number]

    def view(self, number: int) -> memoryview:
        """Return the bytes of a buffer view."""
        view = self.document["bufferViews"][number]
        start, size, buffer = view.get("byteOffset", 0), view["byteLength"], self.buffer(view.get("buffer", 0))
        if not 0 <= start <= start + size <= len(buffer):
            raise ValueError(f"view {number} lies beyond the data")
        return buffer[start : start + size]

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
    """Return the Gaussians of all primitives with the extension, where their nodes put them, rows in file order.

    Raises:
        InputError: the file cannot be read, is not a .glb file, is damaged, holds no Gaussians, or has them compressed
            in a way that is not known, or scaled unevenly.
    """
    try:
        return _decode(_open(path))
    except InputError:
        raise
    except _ERRORS_OF_DAMAGE as error:
        raise InputError(
            f"'{path}' is damaged, or not built as a .glb file of Gaussians must be ({clip_name(str(error))})."
        ) from error


def scene_files(path: Path, level: int | None = None) -> list[Path]:
    """Return a .gltf file and the files beside it that hold its data."""
    uris = [entry.get("uri", "data:") for entry in read_json(path, _MAX_JSON_BYTES).get("buffers", ())]
    beside = [path_inside(path.parent, unquote(uri)) for uri in uris if not uri.startswith("data:")]
    return [path, *filter(None, beside)]


def _open(path: Path) -> _Glb:
    if path.suffix.lower() == ".gltf":
        return _Glb(path, read_json(path, _MAX_JSON_BYTES), memoryview(b""))
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
    found = list(_placed_primitives(file.document))
    if not found:
        raise InputError(f"'{file.path}' holds no Gaussians: no primitive has the extension {EXTENSION}.")
    parts = [_moved(_of_primitive(file, primitive), matrix, file.path) for primitive, matrix in found]
    if len(parts) == 1:
        return parts[0]
    sizes = [len(part) for part in parts]
    check_count(sum(sizes), file.path, sum(len(buffer) for buffer in (file.binary, *file.read.values())))
    whole = concatenate(of_one_degree(parts))
    numbers = np.repeat(np.arange(1, len(parts) + 1, dtype=np.int32), sizes)
    return whole.replace(
        extras={NODE: numbers}, notes=(f"{len(parts)} splats are read as one, told apart by the column '{NODE}'",)
    )


def _placed_primitives(document: Any) -> Iterator[tuple[Any, Float64Array]]:
    """Yield primitives with the extension and their nodes' matrices to the world, (4, 4); without nodes, as they are.

    Raises:
        ValueError: a node is in the scene twice.
    """
    meshes, nodes = document["meshes"], document.get("nodes", [])
    scenes, below = document.get("scenes"), {child for node in nodes for child in node.get("children", ())}
    roots = scenes[document.get("scene", 0)]["nodes"] if scenes else set(range(len(nodes))) - below
    splats = [[part for part in mesh["primitives"] if EXTENSION in part.get("extensions", {})] for mesh in meshes]
    todo, seen = [(number, np.eye(4)) for number in sorted(roots)[::-1]], set()
    placed = False
    while todo and any(splats):
        number, above = todo.pop()
        if number in seen:
            raise ValueError(f"node {number} is in its scene twice")
        seen.add(number)
        node, matrix = nodes[number], above @ _matrix_of(nodes[number])
        todo += [(child, matrix) for child in reversed(node.get("children", []))]
        for primitive in splats[node["mesh"]] if "mesh" in node else ():
            placed = True
            yield primitive, matrix
    if not placed:
        yield from ((primitive, np.eye(4)) for mesh in splats for primitive in mesh)


def _matrix_of(node: Any) -> Float64Array:
    """Return where a node puts what it has, (4, 4)."""
    if "matrix" in node:
        return np.asarray(node["matrix"], np.float64).reshape(4, 4).T
    matrix, (x, y, z, w) = np.eye(4), node.get("rotation", (0, 0, 0, 1))
    turn = rotation_matrices(np.array([[w, x, y, z]], np.float64))[0]
    matrix[:3, :3] = turn * np.asarray(node.get("scale", (1, 1, 1)), np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def _moved(gaussians: Gaussians, matrix: Float64Array, path: Path) -> Gaussians:
    """Return Gaussians where a node's matrix, which has glTF's axes, puts them.

    Raises:
        InputError: it scales unevenly, mirrors or shears, which turned Gaussians are not.
    """
    if np.array_equal(matrix, np.eye(4)):
        return gaussians
    signs = np.append(AXIS_SIGNS["z"], 1.0)
    matrix = signs[:, None] * matrix * signs
    linear, place = matrix[:3, :3], matrix[:3, 3]
    scale = np.cbrt(np.linalg.det(linear))
    if not (scale > 0 and np.abs(linear.T @ linear / scale**2 - np.eye(3)).max() < _SCALED_EVENLY):
        raise InputError(
            f"'{path}' has a node that scales its splat unevenly, shears or mirrors it; apply that in the program that "
            "made it, and export again."
        )
    # Exactly a rotation, whatever the digits of the file.
    moved = turned(gaussians, rotation_matrices(quaternions_of((linear / scale)[None]))[0])
    means = moved.means * np.float64(scale) + place
    return moved.replace(means=means, log_scales=moved.log_scales + np.float32(np.log(scale)))


def _of_primitive(file: _Glb, primitive: Any) -> Gaussians:
    """Return the Gaussians of one primitive, in a PLY's axes."""
    extensions = primitive["extensions"]
    extensions = {**extensions, **extensions[EXTENSION].get("extensions", {})}
    packed = [name for name in extensions if name.startswith(f"{EXTENSION}_compression")]
    if not packed:
        return half_turn(_from_attributes(file, primitive["attributes"]), "z")
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
    start = "_" if "_SCALE" in attributes else f"{EXTENSION}:"
    scales, rotations = (
        file.values(attributes, start + name, width) for name, width in (("SCALE", 3), ("ROTATION", 4))
    )
    if start == "_":  # the draft of 2025
        colours = file.values(attributes, "COLOR_0", 4)
        opacities, dc, rest = colours[:, 3:], sh_dc_of(colours[:, :3]), list[FloatArray]()
    else:
        opacities = file.values(attributes, f"{EXTENSION}:OPACITY", 1)
        dc, *rest = _coefficients(file, attributes)
    return Gaussians(
        means=means,
        log_scales=log_scales_of(scales, file.path),
        quaternions=np.roll(rotations, 1, axis=1),
        opacity_logits=logit(np.clip(opacities[:, 0].astype(np.float64), 0, 1)).astype(np.float32),
        sh_dc=dc,
        sh_rest=np.stack(rest, axis=2) if rest else np.zeros((len(means), 3, 0), np.float32),
    )


def _coefficients(file: _Glb, attributes: dict[str, Any]) -> list[FloatArray]:
    """Return the coefficients of spherical harmonics, each (N, 3)."""
    degrees = [d for d in range(4) if d == 0 or f"{EXTENSION}:SH_DEGREE_{d}_COEF_0" in attributes]
    return [
        file.values(attributes, f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{k}", 3)
        for degree in degrees
        for k in range(_COEFFICIENTS[degree])
    ]


def write(gaussians: Gaussians, path: Path) -> None:
    """Write a .glb file in the given order; everything is kept in float32 but extra columns.

    Raises:
        InputError: there are no Gaussians, or the file cannot be written.
    """
    _write([(gaussians, {})], path)


def write_objects(objects: Sequence[tuple[str, Gaussians, Float64Array]], path: Path) -> None:
    """Write a .glb file with a node for each of several objects: its name, its Gaussians, and its origin, (3,).

    Raises:
        InputError: there are no Gaussians, or the file cannot be written.
    """
    parts = []
    for name, gaussians, origin in objects:
        means = (gaussians.means - origin).astype(np.float32)
        place = (origin * AXIS_SIGNS["z"]).tolist()
        parts.append((gaussians.replace(means=means), {"name": name, "translation": place}))
    _write(parts, path)


def _write(parts: Sequence[tuple[Gaussians, dict[str, Any]]], path: Path) -> None:
    """Write a node for each part, with more entries."""
    data, nodes, meshes = list[NDArray[Any]](), list[Any](), list[Any]()
    views, accessors = list[Any](), list[Any]()
    start = 0
    for gaussians, node in parts:
        nodes.append({"mesh": len(meshes), **node})
        attributes = {}
        for name, column in _columns(gaussians).items():
            values = np.ascontiguousarray(column, "<f4")
            attributes[name] = len(accessors)
            accessors.append(_accessor(name, values, len(views)))
            views.append({"buffer": 0, "byteOffset": start, "byteLength": values.nbytes, "target": _VERTICES})
            start += values.nbytes
            data.append(values)
        extension = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}
        primitive = {"mode": _POINTS, "attributes": attributes, "extensions": {EXTENSION: extension}}
        meshes.append({"primitives": [primitive]})
    document = {
        "asset": {"version": "2.0", "generator": f"gaussian-trimmer {__version__}"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": meshes,
        "buffers": [{"byteLength": start}],
        "bufferViews": views,
        "accessors": accessors,
    }
    header = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    header += b" " * (-len(header) % 4)
    total = 12 + 8 + len(header) + 8 + start
    if total >= 1 << 32:
        raise InputError(f"Cannot write '{path}': a .glb file ends at 4 GiB, and this one would have {total} bytes.")
    with atomic_file(path) as part, part.open("wb") as file:
        file.write(struct.pack("<III", _MAGIC, 2, total) + struct.pack("<II", len(header), _JSON) + header)
        file.write(struct.pack("<II", start, _BINARY))
        for values in data:
            file.write(values.data)


def _columns(gaussians: Gaussians) -> dict[str, FloatArray]:
    """Return the attributes of a primitive, in glTF's axes."""
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
    return columns


def _accessor(name: str, values: NDArray[Any], view: int) -> dict[str, Any]:
    width = values.shape[1]
    kind = "SCALAR" if width == 1 else f"VEC{width}"
    accessor = {"bufferView": view, "componentType": _FLOAT, "count": len(values), "type": kind}
    extremes = {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()} if name == "POSITION" else {}
    return accessor | extremes


def half_turn(gaussians: Gaussians, axis: Literal["x", "z"]) -> Gaussians:
    """Return the Gaussians after half a turn about an axis through the origin, seen as before from the turned side."""
    signs, coefficients = AXIS_SIGNS[axis], gaussians.sh_rest.shape[2]
    return replace(
        gaussians,
        means=gaussians.means * signs,
        quaternions=gaussians.quaternions * np.concatenate([[1], signs]).astype(np.float32),
        sh_rest=gaussians.sh_rest * SH_SIGNS[axis][:coefficients],
    )
