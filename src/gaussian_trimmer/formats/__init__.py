"""Splat files: `read` and `write` pick the format by the file's name."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Gaussians

# Suffix -> module with read(path) -> Gaussians and write(gaussians, path) -> None. The longest suffix wins.
FORMATS = {
    ".ply": "gaussian_trimmer.formats.ply",
}


def format_suffix(path: Path) -> str:
    """The known suffix that a file's name ends with.

    Raises:
        InputError: the name ends with no known suffix.

    >>> format_suffix(Path("Scene.PLY"))
    '.ply'
    """
    name = path.name.lower()
    for suffix in sorted(FORMATS, key=len, reverse=True):
        if name.endswith(suffix):
            return suffix
    raise InputError(f"'{path.name}' is no known splat format; known endings: {', '.join(FORMATS)}.")


def _module(path: Path) -> ModuleType:
    return import_module(FORMATS[format_suffix(path)])


def read(path: Path) -> Gaussians:
    """The Gaussians of a splat file, rows in the file's own order.

    Raises:
        InputError: the file is missing, of no known format, damaged, or holds no Gaussians or non-finite values.
    """
    module = _module(path)
    if not path.is_file():
        raise InputError(f"There is no file '{path}'.")
    gaussians: Gaussians = module.read(path)
    return gaussians


def write(gaussians: Gaussians, path: Path) -> None:
    """Write a splat file in the format that its name asks for; the file appears whole or not at all."""
    _module(path).write(gaussians, path)
