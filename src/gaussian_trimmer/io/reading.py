"""Files of strangers: read whole, within bounds, and refused if they change meanwhile."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError

LARGEST = 1e15
"""Greatest magnitude of coordinates, coefficients and weights; the square of a greater one nears the end of float32."""
_BYTES_AT_ONCE = 1 << 20


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Watch over the reading of a file: what the operating system refuses, or what changes meanwhile, is an error.

    A file that is still being written can be read without any sign of damage, half of it old and half new. Size, time
    of the last change and identity are compared before and after; nothing of the file may be looked at later, which
    is why no reader keeps it mapped.

    Raises:
        InputError: the file cannot be read, or is not the same before and after.
    """
    try:
        before = _state(path)
        yield
        after = _state(path)
    except OSError as error:
        raise InputError(f"Cannot read '{path}': {error.strerror or error}.") from error
    if before != after:
        raise InputError(f"'{path}' changed while it was read; try again when it is complete.")


def is_file(path: Path) -> bool:
    """Whether a path is that of a regular file; a name that the file system refuses, say for its length, is not.

    >>> is_file(Path("x" * 9999))
    False
    """
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Whether a path is that of a folder; a name that the file system refuses is not.

    >>> is_folder(Path("x" * 9999))
    False
    """
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def file_bytes(path: Path, limit: int | None = None) -> bytes:
    """The contents of a file of at most `limit` bytes.

    Raises:
        InputError: the file cannot be read, or is larger.
    """
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            if limit is not None and size > limit:
                raise InputError(f"'{path}' has {size} bytes; at most {limit} can be read of a file of its kind.")
            return file.read(size)  # no more than that, should it be growing
    except OSError as error:
        raise InputError(f"Cannot read '{path}': {error.strerror or error}.") from error


def read_into(array: NDArray[np.generic], file: BinaryIO, path: Path) -> None:
    """Fill an array, which lies in one piece, with the bytes that follow in an open file.

    Raises:
        InputError: the file ends too early.
    """
    data = array.reshape(-1).view(np.uint8).data
    for start in range(0, len(data), _BYTES_AT_ONCE):
        piece = data[start : start + _BYTES_AT_ONCE]
        if file.readinto(piece) < len(piece):  # type: ignore[attr-defined]
            raise InputError(f"'{path}' became shorter while it was read; try again when it is complete.")


def _state(path: Path) -> tuple[int, int, int, int]:
    status = path.stat()
    return status.st_size, status.st_mtime_ns, status.st_ino, status.st_dev
