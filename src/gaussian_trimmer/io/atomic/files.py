"""Files that appear whole or not at all, and are on the disk when they appear."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.atomic.locks import is_part, new_part, remove_leftovers

if TYPE_CHECKING:
    from numpy.typing import NDArray

_DISK_ERRORS = (errno.EIO, errno.ENOSPC, errno.EDQUOT)


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path` to write to; rename it to `path` on success and remove it on failure.

    Before the renaming the contents are flushed to the disk, since some disks say only then that they are full. What
    killed runs have left in the folder is removed.

    Raises:
        InputError: the folder does not exist or cannot be written to, or the disk is full.
    """
    try:
        remove_leftovers(path.parent)
        part, lock = new_part(path.parent)
    except OSError as error:
        raise InputError(f"Cannot write '{path}': {error.strerror or error}.") from error
    awaits_its_folder = any(map(is_part, path.absolute().parents))  # which is brought to the disk as a whole
    try:
        yield part
        if not awaits_its_folder:
            sync_file(part)
        part.replace(path)
        if not awaits_its_folder:
            sync_folder(path.parent)
    except OSError as error:
        raise InputError(f"Cannot write '{path}': {error.strerror or error}.") from error
    finally:
        part.unlink(missing_ok=True)
        if lock is not None:
            os.close(lock)


def write_array(file: BinaryIO, array: NDArray[Any]) -> None:
    """Write the bytes of an array in C order.

    `ndarray.tofile` and `np.save` hand their last bytes to the C library, and say nothing when these do not fit on the
    disk any more.

    Raises:
        OSError: not all could be written.
    """
    file.write(array.data if array.flags.c_contiguous else array.tobytes())


def sync_file(path: Path) -> None:
    """Wait until the contents of a file are on the disk.

    Raises:
        OSError: they cannot be brought there.
    """
    _sync(path, os.O_RDWR)


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk, where the system can say so.

    Raises:
        OSError: the disk failed.
    """
    if os.name == "posix":
        _sync(folder, os.O_RDONLY)


def sync_tree(folder: Path) -> None:
    """Wait until everything in a folder is on the disk.

    Raises:
        OSError: it cannot be brought there.
    """
    for place, _, names in os.walk(folder):
        for name in names:
            sync_file(Path(place, name))
        sync_folder(Path(place))


def _sync(path: Path, flags: int) -> None:
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno in _DISK_ERRORS:  # Others mean that the file system has no such call.
            raise
    finally:
        os.close(descriptor)
