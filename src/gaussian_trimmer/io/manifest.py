"""The list of the results in a folder, `manifest.json`: no other file is ever replaced there."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from gaussian_trimmer._version import __version__
from gaussian_trimmer.errors import InputError

MANIFEST = "manifest.json"
_PROGRAM = "gaussian-trimmer"
_MAX_MANIFEST_BYTES = 1 << 24


def write_manifest(folder: Path, kind: str) -> None:
    """List the files of a folder with their sizes; `kind` is what wrote them."""
    sizes = {name: (folder / name).stat().st_size for name in files_in(folder)}
    contents = {"program": _PROGRAM, "version": __version__, "kind": kind, "files": sizes}
    (folder / MANIFEST).write_text(json.dumps(contents, indent=1) + "\n", encoding="utf-8")


def read_manifest(path: Path) -> dict[str, Any] | None:
    """A manifest that this program can have written; None where there is none."""
    try:
        if path.resolve() != path or not path.is_file() or path.stat().st_size > _MAX_MANIFEST_BYTES:
            return None
        manifest = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        return None
    if not isinstance(manifest, dict) or manifest.get("program") != _PROGRAM:
        return None
    sound = isinstance(manifest.get("kind"), str) and isinstance(manifest.get("files"), dict)
    return manifest if sound else None


def earlier_results(folder: Path, kind: str) -> list[str]:
    """The manifest of a folder and the unchanged files that it lists; nothing where there is no manifest.

    Raises:
        InputError: the folder holds results of another kind.
    """
    manifest = read_manifest(folder / MANIFEST)
    if manifest is None:
        return []
    if manifest["kind"] != kind:
        raise InputError(
            f"'{folder}' holds the results of '{manifest['kind']}', which '{kind}' does not replace; choose another "
            "folder."
        )
    return [MANIFEST, *unchanged_files(folder, manifest)]


def unchanged_files(folder: Path, manifest: dict[str, Any]) -> list[str]:
    """The files of a manifest that lie in the folder, behind no link, and have the size they were written with."""
    return [name for name, size in manifest["files"].items() if name != MANIFEST and _has_size(folder, name, size)]


def files_in(folder: Path) -> list[str]:
    """Paths of all files in a folder and below, relative to it, with slashes."""
    if folder.is_symlink():
        return []
    paths = (Path(place, name) for place, _, names in os.walk(folder) for name in names)
    return sorted(path.relative_to(folder).as_posix() for path in paths)


def _has_size(folder: Path, name: str, size: object) -> bool:
    path = folder / name
    try:
        inside = path.relative_to(folder).as_posix() == name and path.resolve() == path
        return inside and path.is_file() and path.stat().st_size == size
    except (OSError, ValueError):
        return False
