"""The list of the results in a folder, `manifest.json`: no other file is ever replaced there."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from gaussian_trimmer._version import __version__
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.reading import is_file, read_json

MANIFEST = "manifest.json"
_PROGRAM = "gaussian-trimmer"


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
