"""Files and folders that appear whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from gaussian_trimmer.errors import InputError


@contextmanager
def atomic_folder(folder: Path, stale: Sequence[str] = (), *, overwrite: bool = False) -> Iterator[Path]:
    """Give a temporary folder to write to; on success its entries become those of `folder`, on failure it vanishes.

    A new folder appears by one renaming, parents included. In an existing one the entries are renamed one by one: it
    may be a mount point or someone's working directory, which cannot be renamed themselves.

    Arguments:
        stale: patterns of names of earlier results, which go when the new ones come; what else the folder holds stays.
        overwrite: allow a folder that holds anything.

    Raises:
        InputError: the folder holds something and may not be overwritten, is no folder, or cannot be written to; or
            writing failed, say because the disk is full.
    """
    folder = folder.absolute()
    _check(folder, overwrite)
    home = next(place for place in (folder, *folder.parents) if place.exists())
    try:
        part = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".part", dir=home))
    except OSError as error:
        raise InputError(f"Cannot write to '{folder}': {error.strerror}; choose another folder.") from error
    try:
        results = part / "results"
        results.mkdir()
        yield results
        if home == folder:
            _replace_entries(folder, results, part, stale)
        else:
            folder.parent.mkdir(parents=True, exist_ok=True)
            results.rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def check_folder(folder: Path | None, *, overwrite: bool) -> None:
    """Refuse, before anything is measured or made, a folder that `atomic_folder` would refuse; None is fine.

    Raises:
        InputError: the folder is a file, or holds something and may not be overwritten.
    """
    if folder is not None:
        _check(folder.absolute(), overwrite)


def _check(folder: Path, overwrite: bool) -> None:
    try:
        if folder.exists() and not folder.is_dir():
            raise InputError(f"'{folder}' is a file; choose another output folder.")
        if folder.is_dir() and any(folder.iterdir()) and not overwrite:
            raise InputError(
                f"The folder '{folder}' is not empty; choose another one, or replace earlier results with --overwrite."
            )
    except OSError as error:
        raise InputError(f"Cannot use '{folder}' for output: {error.strerror}; choose another folder.") from error


def _replace_entries(folder: Path, results: Path, part: Path, stale: Sequence[str]) -> None:
    """Move the new entries into the folder, and those in their way, or stale, into the part that is then deleted."""
    old = part / "old"
    old.mkdir()
    outdated = {path.name for pattern in stale for path in folder.glob(pattern)}
    for name in outdated | {path.name for path in results.iterdir() if (folder / path.name).exists()}:
        (folder / name).rename(old / name)
    for path in results.iterdir():
        path.rename(folder / path.name)


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path` to write to; rename it to `path` on success and remove it on failure.

    Raises:
        InputError: the folder does not exist or cannot be written to, or the disk is full.
    """
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    except OSError as error:
        raise InputError(f"Cannot write '{path}': {error.strerror}.") from error
    os.close(handle)
    part = Path(name)
    try:
        yield part
        part.chmod(0o666 & ~_umask())
        part.replace(path)
    except OSError as error:
        raise InputError(f"Cannot write '{path}': {error.strerror or error}.") from error
    finally:
        part.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
