"""Folders of results that appear whole or not at all, and replace earlier results and nothing else.

While results are being made, they wait in `.gaussian-trimmer.part/new` in their folder. At the end, the files that the
manifest of an earlier run lists, `manifest.json`, move to `.gaussian-trimmer.part/old`, the new ones take their places,
the manifest last, and the old ones are deleted. Whatever fails before the manifest is in place moves everything back;
of a run that was killed, the next one does.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from gaussian_trimmer._version import __version__
from gaussian_trimmer.errors import FolderInUseError, InputError, OutputExistsError
from gaussian_trimmer.io.reading import is_file, read_json
from gaussian_trimmer.io.writing import HIDDEN_PREFIX, STAGING, note_written, remove_old_parts

MANIFEST = "manifest.json"
_PROGRAM = "gaussian-trimmer"
_LOCK = f"{HIDDEN_PREFIX}.lock"
_LOCK_WAIT_SECONDS = 0.2


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
            staging = target / STAGING
            missing = [place for place in (staging, *staging.parents) if not place.exists()]
            staging.mkdir(parents=True, exist_ok=True)
        with _locked(target, folder):
            try:
                with _os_errors_reported(folder):
                    _recover(target)
                    if not overwrite and any(not path.name.startswith(HIDDEN_PREFIX) for path in target.iterdir()):
                        raise OutputExistsError(folder)
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
    remove_old_parts(folder)
    with suppress(OSError, InputError):
        if (folder / STAGING).is_dir() or (folder / _LOCK).exists():
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
    new, old = target / STAGING / "new", target / STAGING / "old"
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
    new, old = target / STAGING / "new", target / STAGING / "old"
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
    if os.path.lexists(target / STAGING / "new" / MANIFEST):
        _move_back(target)
    _discard(target / STAGING)


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


def write_manifest(folder: Path, kind: str, source: Path | None = None) -> None:
    """List the files of a folder with their sizes; `kind` is what wrote them, `source` what they were made of."""
    sizes = {name: (folder / name).stat().st_size for name in files_in(folder)}
    made_of = None if source is None else str(source.resolve())
    contents = {"program": _PROGRAM, "version": __version__, "kind": kind, "source": made_of, "files": sizes}
    (folder / MANIFEST).write_text(json.dumps(contents, indent=1) + "\n", encoding="utf-8")


def earlier_results(folder: Path, kind: str) -> list[str]:
    """The manifest of a folder, and the files that it lists and that still have the size they were written with.

    Nothing where there is no manifest of this program. Files behind links and outside the folder do not count.

    Raises:
        InputError: the folder holds results of another kind.
    """
    sizes, found = listed_sizes(folder), _read(folder).get("kind")
    if not sizes:
        return []
    if found != kind:
        raise InputError(
            f"'{folder}' holds the results of '{found}', which '{kind}' does not replace; choose another folder."
        )
    unchanged = (name for name in files_in(folder) if name in sizes and has_size(folder, name, sizes[name]))
    return [MANIFEST, *(name for name in unchanged if name != MANIFEST)]


def listed_sizes(folder: Path) -> dict[str, int]:
    """Return the sizes of the files that the manifest of a folder lists; none where it is missing or damaged."""
    sizes = _read(folder).get("files")
    return sizes if isinstance(sizes, dict) else {}


def is_complete(folder: Path) -> bool:
    """Return whether all files are in a folder that its manifest lists, as large as they were written."""
    sizes = listed_sizes(folder)
    return bool(sizes) and all(has_size(folder, name, size) for name, size in sizes.items())


def is_made_of(folder: Path, source: Path) -> bool:
    """Whether a folder holds results of an earlier run that were made of a given file or folder."""
    return _read(folder).get("source") == str(source.resolve())


def files_in(folder: Path) -> list[str]:
    """Paths of all files in a folder and below, relative to it, with slashes."""
    paths = (Path(place, name) for place, _, names in os.walk(folder) for name in names)
    return sorted(path.relative_to(folder).as_posix() for path in paths)


def _read(folder: Path) -> dict[str, Any]:
    """The manifest of a folder; empty where there is none of this program."""
    path, manifest = folder / MANIFEST, None
    with suppress(InputError):
        manifest = None if path.is_symlink() else read_json(path)
    return manifest if isinstance(manifest, dict) and manifest.get("program") == _PROGRAM else {}


def has_size(folder: Path, name: str, size: object) -> bool:
    """Return whether a file is in a folder, not behind links, and still as large as when it was written."""
    path = folder.resolve() / name
    return is_file(path) and path.resolve() == path and path.stat().st_size == size
