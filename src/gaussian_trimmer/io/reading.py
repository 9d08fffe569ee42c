"""Files from others: regular ones only, read whole and within bounds, and refused if they change meanwhile."""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, clip_name

LARGEST = 1e15
"""Greatest magnitude of coordinates, coefficients and weights; the square of a greater one nears the end of float32."""
_BYTES_AT_ONCE = 1 << 20
_MAX_JSON_BYTES = 1 << 24


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Check that a file is the same before and after it is read: a training may still be writing it.

    Raises:
        InputError: the file cannot be read, is not a regular file, or has changed in size, time or identity.
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
    """Whether a path leads to a regular file; one that the file system refuses, say for its length, does not.

    >>> is_file(Path("x" * 9999))
    False
    """
    return os.path.isfile(path)  # noqa: PTH113 (Path.is_file raises instead)


def is_folder(path: Path) -> bool:
    """Whether a path leads to a folder; one that the file system refuses does not."""
    return os.path.isdir(path)  # noqa: PTH112


def path_inside(folder: Path, name: str) -> Path | None:
    """The path of a name from a file in a folder of the user's; None if the name leads out of the folder.

    >>> path_inside(Path("images"), "left/1.png").as_posix()
    'images/left/1.png'
    >>> [path_inside(Path("images"), name) for name in ("../1.png", "/etc/passwd", "/", "")]
    [None, None, None, None]
    """
    relative = PurePath(name)
    if relative.anchor or ".." in relative.parts or not relative.name:
        return None
    return folder / relative


def file_bytes(path: Path, limit: int | None = None) -> bytes:
    """The contents of a regular file of at most `limit` bytes.

    Raises:
        InputError: the file cannot be read, or is larger.
    """
    try:
        size = _state(path)[0]
        if limit is not None and size > limit:
            raise InputError(f"'{path}' has {size} bytes; at most {limit} can be read of a file of its kind.")
        with path.open("rb") as file:
            return file.read(size)  # no more than that, should it be growing
    except OSError as error:
        raise InputError(f"Cannot read '{path}': {error.strerror or error}.") from error


def read_json(path: Path, limit: int = _MAX_JSON_BYTES) -> Any:
    """Return what a JSON file of at most `limit` bytes holds.

    Raises:
        InputError: there is no file, or it cannot be read as JSON.
    """
    if not is_file(path):
        raise InputError(f"There is no file '{path}'.")
    with reading(path):
        data = file_bytes(path, limit)
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise InputError(f"'{path}' cannot be read as JSON ({clip_name(str(error))}).") from error


def read_into(array: NDArray[np.generic], file: BinaryIO, path: Path) -> None:
    """Fill a contiguous array with the bytes that follow in an open file.

    Raises:
        InputError: the file ends too early.
    """
    data = array.reshape(-1).view(np.uint8).data
    for start in range(0, len(data), _BYTES_AT_ONCE):
        piece = data[start : start + _BYTES_AT_ONCE]
        if file.readinto(piece) < len(piece):  # type: ignore[attr-defined]
            raise InputError(f"'{path}' became shorter while it was read; try again when it is complete.")


def _state(path: Path) -> tuple[int, int, int, int]:
    """Size, time of the last change and identity of a regular file."""
    status = path.stat()
    if not stat.S_ISREG(status.st_mode) and not stat.S_ISDIR(status.st_mode):  # opening a folder fails by itself
        raise InputError(f"'{path}' is not a regular file.")
    return status.st_size, status.st_mtime_ns, status.st_ino, status.st_dev
