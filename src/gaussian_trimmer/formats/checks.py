"""What every reader demands of a file before and after it is decoded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.geometry.limits import LARGEST_LOG_SCALE
from gaussian_trimmer.io.reading import LARGEST

SHORTEST, LONGEST = 1e-12, 1e12
"""Lengths of quaternions; of shorter and longer ones, float32 cannot tell the direction."""
_ROWS_PER_CHUNK = 1 << 12
"""Rows that are tested at once: few enough that the test's result stays in the cache."""
_FREE_COUNT = 1 << 16
_BYTES_PER_GAUSSIAN = 4


def check_count(count: int, path: Path, size: int | None = None) -> None:
    """Refuse a count of Gaussians that a compressed file of this size cannot hold, before memory is taken for it.

    Centres are noise to a compressor: real files spend five bytes and more on a Gaussian. Four bytes each, beyond a
    first 65,536 that cost little, let every real file pass and bound what a crafted one can make us allocate.

    Args:
        count: what the file announces.
        path: the file.
        size: bytes that hold the Gaussians, where that is not the file's own size.

    Raises:
        InputError: the count is zero or beyond what the file's size allows.
    """
    if count <= 0:
        raise InputError(f"'{path}' holds zero Gaussians.")
    size = path.stat().st_size if size is None else size
    if count > _FREE_COUNT + size // _BYTES_PER_GAUSSIAN:
        raise InputError(f"'{path}' is damaged: it announces {count} Gaussians in a file of {size} bytes.")


def check_values(gaussians: Gaussians, path: Path) -> None:
    """Refuse values with which nothing can be computed: NaN, infinities, extreme magnitudes, lengths of zero.

    Raises:
        InputError: there is one; the message says in which attribute and row.
    """
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"):
        _check_attribute(name, getattr(gaussians, name), path)


def is_sound(name: str, values: FloatArray) -> BoolArray:
    """Which values of an attribute, of any shape, can be computed with; quaternions are judged by `has_direction`."""
    with np.errstate(invalid="ignore"):
        if name == "log_scales":
            return np.isfinite(values) & (values <= LARGEST_LOG_SCALE)
        return np.isfinite(values) if name == "opacity_logits" else np.abs(values) <= LARGEST


def has_direction(quaternions: FloatArray) -> BoolArray:
    """Which quaternions (N, 4) are of a length that leaves no doubt about their direction, (N,)."""
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        squares = np.einsum("ij,ij->i", quaternions, quaternions)
    return np.asarray((squares >= SHORTEST**2) & (squares <= LONGEST**2))


def _check_attribute(name: str, values: FloatArray, path: Path) -> None:
    """Refuse an attribute (N, ...) with a value that cannot be computed with; in chunks, which is fastest.

    Raises:
        InputError: there is one; the message says in which row.
    """
    for start in range(0, len(values), _ROWS_PER_CHUNK):
        chunk = values[start : start + _ROWS_PER_CHUNK]
        sound = has_direction(chunk) if name == "quaternions" else is_sound(name, chunk)
        if not sound.all():
            row = int(np.argmin(sound.reshape(len(sound), -1).all(axis=1)))
            _refuse(name, chunk[row], start + row, path)


def _refuse(name: str, values: NDArray[Any], row: int, path: Path) -> None:
    """Say what is wrong with the values of one row.

    Raises:
        InputError: always.
    """
    values = np.atleast_1d(values).reshape(-1)
    if not np.isfinite(values).all():
        raise InputError(f"'{path}' holds NaN or infinite {name}, first in row {row}; remove such Gaussians first.")
    if name == "quaternions":
        length = float(np.linalg.norm(values.astype(np.float64)))
        raise InputError(
            f"'{path}' holds a rotation quaternion of length zero in row {row}."
            if length == 0
            else f"'{path}' holds a rotation quaternion of length {length:.3g} in row {row}; lengths from "
            f"{SHORTEST:g} to {LONGEST:g} can be used, so bring the quaternions to length one first."
        )
    extreme = float(values[np.argmax(np.abs(values))]) if name != "log_scales" else float(values.max())
    limit = LARGEST_LOG_SCALE if name == "log_scales" else LARGEST
    raise InputError(
        f"'{path}' holds {name} of {extreme:.3g}, first in row {row}; values up to {limit:g} can be used, so remove "
        "such Gaussians or rescale the scene first."
    )
