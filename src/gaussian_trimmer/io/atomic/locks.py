"""Who is writing: locks that the system lets go when their process dies, and what dead processes have left.

What is not finished lies in a part: a file, or a folder with a file LOCK in it, that is locked while its run lives.
"""

from __future__ import annotations

import errno
import hashlib
import os
import platform
import shutil
import sys
from contextlib import suppress
from pathlib import Path

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

PREFIX, SUFFIX = ".gaussian-trimmer", ".part"
"""How the names of parts begin and end."""
LOCK, JOURNAL = "lock", "journal.json"
"""Files in the folder of a part: what is locked, and the record of a swap that is under way (see `swap`)."""
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EINVAL)
_ATTEMPTS = 20
_NO_FOLLOW = getattr(os, "O_NOFOLLOW", 0)


def is_part(path: Path) -> bool:
    """Whether the name is that of a part."""
    return path.name.startswith(PREFIX) and path.suffix == SUFFIX


def part_of(target: Path, home: Path) -> Path:
    """The part of a folder to be written: in the folder itself, or in one of its parents."""
    if home == target:
        return home / f"{PREFIX}{SUFFIX}"
    name = hashlib.sha256(os.fsencode(target.relative_to(home))).hexdigest()[:12]
    return home / f"{PREFIX}-{name}{SUFFIX}"


def new_part(folder: Path) -> tuple[Path, int | None]:
    """Make an empty file to write to; returns it and the descriptor that keeps it locked.

    There is none on Windows, where a locked file could not be written to or renamed.

    Raises:
        OSError: the folder is missing, or cannot be written to.
    """
    for _ in range(_ATTEMPTS):
        part = folder / f"{PREFIX}-{os.urandom(6).hex()}{SUFFIX}"
        descriptor = os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
        if sys.platform == "win32":
            os.close(descriptor)
            return part, None
        # As long as it is not locked it may be taken for a leftover, and removed.
        if _lock_where_possible(descriptor) and _is_open_as(descriptor, part):
            return part, descriptor
        os.close(descriptor)
    raise OSError(errno.EBUSY, "Other programs remove what is written")


def take_lock(path: Path) -> int | None:
    """Lock a file, made if it is missing; returns its descriptor, or None if another process, or thread, has it.

    Raises:
        OSError: the file cannot be opened.
    """
    for _ in range(_ATTEMPTS):
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | _NO_FOLLOW, 0o666)
        if not _lock_or_sign(descriptor):
            os.close(descriptor)
            return None
        if _is_open_as(descriptor, path):
            return descriptor
        os.close(descriptor)  # Who held it has removed it meanwhile.
    return None


def discard(part: Path, lock: int) -> None:
    """Remove the folder of a part, and let its lock go; an unfinished swap is kept for the next run to undo."""
    if not (part / JOURNAL).exists():
        empty(part)
    with suppress(OSError):
        if sys.platform == "win32":
            os.close(lock)
            (part / LOCK).unlink()
        else:  # Still locked, so that it is not another run's that is removed.
            (part / LOCK).unlink()
            os.close(lock)
    with suppress(OSError):
        part.rmdir()


def empty(part: Path) -> None:
    """Remove all that can be removed of what lies in the folder of a part, its lock apart."""
    with suppress(OSError):
        for path in part.iterdir():
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            elif path.name != LOCK:
                path.unlink(missing_ok=True)


def remove_leftovers(folder: Path) -> None:
    """Remove the parts in a folder whose runs have died. Those of swaps inside it have other names and stay."""
    for part in folder.glob(f"{PREFIX}-*{SUFFIX}"):
        with suppress(OSError):
            remove_if_dead(part)


def remove_if_dead(part: Path) -> None:
    """Remove a part, be it a file or a folder, if there is one and its run has died.

    Raises:
        OSError: that cannot be found out.
    """
    if part.is_symlink():
        return
    if part.is_dir():
        if not (part / LOCK).exists():
            part.rmdir()  # Only if it is empty.
        elif (lock := take_lock(part / LOCK)) is not None:
            discard(part, lock)
    elif part.exists() and sys.platform != "win32":
        descriptor = os.open(part, os.O_RDWR | _NO_FOLLOW)
        try:
            if _lock(descriptor) and _is_open_as(descriptor, part):
                part.unlink()
        finally:
            os.close(descriptor)


def _is_open_as(descriptor: int, path: Path) -> bool:
    """Whether the path still leads to the open file."""
    try:
        return os.path.samestat(os.fstat(descriptor), os.lstat(path))
    except OSError:
        return False


def _lock(descriptor: int) -> bool:
    """Lock an open file; False if another process has locked it.

    Raises:
        OSError: the file system keeps no locks.
    """
    if sys.platform == "win32":
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
    else:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True


def _lock_where_possible(descriptor: int) -> bool:
    try:
        return _lock(descriptor)
    except OSError as error:
        if error.errno in _NO_LOCKS:
            return True
        raise


def _lock_or_sign(descriptor: int) -> bool:
    """Lock an open file; where the file system keeps no locks, write into it which process has it."""
    try:
        return _lock(descriptor)
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
    process, _, machine = os.read(descriptor, 300).decode("utf-8", "replace").partition(" ")
    here = platform.node()
    if process.isdecimal() and (machine != here or _is_alive(int(process))):
        return False
    os.lseek(descriptor, 0, os.SEEK_SET)
    os.truncate(descriptor, 0)
    os.write(descriptor, f"{os.getpid()} {here}".encode())
    return True


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        pass
    return True
