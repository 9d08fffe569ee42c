"""The .ksplat file of mkkellogg's GaussianSplats3D: sections of rows, whole or packed relative to bucket centres.

A file header of 4096 bytes and a section header of 1024 bytes each; then, section by section, the lengths of buckets
that are not full, the bucket centres, and the rows. Level 0 holds float32, level 1 float16 and centres in 16 bits,
level 2 in addition the coefficients in bytes.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.packing import (
    colours_of,
    from_levels,
    linear_scales,
    log_scales_of,
    opacity_bytes,
    opacity_logits_of,
    sh_dc_of,
    to_levels,
)
from gaussian_trimmer.gaussians import FloatArray, Gaussians, concatenate
from gaussian_trimmer.io.reading import file_bytes
from gaussian_trimmer.io.writing import atomic_file, write_array

_HEADER_SIZE, _SECTION_SIZE = 4096, 1024
_FILE = struct.Struct("<BBxxIIIIHxx3fff")
_SECTION = struct.Struct("<IIIIfHxxIIIIH")
_COEFFICIENTS = (0, 3, 8, 15)
_BANDS = (slice(0, 3), slice(3, 8), slice(8, 15))
_PACKED_RANGE = 32767
_SH_RANGE = 1.5


@dataclass(frozen=True)
class _Ksplat:
    """What all sections share."""

    data: bytes
    path: Path
    level: int
    sh_range: tuple[float, float]


def read(path: Path) -> Gaussians:
    """Return the Gaussians of a .ksplat file, section by section, rows in file order.

    Raises:
        InputError: the file cannot be read, is not a .ksplat file, is damaged or truncated, or holds non-finite values.
    """
    data = file_bytes(path)
    if len(data) < _HEADER_SIZE:
        raise InputError(f"'{path}' is not a .ksplat file or truncated: it has no header of 4096 bytes.")
    major, minor, max_sections, _, _, count, level, _, _, _, least, greatest = _FILE.unpack_from(data)
    if major != 0 or minor < 1 or level > 2:
        raise InputError(f"'{path}' is not a .ksplat file that can be read: version {major}.{minor}, level {level}.")
    start = _HEADER_SIZE + _SECTION_SIZE * max_sections
    if start > len(data):
        raise InputError(f"'{path}' is damaged or truncated: it has no room for {max_sections} section headers.")
    file = _Ksplat(data, path, level, (least or -_SH_RANGE, greatest or _SH_RANGE))
    sections = []
    for i in range(max_sections):
        section, start = _read_section(file, _HEADER_SIZE + _SECTION_SIZE * i, start)
        if len(section):
            sections.append(section)
    if not sections or sum(map(len, sections)) != count:
        raise InputError(f"'{path}' is damaged: it announces {count} Gaussians and has {sum(map(len, sections))}.")
    degree = max(section.sh_degree for section in sections)
    return concatenate([_padded(section, _COEFFICIENTS[degree]) for section in sections])


def write(gaussians: Gaussians, path: Path) -> None:
    """Write a .ksplat file of level 0, one section, in the given order; SH degree 3 is cut to 2, which it can hold.

    Raises:
        InputError: there are no Gaussians, which this format cannot hold.
    """
    n = len(gaussians)
    degree = min(gaussians.sh_degree, 2)
    rows = np.zeros(n, _row_type(0, _COEFFICIENTS[degree]))
    rows["mean"], rows["scale"] = gaussians.means, linear_scales(gaussians)
    rows["rotation"] = gaussians.quaternions / np.linalg.norm(gaussians.quaternions, axis=1, keepdims=True)
    rows["rgba"][:, :3] = to_levels(colours_of(gaussians.sh_dc), 0.0, 1.0, 8)
    rows["rgba"][:, 3] = opacity_bytes(gaussians)
    for band in _BANDS[:degree]:
        rows["sh"][:, 3 * band.start : 3 * band.stop] = gaussians.sh_rest[:, :, band].reshape(n, -1)
    file_header = _FILE.pack(0, 1, 1, 1, n, n, 0, 0, 0, 0, -_SH_RANGE, _SH_RANGE)
    section_header = _SECTION.pack(n, n, 256, 0, 5.0, 12, 1, rows.nbytes, 0, 0, degree)
    with atomic_file(path) as part, part.open("wb") as file:
        file.write(file_header.ljust(_HEADER_SIZE, b"\0") + section_header.ljust(_SECTION_SIZE, b"\0"))
        write_array(file, rows)


def _row_type(level: int, n_coefficients: int) -> np.dtype[np.void]:
    """Return layout of one Gaussian."""
    number, centre = ("<f4", "<f4") if level == 0 else ("<f2", "<u2")
    sh = ("<f4", "<f2", "u1")[level]
    fields = [("mean", centre, 3), ("scale", number, 3), ("rotation", number, 4), ("rgba", "u1", 4)]
    return np.dtype([*fields, ("sh", sh, 3 * n_coefficients)])


def _read_section(file: _Ksplat, header_start: int, start: int) -> tuple[Gaussians, int]:
    """Return the Gaussians of the section whose data begin at `start`, and where the next section's data begin."""
    n, max_n, bucket_size, n_buckets, block_size, bucket_bytes, scale_range, _, n_full, n_partial, degree = (
        _SECTION.unpack_from(file.data, header_start)
    )
    if degree >= len(_COEFFICIENTS) or n > max_n:
        raise InputError(f"'{file.path}' is damaged: a section has {n} of {max_n} rows and SH degree {degree}.")
    row_type = _row_type(file.level, _COEFFICIENTS[degree])
    first_row = start + 4 * n_partial + bucket_bytes * n_buckets
    end = first_row + row_type.itemsize * max_n
    if first_row + row_type.itemsize * n > len(file.data):
        raise InputError(f"'{file.path}' is truncated: {end} bytes are announced, {len(file.data)} are there.")
    rows = np.frombuffer(file.data, row_type, n, first_row)
    means = rows["mean"].astype(np.float32)
    if file.level:
        sizes = np.frombuffer(file.data, "<u4", n_partial, start)
        if bucket_bytes != 12 or n_full + n_partial > n_buckets or n_full * bucket_size + int(sizes.sum()) < n:
            raise InputError(f"'{file.path}' is damaged: the buckets of a section do not hold its {n} Gaussians.")
        centres = np.frombuffer(file.data, "<f4", 3 * n_buckets, start + 4 * n_partial).reshape(-1, 3)
        step = block_size / 2 / (scale_range or _PACKED_RANGE)
        buckets = _bucket_of_each(n, n_full, bucket_size, sizes)
        means = centres[buckets] + (means - np.float32(scale_range or _PACKED_RANGE)) * np.float32(step)
    gaussians = Gaussians(
        means=means,
        log_scales=log_scales_of(rows["scale"].astype(np.float32), file.path),
        quaternions=rows["rotation"],
        opacity_logits=opacity_logits_of(rows["rgba"][:, 3]),
        sh_dc=sh_dc_of(rows["rgba"][:, :3] / 255.0),
        sh_rest=_decode_sh(file, rows["sh"]),
    )
    return gaussians, end


def _bucket_of_each(n: int, n_full: int, bucket_size: int, sizes: NDArray[np.uint32]) -> NDArray[np.int64]:
    """Return the bucket of each of n rows, (n,): full buckets come first, then those of the given sizes."""
    ends = np.cumsum(sizes, dtype=np.int64) + n_full * bucket_size
    rows = np.arange(n)
    partial = n_full + np.searchsorted(ends, rows, side="right")
    return np.where(rows < n_full * bucket_size, rows // max(bucket_size, 1), partial)


def _decode_sh(file: _Ksplat, values: NDArray[Any]) -> FloatArray:
    """Return coefficients (N, 3, K): each band's three channels lie together."""
    floats = from_levels(values, *file.sh_range, 8) if file.level == 2 else values
    bands = [floats[:, 3 * band.start : 3 * band.stop] for band in _BANDS if 3 * band.stop <= values.shape[1]]
    parts = [band.reshape(len(values), 3, band.shape[1] // 3) for band in bands]
    return np.concatenate([np.zeros((len(values), 3, 0)), *parts], axis=2).astype(np.float32)


def _padded(gaussians: Gaussians, n_coefficients: int) -> Gaussians:
    """Return the same with zeros for the coefficients of higher degrees."""
    missing = n_coefficients - gaussians.sh_rest.shape[2]
    return gaussians.replace(sh_rest=np.pad(gaussians.sh_rest, ((0, 0), (0, 0), (0, missing))))
