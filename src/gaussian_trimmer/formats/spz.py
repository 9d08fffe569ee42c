"""Niantic's .spz: attribute after attribute in bytes, compressed with gzip (versions 2 and 3) or zstd (version 4).

Numbers are those of the file, whatever its axes: the specification says right, up, back, but what Niantic's own
ply_to_spz, splat-transform and SuperSplat write from a splat PLY has the PLY's axes, and nothing in the file tells.
"""

from __future__ import annotations

import gzip
import struct
import zlib
from dataclasses import dataclass
from importlib import import_module
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.packing import (
    CUT_TO_DEGREE_3,
    ByteArray,
    check_count,
    drop_largest,
    opacity_bytes,
    opacity_logits_of,
    restore_largest,
    to_levels,
)
from gaussian_trimmer.gaussians import FloatArray, Gaussians
from gaussian_trimmer.io.reading import file_bytes
from gaussian_trimmer.io.writing import write_whole

_HEADER = struct.Struct("<4sIIBBBB")
_MAGIC = b"NGSP"
_COEFFICIENTS = (0, 3, 8, 15, 24)
_ANTIALIASED = 1
"""Bit of the flags."""
_MAX_FRACTIONAL_BITS = 24
_COLOUR_SCALE = 0.15
_UP = (0.0, 1.0, 0.0)
"""The specification's axes are right, up, back; those that copy a PLY's numbers do not keep to it."""
_VERSION_4_HEADER = 32


@dataclass(frozen=True)
class _Header:
    version: int
    count: int
    sh_degree: int
    fractional_bits: int
    antialiased: bool
    streams: int
    """Number of compressed streams; only in version 4."""

    @property
    def sizes(self) -> list[int]:
        """Bytes of centres, opacities, colours, scales, rotations and coefficients."""
        per_row = (9, 1, 3, 3, 3 if self.version == 2 else 4, 3 * _COEFFICIENTS[self.sh_degree])
        return [self.count * size for size in per_row]


def read(path: Path) -> Gaussians:
    """Return the Gaussians of an .spz file of version 2, 3 or 4, rows in file order; degree 4 is cut to degree 3.

    Version 4 needs zstd: Python 3.14, or the package backports.zstd.

    Raises:
        InputError: the file cannot be read, is no .spz, is damaged or truncated, or zstd is needed and missing.
    """
    return decode(file_bytes(path), path).replace(format_up=_UP)


def decode(data: bytes, path: Path) -> Gaussians:
    """Return the Gaussians of the contents of an .spz file.

    Args:
        data: what begins with 'NGSP' or is compressed by gzip.
        path: the file that holds it, for messages and as a bound on what it can hold.

    Raises:
        InputError: as for `read`.
    """
    header, parts = _read_plain(data, path) if data[:4] == _MAGIC else _read_gzip(data, path)
    return _decode(header, [np.frombuffer(part, np.uint8).reshape(header.count, -1) for part in parts])


def write(gaussians: Gaussians, path: Path, *, version: Literal[3, 4] = 3) -> None:
    """Write an .spz file in the given order, coefficients in all 8 bits, centres as fine as they fit.

    Args:
        gaussians: what to write.
        path: where.
        version: 3, which everything reads, or 4, which is smaller by some percent and needs zstd as `read` does.

    Raises:
        InputError: there are no Gaussians, a centre lies beyond what 24 bits hold, there is no such version, or zstd is
            needed and missing.
    """
    if version not in (3, 4):
        raise InputError(f"An .spz file of version {version} cannot be written; versions 3 and 4 can.")
    reach = float(np.abs(gaussians.means).max())
    bits = min(_MAX_FRACTIONAL_BITS - 1, int(np.floor(np.log2((2**23 - 1) / max(reach, 1e-6)))))
    if bits < 0:
        raise InputError(f"Cannot write '{path}': .spz holds coordinates up to 8388607, not {reach:g}.")
    parts = [part.tobytes() for part in _encode(gaussians, bits)]
    streams = sum(map(bool, parts)) if version == 4 else 0
    flags = _ANTIALIASED if gaussians.antialiased else 0
    header = _HEADER.pack(_MAGIC, version, len(gaussians), gaussians.sh_degree, bits, flags, streams)
    if version == 3:
        contents = gzip.compress(b"".join([header, *parts]), compresslevel=6, mtime=0)
    else:
        contents = header + _with_table(parts)
    write_whole(path, contents)


def _with_table(parts: list[bytes]) -> bytes:
    """What follows the header in version 4: where the table is, the table, and a zstd stream for each attribute."""
    zstd = _zstd()
    found = [part for part in parts if part]
    packed = [zstd.compress(part) for part in found]
    table = b"".join(struct.pack("<QQ", len(data), len(part)) for data, part in zip(packed, found, strict=True))
    return struct.pack("<I12x", _VERSION_4_HEADER) + table + b"".join(packed)


def _read_gzip(data: bytes, path: Path) -> tuple[_Header, list[bytes]]:
    """Header and attributes of versions 2 and 3; what the header does not announce is not decompressed."""
    stream = zlib.decompressobj(wbits=31)
    try:
        header = _parse_header(stream.decompress(data, _HEADER.size), (2, 3), path)
        size = sum(header.sizes)
        body = stream.decompress(stream.unconsumed_tail, size)
        stream.decompress(stream.unconsumed_tail, 1)  # reaches the checksum, where nothing follows the Gaussians
    except zlib.error as error:
        raise InputError(f"'{path}' is not an .spz file, damaged or truncated: {error}.") from error
    if len(body) < size:
        raise InputError(f"'{path}' is damaged or truncated: its data ends before its {header.count} Gaussians do.")
    return header, [body[start:end] for start, end in pairwise(accumulate(header.sizes, initial=0))]


def _read_plain(data: bytes, path: Path) -> tuple[_Header, list[bytes]]:
    """Header and attributes of version 4: a plain header and, where it says, a table of zstd streams."""
    header = _parse_header(data[: _HEADER.size], (4,), path)
    (start,) = struct.unpack("<I", data[_HEADER.size :][:4].ljust(4, b"\0"))
    end = start + 16 * header.streams
    entries = list(struct.iter_unpack("<QQ", data[start:end])) if end <= len(data) else []
    if [size for _, size in entries] != [size for size in header.sizes if size]:
        raise InputError(f"'{path}' is damaged: its streams do not fit its {header.count} Gaussians.")
    parts = []
    for packed, size in entries:
        parts.append(_decompress_zstd(data[end : end + packed], size, path))
        end += packed
    return header, parts if len(parts) == 6 else [*parts, b""]


def _parse_header(data: bytes, versions: tuple[int, ...], path: Path) -> _Header:
    if len(data) < _HEADER.size or data[:4] != _MAGIC:
        raise InputError(f"'{path}' is not an .spz file: it does not begin with 'NGSP'.")
    _, version, count, degree, fractional_bits, flags, streams = _HEADER.unpack(data)
    if version not in versions:
        raise InputError(f"'{path}' is of .spz version {version}; versions 2, 3 and 4 can be read.")
    if degree >= len(_COEFFICIENTS) or fractional_bits > _MAX_FRACTIONAL_BITS:
        raise InputError(f"'{path}' is damaged: SH degree {degree}, {fractional_bits} fractional bits.")
    check_count(count, path)
    return _Header(version, count, degree, fractional_bits, bool(flags & _ANTIALIASED), streams)


def _decompress_zstd(data: bytes, size: int, path: Path) -> bytes:
    """Exactly `size` bytes out of a zstd stream, never more."""
    zstd = _zstd()
    try:
        out: bytes = zstd.ZstdDecompressor().decompress(data, max_length=size)
    except zstd.ZstdError:
        out = b""
    if len(out) != size:
        raise InputError(f"'{path}' is damaged or truncated: one of its streams is not whole.")
    return out


def _zstd() -> Any:
    """Python's zstd module, which came with version 3.14, or its backport."""
    for name in ("compression.zstd", "backports.zstd"):
        try:
            return import_module(name)
        except ImportError:
            continue
    raise InputError("Version 4 of .spz needs zstd: pip install backports.zstd, or convert the file to version 3.")


def _decode(header: _Header, parts: list[ByteArray]) -> Gaussians:
    """Gaussians of the attributes' bytes, each (N, bytes a row)."""
    centres, opacities, colours, scales, rotations, coefficients = parts
    n = header.count
    low, middle, high = centres.reshape(n, 3, 3).transpose(2, 0, 1).astype(np.int32)
    fixed = (low | middle << 8 | high << 16) << 8 >> 8  # the shifts extend the sign of 24 bits
    quaternions = _first_three(rotations) if header.version == 2 else _smallest_three(rotations)
    k = min(_COEFFICIENTS[header.sh_degree], _COEFFICIENTS[3])
    sh = coefficients.reshape(n, -1, 3)[:, :k].transpose(0, 2, 1)
    return Gaussians(
        means=np.ldexp(fixed, -header.fractional_bits).astype(np.float32),
        log_scales=scales.astype(np.float32) / 16.0 - 10.0,
        quaternions=quaternions,
        opacity_logits=opacity_logits_of(opacities[:, 0]),
        sh_dc=((colours / 255.0 - 0.5) / _COLOUR_SCALE).astype(np.float32),
        sh_rest=(sh.astype(np.float32) - 128.0) / 128.0,
        model="antialiased" if header.antialiased else "default",
        notes=(CUT_TO_DEGREE_3,) if header.sh_degree > 3 else (),
    )


def _encode(gaussians: Gaussians, fractional_bits: int) -> list[NDArray[Any]]:
    """Return the attributes' bytes in the order of the file."""
    fixed = np.rint(np.ldexp(gaussians.means.astype(np.float64), fractional_bits)).astype("<i4")
    return [
        np.ascontiguousarray(fixed).view(np.uint8).reshape(len(fixed), 3, 4)[..., :3],
        opacity_bytes(gaussians),
        to_levels(gaussians.sh_dc, -0.5 / _COLOUR_SCALE, 0.5 / _COLOUR_SCALE, 8).astype(np.uint8),
        to_levels(gaussians.log_scales, -10.0, 255 / 16 - 10.0, 8).astype(np.uint8),
        _pack_smallest_three(gaussians.quaternions),
        np.clip(np.rint(gaussians.sh_rest.transpose(0, 2, 1) * 128.0 + 128.0), 0, 255).astype(np.uint8),
    ]


def _first_three(rotations: ByteArray) -> FloatArray:
    """Quaternions of version 2: x, y and z in bytes, w the positive rest of the unit length."""
    vector = rotations / 127.5 - 1.0
    return restore_largest(np.zeros(len(vector), np.int64), vector)


def _smallest_three(rotations: ByteArray) -> FloatArray:
    """Quaternions of versions 3 and 4: the largest of (x, y, z, w) in 2 bits, the others in sign and 9 bits."""
    words = np.ascontiguousarray(rotations).view("<u4")[:, 0]
    fields = np.column_stack([words >> 20 & 0x3FF, words >> 10 & 0x3FF, words & 0x3FF])
    others = (fields & 0x1FF) / 511.0 * np.sqrt(0.5) * np.where(fields & 0x200, -1.0, 1.0)
    return np.roll(restore_largest(words >> 30, others), 1, axis=1)


def _pack_smallest_three(quaternions: FloatArray) -> NDArray[np.uint32]:
    largest, others = drop_largest(np.roll(quaternions, -1, axis=1))
    fields = to_levels(np.abs(others), 0.0, np.sqrt(0.5), 9) | np.where(others < 0, np.uint32(0x200), np.uint32(0))
    a, b, c = fields.T
    return np.asarray(largest.astype(np.uint32) << 30 | a << 20 | b << 10 | c, "<u4")
