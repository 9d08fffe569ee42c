"""The list of what the program has written to a folder: nothing else is ever replaced there."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path, PurePosixPath
from typing import Any

from gaussian_trimmer._version import __version__
from gaussian_trimmer.errors import InputError

MANIFEST = "manifest.json"
_PROGRAM = "gaussian-trimmer"
_MAX_BYTES = 1 << 24


def write_manifest(folder: Path, kind: str) -> None:
    """Write the list of a folder's files, with their sizes."""
    sizes = {name: (folder / name).stat().st_size for name in files_in(folder)}
    contents = {"program": _PROGRAM, "version": __version__, "kind": kind, "files": sizes}
    (folder / MANIFEST).write_text(json.dumps(contents, indent=1) + "\n", encoding="utf-8")


def earlier_files(folder: Path, kind: str) -> list[str]:
    """Paths in a folder, the manifest first, of the files that its manifest lists and that are as they were written.

    What is gone, or has another size, is no longer the program's. Nothing is where there is no manifest, or none that
    the program can have written.

    Raises:
        InputError: the folder holds results of another kind.
    """
    manifest = _read(folder / MANIFEST)
    if manifest is None:
        return []
    if manifest["kind"] != kind:
        raise InputError(
            f"'{folder}' holds the results of '{manifest['kind']}', which '{kind}' does not replace; choose another "
            "folder."
        )
    return [MANIFEST, *(name for name, size in manifest["files"].items() if _is_unchanged(folder, name, size))]


def files_in(folder: Path) -> list[str]:
    """Paths of all files in a folder and below, relative to it, with slashes."""
    paths = (Path(place, name) for place, _, names in os.walk(folder) for name in names)
    return sorted(path.relative_to(folder).as_posix() for path in paths)


def is_inside(name: object) -> bool:
    """Whether a relative path is plain: a folder from elsewhere must not name files outside itself.

    >>> [is_inside(name) for name in ("views/00.png", "../a", "/a", "a//b", "C:a", "")]
    [True, False, False, False, False, False]
    """
    if not isinstance(name, str) or not name or set(name) & set("\\:\0"):
        return False
    path = PurePosixPath(name)
    return not path.is_absolute() and ".." not in path.parts and path.as_posix() == name != "."


def has_plain_parents(folder: Path, name: str) -> bool:
    """Whether the folders between a folder and a file in it are folders, not links or files."""
    between = [folder / parent for parent in PurePosixPath(name).parents][:-1]
    return all(place.is_dir() and not place.is_symlink() for place in between if os.path.lexists(place))


def _read(path: Path) -> dict[str, Any] | None:
    """A manifest that is sound; None if there is none."""
    try:
        if path.is_symlink() or not path.is_file() or path.stat().st_size > _MAX_BYTES:
            return None
        manifest = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        return None
    if not isinstance(manifest, dict) or manifest.get("program") != _PROGRAM:
        return None
    kind, files = manifest.get("kind"), manifest.get("files")
    if not isinstance(kind, str) or not isinstance(files, dict):
        return None
    sound = all(is_inside(name) and isinstance(size, int) for name, size in files.items())
    return manifest if sound and MANIFEST not in files else None


def _is_unchanged(folder: Path, name: str, size: int) -> bool:
    if not has_plain_parents(folder, name):
        return False
    try:
        found = (folder / name).lstat()
    except OSError:
        return False
    return stat.S_ISREG(found.st_mode) and found.st_size == size
