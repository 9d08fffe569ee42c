"""Folders of results that appear whole or not at all, and replace earlier results and nothing else.

While results are being made, they wait in their folder, in `new` of a staging folder with a random name. At the end,
the files that the manifest of an earlier run lists, `manifest.json`, move to `old` of it, the new ones take their
places, the manifest last, and the old ones are deleted. Whatever fails before the manifest is in place moves everything
back; of a run that was killed, the next one does, by a journal in the user's private state. A manifest counts if it is
signed with a secret of that state: nothing else that lies in the folder, which may come from a stranger, says what to
move or to delete.
"""

from __future__ import annotations

import errno
import hashlib
import hmac
import json
import logging
import os
import shutil
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from gaussian_trimmer._version import __version__
from gaussian_trimmer.errors import FolderInUseError, InputError, OutputExistsError, printable
from gaussian_trimmer.io.reading import is_file, read_json
from gaussian_trimmer.io.writing import (
    HIDDEN_PREFIX,
    note_written,
    private_folder,
    remove_old_parts,
    state_folder,
    write_private,
)

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

    `manifest.json` lists what was written. A later run of the same user on this machine replaces these files, if they
    still have the size they were written with; every other file belongs to the user and stays.

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
            missing = [place for place in (target, *target.parents) if not place.exists()]
            target.mkdir(parents=True, exist_ok=True)
        with _locked(target, folder):
            staging = target / f"{HIDDEN_PREFIX}.{os.urandom(6).hex()}.part"
            run = {"folder": str(target), "staging": staging.name, "moves": []}
            _recover(target)
            try:
                with _os_errors_reported(folder):
                    if not overwrite and any(not path.name.startswith(HIDDEN_PREFIX) for path in target.iterdir()):
                        raise OutputExistsError(folder)
                    earlier = earlier_results(target, kind)
                    found = (path for pattern in names for path in target.glob(pattern))
                    coming = [MANIFEST, *(path.relative_to(target).as_posix() for path in found)]
                    _refuse_conflicts(target, coming, earlier)
                    _refuse_inputs(target, earlier, inputs)
                    _keep_journal(target, run)
                    (staging / "new").mkdir(parents=True)
                yield staging / "new"
                with _os_errors_reported(folder, "what was there is unchanged"):
                    write_manifest(staging / "new", kind, source)
                    _swap(target, run, earlier_results(target, kind) if overwrite else [])
            finally:
                if _end(target, run):
                    note_written(folder)
    finally:
        for place in missing:
            with suppress(OSError):  # It holds the results.
                place.rmdir()


def remove_leftovers(folder: Path) -> None:
    """Give back what dead runs have moved in a folder; remove their results and temporary files that are a day old."""
    remove_old_parts(folder)
    with suppress(OSError, InputError):
        target = Path(os.path.realpath(folder))
        if _journal_of(target).exists() or (target / _LOCK).exists():
            with _locked(target, folder):
                _recover(target)


@contextmanager
def _os_errors_reported(folder: Path, cure: str = "choose another folder") -> Iterator[None]:
    try:
        yield
    except OSError as error:
        place = f" '{error.filename}'" if error.filename and str(error.filename) != str(folder) else ""
        raise InputError(f"Cannot write to '{folder}': {error.strerror or error}{place}; {cure}.") from error


@contextmanager
def _locked(target: Path, shown: Path) -> Iterator[None]:
    """Hold the lock of a folder, which the system releases when the process dies.

    Raises:
        InputError: another run holds it, or what has its name is not a lock, and might be emptied by locking it.
    """
    from filelock import FileLock, Timeout  # late, since most commands need neither it nor its import

    path = target / _LOCK
    with suppress(OSError):
        status = path.lstat()
        if not stat.S_ISREG(status.st_mode) or status.st_size or status.st_nlink > 1:
            raise InputError(f"'{path}' is not a lock of this program; delete it, or choose another folder.")
    lock = FileLock(path, timeout=_LOCK_WAIT_SECONDS, thread_local=False)
    with _os_errors_reported(shown):
        try:
            lock.acquire()
        except Timeout as error:
            raise FolderInUseError(
                f"Another run is writing to '{shown}' (it has locked '{path}'); wait until it ends, or choose another "
                "folder."
            ) from error
        except PermissionError as error:
            if not path.exists():
                raise
            raise FolderInUseError(
                f"'{path}' is the lock of another user's run in '{shown}'; wait until it ends, delete the lock if it "
                "has died, or choose another folder."
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
                f"'{path}' is in the way of a result, and was not written by you with this program on this machine, or "
                "has changed since; move it away, or choose another output folder. Machines for which XDG_STATE_HOME "
                "is one shared folder replace each other's results."
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


def _swap(target: Path, run: dict[str, Any], earlier: Sequence[str]) -> None:
    """Move the earlier results into the staging folder and the new ones out of it."""
    new, old = f"{run['staging']}/new", f"{run['staging']}/old"
    coming = sorted(files_in(target / new), key=lambda name: name == MANIFEST)
    _refuse_conflicts(target, coming, earlier)
    pairs = [(name, f"{old}/{name}") for name in earlier] + [(f"{new}/{name}", name) for name in coming]
    run["moves"] = [[source, goal, _identity(target / source)] for source, goal in pairs]
    _keep_journal(target, run)
    for source, goal in pairs:
        (target / goal).parent.mkdir(parents=True, exist_ok=True)
        (target / source).rename(target / goal)
    run["complete"] = True


def _end(target: Path, run: Mapping[str, Any]) -> bool:
    """Undo the moves of a run, unless its manifest, which moves last, is in place; remove what it has left.

    Only files that still are what the run moved move back. Return whether the run was complete.

    Raises:
        InputError: an earlier result cannot be moved back; all that is left of the run stays.
    """
    staging, moves = run["staging"], run["moves"]
    old = target / staging / "old"
    complete = "complete" in run or (bool(moves) and _identity(target / moves[-1][1]) == moves[-1][2])
    try:
        for source, goal, identity in [] if complete else reversed(moves):
            if _identity(target / goal) == identity:
                _move_back(target / goal, target / source)
        if not complete and files_in(old):
            raise FileExistsError(errno.EEXIST, "they have changed since")
    except OSError as error:
        raise InputError(
            f"Earlier results of '{target}' cannot be moved back from '{old}': {error.strerror or error}; mend that, "
            "and run again."
        ) from error
    shutil.rmtree(target / staging, ignore_errors=True)
    if not (target / staging).exists():  # what could not be removed, say for lack of memory, the next run removes
        with suppress(OSError, InputError):
            _journal_of(target).unlink()
    _remove_empty_parents(target, (name for move in moves for name in move[:2] if not name.startswith(staging)))
    return complete


def _move_back(path: Path, goal: Path) -> None:
    if goal.parent.resolve() != goal.parent:
        raise OSError(errno.ELOOP, f"'{goal.parent}' is a symbolic link")
    if os.path.lexists(goal):
        raise FileExistsError(errno.EEXIST, f"another file is at '{goal}'")
    goal.parent.mkdir(parents=True, exist_ok=True)
    path.rename(goal)


def _identity(path: Path) -> list[int] | None:
    """Return inode, size and time of a file, which stay when it is moved; None if it is missing or behind a link."""
    with suppress(OSError):
        status = path.lstat()
        if path.parent.resolve() == path.parent:
            return [status.st_ino, status.st_size, status.st_mtime_ns]
    return None


def _journal_of(target: Path) -> Path:
    """Return the file in which the run that writes to a folder notes what it has begun there."""
    return state_folder() / "runs" / f"{hashlib.sha256(os.fsencode(target)).hexdigest()[:32]}.json"


def _keep_journal(target: Path, run: Mapping[str, Any]) -> None:
    """Note what a run has begun, for the next one; without a place for it, what a kill leaves is for the user."""
    with suppress(OSError, InputError):
        journal = _journal_of(target)
        private_folder(journal.parent)
        part = journal.with_suffix(".part")
        part.write_text(json.dumps(run), encoding="utf-8")
        part.replace(journal)


def _recover(target: Path) -> None:
    """Undo what this user's last run has begun in a folder, if it was killed; name what others have left there."""
    run = None
    with suppress(InputError):
        run = read_json(_journal_of(target))
    if isinstance(run, dict) and run.get("folder") == str(target):
        _end(target, run)
    for path in sorted(target.glob(f"{HIDDEN_PREFIX}*.part")):
        if path.is_symlink() or path.is_dir():
            logging.getLogger(__name__).warning(
                "'%s' is of a run that you did not begin on this machine, or not of this program; it stays as it is: "
                "take what you miss out of it, and delete it.",
                printable(str(path)),
            )


def _remove_empty_parents(folder: Path, names: Iterable[str]) -> None:
    parents = {parent for name in names for parent in Path(name).parents} - {Path()}
    for parent in sorted(parents, key=lambda parent: -len(parent.parts)):
        with suppress(OSError):
            (folder / parent).rmdir()


def write_manifest(folder: Path, kind: str, source: Path | None = None) -> None:
    """List the files of a folder with their sizes; `kind` is what wrote them, `source` what they were made of."""
    sizes = {name: (folder / name).stat().st_size for name in files_in(folder)}
    made_of = None if source is None else str(source.resolve())
    contents: dict[str, Any] = {"program": _PROGRAM, "version": __version__, "kind": kind, "source": made_of}
    contents["files"] = sizes
    contents["signature"] = _signature(contents, for_new=True)
    (folder / MANIFEST).write_text(json.dumps(contents, indent=1) + "\n", encoding="utf-8")


def _signature(contents: Mapping[str, Any], *, for_new: bool = False) -> str | None:
    """Return what only this user on this machine can say of a manifest; None if there is no secret for it.

    One is made for new results, if it can be kept.
    """
    signed = json.dumps([contents.get(name) for name in ("kind", "source", "files")], sort_keys=True)
    with suppress(OSError, InputError):
        secret = state_folder() / "manifests" / "secret"
        if for_new and not secret.exists():
            part = secret.with_name(f"{HIDDEN_PREFIX}-{os.urandom(6).hex()}.part")
            write_private(part, os.urandom(32))
            with suppress(FileExistsError):  # another run has made one by now
                os.link(part, secret)
            part.unlink()
        return hmac.digest(secret.read_bytes(), signed.encode(), "sha256").hex()
    return None


def earlier_results(folder: Path, kind: str) -> list[str]:
    """The manifest of a folder, and the files that it lists and that still have the size they were written with.

    Nothing where there is no manifest that this user wrote. Files behind links and outside the folder do not count.

    Raises:
        InputError: the folder holds results of another kind.
    """
    manifest, sizes = _read(folder), listed_sizes(folder)
    found, signature = manifest.get("kind"), _signature(manifest)
    if not sizes or signature is None or manifest.get("signature") != signature:
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
