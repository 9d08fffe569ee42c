"""The list of the results in a folder, `manifest.json`: no other file is ever replaced there."""

from __future__ import annotations

import json
import os
from pathlib import Path

from gaussian_trimmer._version import __version__
from gaussian_trimmer.errors import InputError

MANIFEST = "manifest.json"
_PROGRAM = "gaussian-trimmer"


def write_manifest(folder: Path, kind: str) -> None:
    """List the files of a folder with their sizes; `kind` is what wrote them."""
    sizes = {name: (folder / name).stat().st_size for name in files_in(folder)}
    contents = {"program": _PROGRAM, "version": __version__, "kind": kind, "files": sizes}
    (folder / MANIFEST).write_text(json.dumps(contents, indent=1) + "\n", encoding="utf-8")


def earlier_results(folder: Path, kind: str) -> list[str]:
    """The manifest of a folder, and the files that it lists and that still have the size they were written with.

    Nothing where there is no manifest of this program. Files behind links and outside the folder do not count.

    Raises:
        InputError: the folder holds results of another kind.
    """
    path = folder / MANIFEST
    if path.is_symlink() or not path.is_file():
        return []
    try:
        manifest = json.loads(path.read_bytes())
        program, found, sizes = manifest["program"], manifest["kind"], dict(manifest["files"])
    except (ValueError, RecursionError, LookupError, TypeError):
        return []
    if program != _PROGRAM:
        return []
    if found != kind:
        raise InputError(
            f"'{folder}' holds the results of '{found}', which '{kind}' does not replace; choose another folder."
        )
    unchanged = (name for name in files_in(folder) if name in sizes and _has_size(folder / name, sizes[name]))
    return [MANIFEST, *(name for name in unchanged if name != MANIFEST)]


def files_in(folder: Path) -> list[str]:
    """Paths of all files in a folder and below, relative to it, with slashes."""
    paths = (Path(place, name) for place, _, names in os.walk(folder) for name in names)
    return sorted(path.relative_to(folder).as_posix() for path in paths)


def _has_size(path: Path, size: object) -> bool:
    return not path.is_symlink() and path.stat().st_size == size
