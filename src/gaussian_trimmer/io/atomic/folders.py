"""Folders of results that appear whole or not at all, and replace earlier results and nothing else."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.atomic.files import sync_folder, sync_tree
from gaussian_trimmer.io.atomic.locks import (
    LOCK,
    discard,
    is_part,
    part_of,
    remove_if_dead,
    remove_leftovers,
    take_lock,
)
from gaussian_trimmer.io.atomic.manifest import earlier_files, write_manifest
from gaussian_trimmer.io.atomic.swap import NEW, in_the_way, swap, undo
from gaussian_trimmer.io.stop_signals import stop_signals_delayed

_ATTEMPTS, _PAUSE = 4, 0.05


@contextmanager
def atomic_folder(
    folder: Path, kind: str, *, names: Sequence[str] = (), inputs: Iterable[Path] = (), overwrite: bool = False
) -> Iterator[Path]:
    """Give a temporary folder to write to; on success its files become those of `folder`, on failure they vanish.

    A new folder appears by one renaming, parents included. In an existing one the files are exchanged one by one, since
    it may be a mount point or someone's working directory; if that fails they are moved back, and if the process dies
    the next run does so. A file `manifest.json` lists what was written: that alone is replaced later.

    Arguments:
        kind: what writes the folder; only results of the same kind are replaced.
        names: patterns of the files to come, so that one in the way is found at once and not at the end.
        inputs: files that this run reads, or folders whose files it reads.
        overwrite: replace the files of an earlier result.

    Raises:
        InputError: the folder holds something and may not be overwritten, is no folder, cannot be written to, or is
            written to by another run; a file that the program did not write is in the way; what would be replaced is an
            input of this run; or writing failed, say because the disk is full.
    """
    target, lock = Path(os.path.realpath(folder)), None
    try:
        try:
            home = _home(target, folder)
            part = part_of(target, home)
            with stop_signals_delayed():
                lock = _claim(target, home, folder)
            undo(target, part)
            _check(target, folder, kind, names, inputs, overwrite)
            results = part / NEW
            results.mkdir()
        except OSError as error:
            raise InputError(
                f"Cannot write to '{folder}': {error.strerror or error}; choose another folder."
            ) from error
        yield results
        try:
            write_manifest(results, kind)
            sync_tree(results)
            with stop_signals_delayed():
                if home == target:
                    swap(target, part, earlier_files(target, kind) if overwrite else [])
                else:
                    _appear(results, target)
        except OSError as error:
            raise InputError(_failure(folder, error)) from error
    finally:
        if lock is not None:
            with stop_signals_delayed():
                discard(part, lock)


def _home(target: Path, shown: Path) -> Path:
    """The folder that the part lies in: the target, or the nearest of its parents that exists."""
    home = next(place for place in (target, *target.parents) if place.exists())
    if not home.is_dir():
        place = "is" if home == target else f"would lie in '{home}', which is"
        raise InputError(f"'{shown}' {place} a file; choose another output folder.")
    return home


def _claim(target: Path, home: Path, shown: Path) -> int:
    """Make and lock the part of a folder; returns the lock.

    A run that began when fewer parents of the target existed has its part in one of those, so they are asked as well.

    Raises:
        InputError: another run has one of the locks.
    """
    remove_leftovers(home)
    busy = part = part_of(target, home)
    if (lock := _take(part)) is not None:
        taken = [other for place in home.parents if _is_taken(other := part_of(target, place))]
        if not taken:
            return lock
        discard(part, lock)
        busy = taken[0]
    raise InputError(
        f"Another run is writing to '{shown}' (it has locked '{busy / LOCK}'); wait until it ends, or choose another "
        "folder."
    )


def _take(part: Path) -> int | None:
    for attempt in range(_ATTEMPTS):
        if attempt:  # It may be a run that is just ending, or one that looks for leftovers.
            time.sleep(_PAUSE)
        with suppress(FileNotFoundError):  # Who had the part has removed it between the two lines.
            part.mkdir(exist_ok=True)
            if part.is_symlink():
                raise NotADirectoryError(errno.ENOTDIR, f"'{part}' is a link, no folder")
            if (lock := take_lock(part / LOCK)) is not None:
                return lock
    return None


def _is_taken(part: Path) -> bool:
    """Whether another run has the part; that of a dead one is removed."""
    with suppress(OSError):
        remove_if_dead(part)
        return (part / LOCK).exists()
    return False


def _check(target: Path, shown: Path, kind: str, names: Sequence[str], inputs: Iterable[Path], overwrite: bool) -> None:
    """Refuse before anything is computed what could not be finished."""
    if not target.exists():
        return
    if not overwrite and not all(map(is_part, target.iterdir())):
        raise InputError(
            f"The folder '{shown}' is not empty; choose another one, or replace earlier results: --overwrite, or in "
            "Python overwrite=True."
        )
    earlier = earlier_files(target, kind)
    for pattern in names:
        for path in target.glob(pattern):
            in_the_way(target, path.relative_to(target).as_posix(), earlier)
    replaced = {_identity(target / name) for name in earlier}
    for given in inputs:
        for path in given.iterdir() if given.is_dir() else [given]:
            if path.is_file() and _identity(path) in replaced:
                raise InputError(
                    f"'{path}' is an input of this run and belongs to the earlier result in '{shown}' that would be "
                    "replaced; choose another output folder."
                )


def _identity(path: Path) -> tuple[int, int]:
    """What tells a file from others, whichever of its names or links leads to it."""
    found = path.stat()
    return found.st_dev, found.st_ino


def _appear(results: Path, target: Path) -> None:
    """Rename the results to a folder that does not exist, and make its parents."""
    missing = [place for place in target.parents if not place.exists()]
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        results.rename(target)
    except OSError:
        for place in missing:
            with suppress(OSError):
                place.rmdir()
        raise
    for place in (target.parent, *(place.parent for place in missing)):
        sync_folder(place)


def _failure(folder: Path, error: OSError) -> str:
    if error.errno in (errno.ENOTEMPTY, errno.EEXIST):
        return f"Cannot write to '{folder}': it came to hold something else meanwhile; choose another folder."
    name = f" '{error.filename}'" if error.filename else ""
    return f"Cannot write the results to '{folder}': {error.strerror or error}{name}; what was there is unchanged."
