"""The exchange of the files of a result for those of a new one, in a folder that stays.

All new files lie in the part, on the disk, before the first old one moves; the old ones move into the part, and go only
when all new ones are in place. A journal stands in the part from the first move to the last. Whatever stops the swap,
the journal is enough to undo it: the files that failed to come or go are told apart by where they are.
"""

from __future__ import annotations

import errno
import json
import os
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.atomic.files import sync_file, sync_folder
from gaussian_trimmer.io.atomic.locks import JOURNAL, empty
from gaussian_trimmer.io.atomic.manifest import MANIFEST, files_in, has_plain_parents, is_inside

NEW, OLD = "new", "old"
"""Folders in the part: results that have not come yet, and earlier ones that have gone."""


def swap(folder: Path, part: Path, going: list[str]) -> None:
    """Move the files `going` from the folder into the part, and those that wait in the part into the folder.

    Raises:
        InputError: another file is in the way of a new one; nothing has been moved then.
        OSError: a file could not be moved; those moved before are back in their places, as after any other exception.
    """
    coming = sorted(files_in(part / NEW), key=lambda name: name == MANIFEST)
    for name in coming:
        in_the_way(folder, name, going)
    _write_journal(folder, part, going, coming)
    try:
        for name in going:
            _move(folder / name, part / OLD / name)
        for name in coming:
            _move(part / NEW / name, folder / name)
        for place in {(folder / name).parent for name in (*going, *coming)}:
            sync_folder(place)
        (part / JOURNAL).unlink()
    except BaseException:
        undo(folder, part)
        raise
    with suppress(OSError):
        sync_folder(part)
    _remove_empty(folder, _folders_of(going))


def undo(folder: Path, part: Path) -> None:
    """Take back a swap that has begun, if there is one, and remove what else is in the part.

    Raises:
        InputError: a file cannot be moved back; all files are kept where they are, for the next run to try again.
    """
    try:
        if (part / JOURNAL).exists():
            _move_back(folder, part)
            (part / JOURNAL).unlink()
        empty(part)
    except OSError as error:
        raise InputError(
            f"Earlier results of '{folder}' cannot be moved back: {error.strerror or error}. They are in "
            f"'{part / OLD}'; the next run tries again when the cause is gone."
        ) from error


def in_the_way(folder: Path, name: str, ours: list[str]) -> None:
    """Refuse a name that something has which is not among the program's own files.

    Raises:
        InputError: the name is taken.
    """
    if not has_plain_parents(folder, name):
        raise InputError(
            f"'{folder / PurePosixPath(name).parent}' is a link or a file, where a folder is needed for the results; "
            "move it away, or choose another output folder."
        )
    if name not in ours and os.path.lexists(folder / name):
        raise InputError(
            f"'{folder / name}' is in the way of a result, and was not written by this program or has changed since; "
            "move it away, or choose another output folder."
        )


def _move_back(folder: Path, part: Path) -> None:
    """Have every file where it was before the swap.

    Of the files to come, those are in the folder that are no longer in the part; size and time tell whether it is
    still the same file. Of the files to go, those are in the part that have gone.
    """
    journal = _read_journal(folder, part)
    for name, stamp in journal["coming"].items():
        if not os.path.lexists(part / NEW / name) and _stamp(folder / name) == stamp:
            _move(folder / name, part / NEW / name)
    for name in journal["going"]:
        if os.path.lexists(part / OLD / name):
            if os.path.lexists(folder / name):
                raise FileExistsError(errno.EEXIST, f"there is another '{name}' now")
            _move(part / OLD / name, folder / name)
    _remove_empty(folder, journal["made"])
    for place in {(folder / name).parent for name in journal["going"]}:
        if place.is_dir():
            sync_folder(place)


def _write_journal(folder: Path, part: Path, going: list[str], coming: list[str]) -> None:
    stamps = {name: _stamp(part / NEW / name) for name in coming}
    made = [name for name in _folders_of(coming) if not (folder / name).exists()]
    draft = part / f"{JOURNAL}.draft"
    draft.write_text(json.dumps({"going": going, "coming": stamps, "made": made}), encoding="utf-8")
    sync_file(draft)
    draft.replace(part / JOURNAL)
    sync_folder(part)


def _read_journal(folder: Path, part: Path) -> dict[str, Any]:
    """The journal of a swap that has not ended.

    Raises:
        OSError: what is there is no journal, so that nothing can be said of the files beside it.
    """
    try:
        journal: dict[str, Any] = json.loads((part / JOURNAL).read_bytes())
        names = [*journal["going"], *journal["coming"], *journal["made"]]
    except (ValueError, RecursionError, LookupError, TypeError) as error:
        raise OSError(errno.EINVAL, f"'{part / JOURNAL}' is damaged") from error
    places = [(folder, ""), (part, f"{NEW}/"), (part, f"{OLD}/")]
    sound = isinstance(journal["coming"], dict) and all(map(is_inside, names))
    if not sound or not all(has_plain_parents(place, start + name) for place, start in places for name in names):
        raise OSError(errno.EINVAL, f"'{part / JOURNAL}' is damaged")
    return journal


def _stamp(path: Path) -> list[int] | None:
    """Size and time of a file, which stay when it is renamed; None if there is none."""
    try:
        found = path.lstat()
    except OSError:
        return None
    return [found.st_size, found.st_mtime_ns]


def _move(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    source.rename(target)


def _folders_of(names: list[str]) -> list[str]:
    """The folders that relative paths lie in, deepest first."""
    parents = {str(parent) for name in names for parent in PurePosixPath(name).parents} - {"."}
    return sorted(parents, key=lambda name: -name.count("/"))


def _remove_empty(folder: Path, names: list[str]) -> None:
    for name in names:
        with suppress(OSError):
            (folder / name).rmdir()
