"""What every reader demands of a file before and after it is decoded."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import FloatArray, Gaussians

_ROWS_PER_CHUNK = 1 << 12
"""Rows that are tested at once: few enough that the test's result stays in the cache."""
_FREE_COUNT = 1 << 16


def file_bytes(path: Path) -> bytes:
    """The contents of a file.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"Cannot read '{path}': {error.strerror}.") from error


def check_count(count: int, path: Path) -> None:
    """Refuse a count of Gaussians that a compressed file of this size cannot hold, before memory is taken for it.

    Centres are noise to a compressor: real files spend five bytes and more on a Gaussian. One byte each, beyond a
    first 65,536 that cost little, lets every real file pass and bounds what a crafted one can make us allocate.

    Raises:
        InputError: the count is zero or beyond what the file's size allows.
    """
    if count <= 0:
        raise InputError(f"'{path}' holds zero Gaussians.")
    size = path.stat().st_size
    if count > _FREE_COUNT + size:
        raise InputError(f"'{path}' is damaged: it announces {count} Gaussians in a file of {size} bytes.")


def all_finite(values: FloatArray) -> bool:
    """Whether an array (N, ...) holds neither NaN nor infinities; fastest on rows without gaps."""
    starts = range(0, len(values), _ROWS_PER_CHUNK)
    return all(bool(np.isfinite(values[start : start + _ROWS_PER_CHUNK]).all()) for start in starts)


def check_finite(gaussians: Gaussians, path: Path) -> None:
    """Refuse NaN, infinities and quaternions of length zero.

    Raises:
        InputError: a value is not finite; the message says in which attribute and row.
    """
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"):
        values = getattr(gaussians, name)
        if all_finite(values):
            continue
        finite = np.isfinite(values)
        row = int(np.argmin(finite if finite.ndim == 1 else finite.all(axis=tuple(range(1, finite.ndim)))))
        raise InputError(f"'{path}' holds NaN or infinite {name}, first in row {row}; remove such Gaussians first.")
    check_rotations(gaussians.quaternions, path)


def check_rotations(quaternions: FloatArray, path: Path) -> None:
    """Refuse quaternions (N, 4) of length zero, which are no rotation.

    Raises:
        InputError: there is one; the message says in which row.
    """
    for start in range(0, len(quaternions), _ROWS_PER_CHUNK):
        zero = (quaternions[start : start + _ROWS_PER_CHUNK] == 0).all(axis=1)
        if zero.any():
            raise InputError(
                f"'{path}' holds a rotation quaternion of length zero in row {start + int(np.argmax(zero))}."
            )
