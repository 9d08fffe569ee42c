"""Results appear whole or not at all: single files, and folders that replace earlier results and nothing else.

While results are being made, they wait in `.gaussian-trimmer.part/new` in their folder. At the end, the files that the
manifest of an earlier run lists move to `.gaussian-trimmer.part/old`, the new ones take their places, the manifest
last, and the old ones are deleted. Whatever fails before the manifest is in place moves everything back; of a run that
was killed, the next one does.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from gaussian_trimmer.errors import FolderInUseError, InputError, OutputExistsError
from gaussian_trimmer.io.manifest import MANIFEST, earlier_results, files_in, has_size, listed_sizes, write_manifest
from gaussian_trimmer.io.stop_signals import note_written

if TYPE_CHECKING:
    from numpy.typing import NDArray
import unicodedata

_HIDDEN_PREFIX = ".gaussian-trimmer"
_LOCK = f"{_HIDDEN_PREFIX}.lock"
_STAGING = f"{_HIDDEN_PREFIX}.part"
_LOCK_WAIT_SECONDS = 0.2
_SECONDS_UNTIL_LEFT_OVER = 24 * 3600.0
_LONGEST = 150
"""Bytes; file systems allow 255, of which endings take some."""
_DEVICES = {"con", "prn", "aux", "nul", *(f"{port}{number}" for port in ("com", "lpt") for number in range(10))}
"""Names that Windows keeps for devices, whatever ending they have."""


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` to write to; it replaces `path` on success and is removed on failure.

    Raises:
        InputError: the folder does not exist or cannot be written to, the disk is full, or `path` is a symbolic link,
            a folder or a device.
    """
    part = path.parent / f"{_HIDDEN_PREFIX}-{os.urandom(6).hex()}.part"
    try:
        if os.path.lexists(path) and (path.is_symlink() or not path.is_file()):
            raise InputError(f"Cannot write '{path}': it is not a regular file; choose another name.")
        remove_leftovers(path.parent)
        part.touch(exist_ok=False)
        yield part
        part.replace(path)
        if _STAGING not in path.parts:
            note_written(path)
    except OSError as error:
        raise InputError(f"Cannot write '{path}': {error.strerror or error}.") from error
    finally:
        with suppress(OSError):
            part.unlink()


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it, where they are missing.

    Raises:
        InputError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"The folder '{folder}' cannot be made ({error.strerror}).") from error


def write_whole(path: Path, data: str | bytes | memoryview) -> None:
    """Write a small file, text as UTF-8, whole or not at all.

    Raises:
        InputError: as `atomic_file`.
    """
    with atomic_file(path) as part:
        part.write_bytes(data.encode() if isinstance(data, str) else data)


def write_json(document: Any, path: Path) -> None:
    """Write JSON, whole or not at all.

    Raises:
        InputError: as `atomic_file`.
    """
    write_whole(path, json.dumps(document, indent=1, allow_nan=False) + "\n")


def write_array(file: BinaryIO, array: NDArray[Any]) -> None:
    """Write the bytes of an array in C order; unlike `ndarray.tofile`, notice when the last of them do not fit.

    Raises:
        OSError: not all bytes could be written.
    """
    file.write(array.data if array.flags.c_contiguous else array.tobytes())


@contextmanager
def atomic_folder(
    folder: Path,
    kind: str,
    *,
    names: Sequence[str] = (),
    inputs: Iterable[Path] = (),
    source: Path | None = None,
    overwrite: bool = False,
) -> Iterator[Path]:
    """Yield a temporary folder to write to; its files move to `folder` on success and vanish on failure.

    `manifest.json` lists what was written. A later run replaces these files, as long as they have the size they were
    written with; every other file belongs to the user and stays.

    Args:
        folder: where the results go; it is made if it does not exist, and removed again on failure.
        kind: what writes the folder; only results of the same kind are replaced.
        names: glob patterns of the files to come, so that a file in the way is found before anything is computed.
        inputs: files that this run reads, or folders of such files.
        source: the file or folder that the results are made of, which the manifest names.
        overwrite: replace the results of an earlier run.

    Raises:
        InputError: the folder is not empty and may not be overwritten, is a file, cannot be written to, or another run
            writes to it; a file that is not an earlier result is in the way; or an earlier result is an input.
    """
    missing: list[Path] = []
    try:
        with _os_errors_reported(folder):
            target = Path(os.path.realpath(folder))
            staging = target / _STAGING
            missing = [place for place in (staging, *staging.parents) if not place.exists()]
            staging.mkdir(parents=True, exist_ok=True)
        with _locked(target, folder):
            try:
                with _os_errors_reported(folder):
                    _recover(target)
                    _refuse_files(target, folder, overwrite)
                    earlier = earlier_results(target, kind)
                    found = (path for pattern in names for path in target.glob(pattern))
                    _refuse_conflicts(target, [path.relative_to(target).as_posix() for path in found], earlier)
                    _refuse_inputs(target, earlier, inputs)
                    (staging / "new").mkdir(parents=True)
                yield staging / "new"
                with _os_errors_reported(folder, "what was there is unchanged"):
                    write_manifest(staging / "new", kind, source)
                    _swap(target, earlier_results(target, kind) if overwrite else [])
                    note_written(folder)
            finally:
                _discard(staging)
    finally:
        for place in missing:
            with suppress(OSError):  # It holds the results.
                place.rmdir()


def remove_leftovers(folder: Path) -> None:
    """Give back what dead runs have moved in a folder; remove their results and temporary files that are a day old."""
    with suppress(OSError, InputError):
        for part in folder.glob(f"{_HIDDEN_PREFIX}-*.part"):
            if time.time() - part.lstat().st_mtime > _SECONDS_UNTIL_LEFT_OVER:
                part.unlink()
        if (folder / _STAGING).is_dir() or (folder / _LOCK).exists():
            with _locked(folder, folder):
                _recover(folder.resolve())


@contextmanager
def _os_errors_reported(folder: Path, cure: str = "choose another folder") -> Iterator[None]:
    try:
        yield
    except OSError as error:
        place = f" '{error.filename}'" if error.filename and str(error.filename) != str(folder) else ""
        raise InputError(f"Cannot write to '{folder}': {error.strerror or error}{place}; {cure}.") from error


@contextmanager
def _locked(target: Path, shown: Path) -> Iterator[None]:
    """Hold the lock of a folder, which the system releases when the process dies."""
    from filelock import FileLock, Timeout  # late, since most commands need neither it nor its import

    path = target / _LOCK
    lock = FileLock(path, timeout=_LOCK_WAIT_SECONDS, thread_local=False)
    with _os_errors_reported(shown):
        try:
            lock.acquire()
        except Timeout as error:
            raise FolderInUseError(
                f"Another run is writing to '{shown}' (it has locked '{path}'); wait until it ends, or choose another "
                "folder."
            ) from error
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink()  # while it is locked, so that it is not the file of the next run
        lock.release()


def _refuse_files(target: Path, shown: Path, overwrite: bool) -> None:
    if not overwrite and any(not path.name.startswith(_HIDDEN_PREFIX) for path in target.iterdir()):
        raise OutputExistsError(shown)


def _refuse_conflicts(target: Path, coming: Iterable[str], earlier: Sequence[str]) -> None:
    for name in coming:
        path = target / name
        if path.parent.resolve() != path.parent:
            raise InputError(
                f"'{path.parent}' is a symbolic link where the results need a folder; remove it, or choose another "
                "output folder."
            )
        if name not in earlier and os.path.lexists(path):
            raise InputError(
                f"'{path}' is in the way of a result, and was not written by this program or has changed since; move "
                "it away, or choose another output folder."
            )


def _refuse_inputs(target: Path, earlier: Iterable[str], inputs: Iterable[Path]) -> None:
    replaced = {(target / name).resolve() for name in earlier}
    for given in inputs:
        for path in given.iterdir() if given.is_dir() else [given]:
            if path.resolve() in replaced:
                raise InputError(
                    f"'{path}' is an input of this run and belongs to the earlier results in '{target}' that would be "
                    "replaced; choose another output folder."
                )


def _swap(target: Path, earlier: Sequence[str]) -> None:
    """Move the earlier results into the staging folder and the new ones out of it, or leave everything as it was."""
    new, old = target / _STAGING / "new", target / _STAGING / "old"
    coming = sorted(files_in(new), key=lambda name: name == MANIFEST)
    _refuse_conflicts(target, coming, earlier)
    moves = [(target / name, old / name) for name in earlier] + [(new / name, target / name) for name in coming]
    try:
        for source, goal in moves:
            goal.parent.mkdir(parents=True, exist_ok=True)
            source.rename(goal)
    except BaseException:
        _move_back(target)
        raise
    shutil.rmtree(old, ignore_errors=True)
    _remove_empty_parents(target, earlier)


def _move_back(target: Path) -> None:
    """Undo the moves of a swap that did not end, as far as files still are what it moved.

    Raises:
        InputError: an earlier result cannot be moved back.
    """
    new, old = target / _STAGING / "new", target / _STAGING / "old"
    sizes = listed_sizes(new)
    coming = [name for name, size in sizes.items() if not os.path.lexists(new / name) and has_size(target, name, size)]
    moves = [(target / name, new / name) for name in coming] + [(old / name, target / name) for name in files_in(old)]
    try:
        for source, goal in moves:
            if os.path.lexists(goal):
                raise FileExistsError(errno.EEXIST, f"another file is at '{goal}'")
            goal.parent.mkdir(parents=True, exist_ok=True)
            source.rename(goal)
    except OSError as error:
        raise InputError(
            f"Earlier results of '{target}' cannot be moved back from '{old}': {error.strerror or error}; mend that, "
            "and run again."
        ) from error
    _remove_empty_parents(target, sizes)


def _recover(target: Path) -> None:
    """Undo a swap that was killed, unless its manifest, which moves last, is in place; remove its staging folder."""
    if os.path.lexists(target / _STAGING / "new" / MANIFEST):
        _move_back(target)
    _discard(target / _STAGING)


def _discard(staging: Path) -> None:
    """Remove the staging folder, unless it holds earlier results that could not be moved back."""
    if os.path.lexists(staging / "new" / MANIFEST) and files_in(staging / "old"):
        return
    with suppress(OSError):  # first, since it says that files which are not in the folder have been moved
        (staging / "new" / MANIFEST).unlink()
    shutil.rmtree(staging, ignore_errors=True)


def _remove_empty_parents(folder: Path, names: Iterable[str]) -> None:
    parents = {parent for name in names for parent in Path(name).parents} - {Path()}
    for parent in sorted(parents, key=lambda parent: -len(parent.parts)):
        with suppress(OSError):
            (folder / parent).rmdir()


def save_array(selection: NDArray[Any], path: Path) -> None:
    """Write an .npy file; unlike `np.save`, this notices everywhere that a disk is full.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(path, npy_bytes(selection))


def npy_bytes(array: NDArray[Any]) -> bytes:
    """Return the bytes of an .npy file."""
    import numpy as np

    buffer = BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()


def safe_file_name(name: str, punctuation: str = "-_") -> str:
    """Return a name with _ in place of every character that is neither a letter or digit nor in `punctuation`.

    >>> safe_file_name("my scene 1.5"), safe_file_name("my scene 1.5", ".-_"), safe_file_name("NUL"), safe_file_name("")
    ('my_scene_1_5', 'my_scene_1.5', '_NUL', '_')
    """
    name = unicodedata.normalize("NFKC", name)
    safe = "".join(c if c.isalnum() or c in punctuation else "_" for c in name).lstrip(".-")
    safe = safe.encode()[:_LONGEST].decode(errors="ignore").rstrip(".")
    return f"_{safe}" if not safe or safe.partition(".")[0].casefold() in _DEVICES else safe
