"""Splat files: `read` and `write` pick the format by the file's name, and PLY's two kinds by the header."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Gaussians, IntArray, concatenate
from gaussian_trimmer.io.reading import is_file, is_folder, reading


@dataclass(frozen=True)
class Format:
    """A format of splat files."""

    module: str
    """Module with `read(path) -> Gaussians`, where it can be written `write(gaussians, path) -> None`, which takes zero
    Gaussians or raises InputError, and perhaps `write_selected` as below."""
    loses: str = ""
    """What Gaussians lose in it, in words; see docs/formats.md."""


# The longest suffix wins.
FORMATS = {
    ".ply": Format("gaussian_trimmer.formats.ply"),
    ".compressed.ply": Format(
        "gaussian_trimmer.formats.compressed_ply",
        "rounds centres and scales to 11 bits over the range of each 256 rows (less with --sort), all else to 8 or 10",
    ),
    ".splat": Format(
        "gaussian_trimmer.formats.splat",
        "loses view-dependent colours; rounds rotations, colours and opacities to 8 bits",
    ),
    ".spz": Format(
        "gaussian_trimmer.formats.spz",
        "rounds centres to 24 bits, rotations to 10, all else to 8; cuts off scales beyond e^-10 and e^5.94",
    ),
    ".sog": Format(
        "gaussian_trimmer.formats.sog",
        "rounds centres to 16 bits, scales and colours to 256 values, view-dependent colours to 65,536 sets",
    ),
    ".ksplat": Format(
        "gaussian_trimmer.formats.ksplat",
        "loses spherical harmonics of degree 3; rounds colours and opacities to 8 bits",
    ),
    ".glb": Format("gaussian_trimmer.formats.glb"),
}
READ_ONLY = {
    "meta.json": Format("gaussian_trimmer.formats.sog"),
    ".ckpt": Format("gaussian_trimmer.formats.nerfstudio"),
}
"""Formats, by the ends of names, that can be read but not written."""
_WRITTEN_INSTEAD = {"meta.json": ".sog", ".ckpt": ".ply"}
_ENDINGS_OF_SELECTIONS = (".npy", ".npz", ".pt", ".pth", ".txt", ".csv", ".json")


def format_suffix(path: str | Path) -> str:
    """The known suffix that a file's name ends with, of a format that can be read.

    Raises:
        InputError: the name ends with no known suffix.

    >>> format_suffix("Scene.PLY")
    '.ply'
    """
    name = Path(path).name
    for suffix in sorted(FORMATS | READ_ONLY, key=len, reverse=True):
        if is_named(name, suffix):
            return suffix
    hint = " A selection is given after its scene." if name.lower().endswith(_ENDINGS_OF_SELECTIONS) else ""
    raise InputError(f"'{name}' is of no known splat format; known endings: {', '.join(FORMATS | READ_ONLY)}.{hint}")


def is_named(name: str, suffix: str) -> bool:
    """Whether a file's name ends with a suffix, or is equal to one that does not begin with a dot.

    >>> is_named("a.SOG", ".sog"), is_named("Meta.json", "meta.json"), is_named("lod-meta.json", "meta.json")
    (True, True, False)
    """
    return name.lower().endswith(suffix) if suffix.startswith(".") else name.lower() == suffix


def has_splats(path: Path) -> bool:
    """Whether a file is, by its name, one of splats."""
    return any(is_named(path.name, suffix) for suffix in FORMATS | READ_ONLY)


def written_suffix(path: str | Path) -> str:
    """The suffix in which results of a scene file are written: its own, or the nearest that can be.

    Raises:
        InputError: the name ends with no known suffix.

    >>> written_suffix("a.spz"), written_suffix("step-000029999.ckpt")
    ('.spz', '.ply')
    """
    suffix = format_suffix(path)
    return _WRITTEN_INSTEAD.get(suffix, suffix)


def find_scene(path: Path) -> Path:
    """The splat file that a path means: itself, or in the folder of a training that of the latest iteration.

    Raises:
        InputError: the folder holds no splat file, or several that could be meant.
    """
    if not is_folder(path):
        return path
    from gaussian_trimmer.formats.training_folders import latest_splats

    return latest_splats(path)


@np.errstate(over="ignore", invalid="ignore")  # what damaged numbers become is found by each reader's check
def read(path: str | Path) -> Gaussians:
    """The Gaussians of a splat file, rows in the file's own order; of a training's folder, see `find_scene`.

    Raises:
        InputError: the file is missing, of no known format, damaged, or changes while it is read, or it holds no
            Gaussians, or values that are not finite or extreme.
    """
    path = find_scene(Path(path))
    suffix = format_suffix(path)
    if not is_file(path):
        raise InputError(f"There is no file '{path}'.")
    with reading(path):
        if suffix.endswith(".ply"):
            suffix = _kind_of_ply(path)
        gaussians: Gaussians = _module(suffix).read(path)
    return gaussians


def write(gaussians: Gaussians, path: str | Path, **options: Any) -> None:
    """Write a splat file in the format that its name asks for; the file appears whole or not at all.

    What the format cannot hold is left out or rounded, as docs/formats.md states; rows keep their order.

    Args:
        gaussians: what to write.
        path: where.
        options: passed on to the format's own `write`: `extras` of .ply, `version` of .spz.

    Raises:
        InputError: no format has that name, the file cannot be written, or the format cannot hold the Gaussians.
    """
    _writable(path).write(gaussians, Path(path), **options)


def write_selected(gaussians: Gaussians, rows: IntArray, appended: Gaussians, path: str | Path) -> None:
    """Write some rows of a scene, (R,), and then other Gaussians, without extra columns; otherwise as `write`.

    Formats that can be written piece by piece are, since a background is nearly as large as its scene.

    Raises:
        InputError: as for `write`.
    """
    module = _writable(path)
    if hasattr(module, "write_selected"):
        module.write_selected(gaussians, rows, appended, Path(path))
    else:
        module.write(concatenate([gaussians.select(rows), appended]), Path(path))


def convert(source: str | Path, target: str | Path, *, sort: bool = False, **options: Any) -> Gaussians:
    """Read one splat file and write another; returns what was written, before the target's format rounded it.

    With `sort`, rows are written in Morton order instead of the source's, which makes compressed files smaller and
    a compressed PLY far more precise; selections of the source then do not fit the target. Options are those of
    `write`.

    Raises:
        InputError: the source cannot be read or the target cannot be written.
    """
    _writable(target)  # a wrong name is found before the work
    gaussians = read(source)
    if sort:
        from gaussian_trimmer.formats.morton import morton_order

        gaussians = gaussians.select(morton_order(gaussians.means))
    write(gaussians, target, **options)
    return gaussians


def _module(suffix: str) -> ModuleType:
    return import_module((FORMATS | READ_ONLY)[suffix].module)


def _writable(path: str | Path) -> ModuleType:
    """The module that writes a file of this name.

    Raises:
        InputError: no format has that name, or it can only be read.
    """
    if has_splats(Path(path)) and (suffix := format_suffix(path)) in FORMATS:
        return _module(suffix)
    raise InputError(f"'{Path(path).name}' cannot be written: give it one of the endings {', '.join(FORMATS)}.")


def _kind_of_ply(path: Path) -> str:
    """The suffix that a PLY's header asks for: compressed files are met under plain names too, and the reverse."""
    from gaussian_trimmer.formats.compressed_ply import is_compressed
    from gaussian_trimmer.formats.ply_table import read_header

    return ".compressed.ply" if is_compressed(read_header(path)) else ".ply"
