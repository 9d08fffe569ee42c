"""SuperSplat's compressed PLY: chunks of 256 Gaussians, each attribute packed between its chunk's extremes.

A `chunk` element holds the extremes, the `vertex` element four packed words a row, and an optional `sh` element the
view-dependent colour in bytes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import ply
from gaussian_trimmer.formats.packing import (
    colours_of,
    drop_largest,
    from_levels,
    opacity_bytes,
    opacity_logits_of,
    restore_largest,
    sh_dc_of,
    to_levels,
)
from gaussian_trimmer.formats.ply import Header, header_of, read_header, read_table, stated_model
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians
from gaussian_trimmer.io.writing import atomic_file, write_array

_ROWS_IN_A_CHUNK = 256
_AXIS_NAMES = ("x", "y", "z")
_SCALE_NAMES = ("scale_x", "scale_y", "scale_z")
_COLOUR_NAMES = ("r", "g", "b")
_ENDS = tuple(
    f"{end}_{name}" for names in (_AXIS_NAMES, _SCALE_NAMES, _COLOUR_NAMES) for end in ("min", "max") for name in names
)
"""Columns of a chunk; older writers leave out the last six."""
_PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
_SH_COUNTS = (9, 24, 45)
_SH_RANGE = 4.0
"""Coefficients of degrees 1 to 3 are held between minus and plus this."""
_ROTATION_RANGE = float(np.sqrt(0.5))
Words = NDArray[Any]
"""Unsigned integers of 32 bits, (N,)."""


def read(path: Path) -> Gaussians:
    """Return the Gaussians of a PLY, rows in file order; of a plain one too, since the header tells, not the name.

    Raises:
        InputError: the file cannot be read, is not a PLY of Gaussians, is truncated, or holds non-finite values.
    """
    header = read_header(path)
    if not header.names("chunk"):
        return ply.read(path)
    chunks, rows = read_table(path, header, "chunk"), read_table(path, header)
    missing = [name for name in _PACKED if name not in header.names("vertex") or rows[name].dtype.kind != "u"]
    missing += [name for name in _ENDS[:12] if name not in header.names("chunk")]
    if missing:
        raise InputError(f"'{path}' is not a compressed PLY: it lacks {', '.join(missing)}.")
    n = len(rows)
    if len(chunks) != -(-n // _ROWS_IN_A_CHUNK):
        raise InputError(f"'{path}' is damaged: {n} Gaussians cannot lie in {len(chunks)} chunks of 256.")
    position, rotation, scale, colour = (np.asarray(rows[name], np.uint32) for name in _PACKED)
    return Gaussians(
        means=_between_extremes(_split_11_10_11(position), (11, 10, 11), chunks, _AXIS_NAMES).astype(np.float32),
        log_scales=_between_extremes(_split_11_10_11(scale), (11, 10, 11), chunks, _SCALE_NAMES).astype(np.float32),
        quaternions=_unpack_rotations(rotation),
        opacity_logits=opacity_logits_of((colour & 0xFF).astype(np.uint8)),
        sh_dc=sh_dc_of(_unpack_colours(colour, chunks)),
        sh_rest=_read_sh(path, header, n),
        model=stated_model(header),
    )


def write(gaussians: Gaussians, path: Path) -> None:
    """Write a compressed PLY in the given order.

    Order matters for precision: the nearer the 256 Gaussians of a chunk are to each other, the finer its steps. Rows
    that may be reordered are best put in Morton order before.

    Raises:
        InputError: there are no Gaussians, which this format cannot hold.
    """
    n = len(gaussians)
    position, position_ends = _pack_11_10_11(gaussians.means)
    scale, scale_ends = _pack_11_10_11(gaussians.log_scales)
    colours = colours_of(gaussians.sh_dc)
    low, high = _extremes(colours)
    red, green, blue = to_levels(colours, _spread(low, n), _spread(high, n), 8).T
    colour = red << 24 | green << 16 | blue << 8 | opacity_bytes(gaussians)
    words = np.column_stack([position, _pack_rotations(gaussians.quaternions), scale, colour]).astype("<u4")
    ends, sh = np.column_stack([position_ends, scale_ends, low, high]).astype("<f4"), _pack_sh(gaussians.sh_rest)
    elements = {
        "chunk": (len(ends), np.dtype([(name, "<f4") for name in _ENDS])),
        "vertex": (n, np.dtype([(name, "<u4") for name in _PACKED])),
    }
    if gaussians.sh_degree:
        elements["sh"] = n, np.dtype([(f"f_rest_{i}", "u1") for i in range(sh.shape[1])])
    with atomic_file(path) as part, part.open("wb") as file:
        file.write(header_of(elements, model=gaussians.model))
        for array in (ends, words, sh):
            write_array(file, array)


def _extremes(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least and greatest values (C, 3) of each chunk of rows (N, 3)."""
    starts = np.arange(0, len(values), _ROWS_IN_A_CHUNK)
    return np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)


def _spread(per_chunk: NDArray[Any], n: int) -> NDArray[Any]:
    """Return rows of the chunks (C, ...) repeated for the chunks' Gaussians, (N, ...)."""
    return np.repeat(per_chunk, _ROWS_IN_A_CHUNK, axis=0)[:n]


def _pack_11_10_11(values: FloatArray) -> tuple[Words, FloatArray]:
    """Words (N,) of values (N, 3) between their chunks' extremes, and those extremes (C, 6)."""
    low, high = _extremes(values)
    a, b, c = (
        to_levels(values[:, i], _spread(low[:, i], len(values)), _spread(high[:, i], len(values)), bits)
        for i, bits in enumerate((11, 10, 11))
    )
    return a << 21 | b << 11 | c, np.column_stack([low, high])


def _split_11_10_11(words: Words) -> tuple[Words, Words, Words]:
    return words >> 21, words >> 11 & 0x3FF, words & 0x7FF


def _between_extremes(
    levels: tuple[Words, ...], bits: tuple[int, ...], chunks: NDArray[Any], names: tuple[str, ...]
) -> Float64Array:
    """Values (N, 3) of levels of so many bits between the chunks' extremes of the named columns."""
    n = len(levels[0])
    columns = [
        from_levels(level, _spread(chunks[f"min_{name}"], n), _spread(chunks[f"max_{name}"], n), size)
        for level, size, name in zip(levels, bits, names, strict=True)
    ]
    return np.column_stack(columns)


def _pack_rotations(quaternions: FloatArray) -> Words:
    largest, others = drop_largest(quaternions)
    a, b, c = to_levels(others, -_ROTATION_RANGE, _ROTATION_RANGE, 10).T
    return np.asarray(largest.astype(np.uint32) << 30 | a << 20 | b << 10 | c)


def _unpack_rotations(words: Words) -> FloatArray:
    levels = np.column_stack([words >> 20 & 0x3FF, words >> 10 & 0x3FF, words & 0x3FF])
    return restore_largest(words >> 30, from_levels(levels, -_ROTATION_RANGE, _ROTATION_RANGE, 10))


def _unpack_colours(words: Words, chunks: NDArray[Any]) -> Float64Array:
    """Return colours (N, 3); files of older writers have no extremes for them and mean 0 to 1."""
    levels = words >> 24, words >> 16 & 0xFF, words >> 8 & 0xFF
    if {*_ENDS} <= {*(chunks.dtype.names or ())}:
        return _between_extremes(levels, (8, 8, 8), chunks, _COLOUR_NAMES)
    return np.column_stack(levels) / 255.0


def _pack_sh(sh_rest: FloatArray) -> NDArray[np.uint8]:
    """Bytes (N, 3K): 256 equal bins over the range."""
    bins = np.floor((sh_rest.reshape(len(sh_rest), -1) / (2 * _SH_RANGE) + 0.5) * 256.0)
    return np.asarray(np.clip(bins, 0, 255), np.uint8)


def _read_sh(path: Path, header: Header, n: int) -> FloatArray:
    """Return coefficients (N, 3, K): bin centres, but the range's ends for the first and the last bin."""
    element = next((element for element in header.elements if element.name == "sh"), None)
    if element is None:
        return np.zeros((n, 3, 0), np.float32)
    names = [f"f_rest_{i}" for i in range(len(element.properties))]
    in_bytes = set(element.properties) == {(name, "u1") for name in names}
    if element.count != n or len(names) not in _SH_COUNTS or not in_bytes:
        raise InputError(f"'{path}' is damaged: its sh element is not 9, 24 or 45 bytes for each Gaussian.")
    shares = (np.arange(256, dtype=np.float32) + 0.5) / 256.0
    shares[[0, 255]] = 0.0, 1.0
    codes = structured_to_unstructured(read_table(path, header, "sh")[names]).reshape(n, 3, -1)
    return np.asarray(((shares - 0.5) * 2 * _SH_RANGE).astype(np.float32)[codes])
