"""What is demanded of a file before memory is taken for what it announces, and of the values in it."""

from __future__ import annotations

from pathlib import Path

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.geometry import limits

_FREE_COUNT = 1 << 16
_BYTES_PER_GAUSSIAN = 4
_ROWS_AT_ONCE = 1 << 12


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

    Looks at a megabyte of rows at a time: of a PLY, the attributes are views of one table, whose rows interleave them.

    Raises:
        InputError: there is one; the message says in which attribute and row.
    """
    try:
        for start in range(0, len(gaussians), _ROWS_AT_ONCE):
            limits.check_values(gaussians.select(slice(start, start + _ROWS_AT_ONCE)))
    except InputError:
        limits.check_values(gaussians, f"'{path}': ")  # counts all of them
