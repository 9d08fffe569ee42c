"""Splat files: `read` and `write` pick the format by the file's name, and PLY's two kinds by the header."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import (
    FORMATS,
    READ_ONLY,
    STREAMED,
    format_suffix,
    identify,
    is_named,
    written_suffix,
)
from gaussian_trimmer.gaussians import Gaussians, IntArray, check_gaussians, concatenate
from gaussian_trimmer.geometry.limits import check_values
from gaussian_trimmer.io.reading import is_file, reading

__all__ = [
    "FORMATS",
    "READ_ONLY",
    "convert",
    "format_suffix",
    "is_named",
    "read",
    "target_suffix",
    "write",
    "written_suffix",
]

_HOLD_NOTHING = (".ply", ".splat")
"""Formats that can hold zero Gaussians."""
_EXACT = (".ply", ".glb")
"""Formats that round nothing."""


@np.errstate(over="ignore", invalid="ignore")  # what damaged numbers become is found by the check of values
def read(
    path: str | Path,
    *,
    level: int | None = None,
    bounds: Sequence[Sequence[float]] | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Gaussians:
    """Return the Gaussians of a splat file, rows in the file's own order; of a training's folder, the latest ones.

    Args:
        path: the file or folder.
        level: of a streamed SOG, the level of detail, of which 0 is the finest; by default the finest that memory
            allows to work on.
        bounds: of a streamed SOG, least and greatest corner of a box: only leaves that touch it are read.
        say: called with sentences on what is read of a folder or of a streamed SOG, and what is not.

    Raises:
        InputError: the file is missing, of no known format, damaged, or changes while it is read, or it holds no
            Gaussians, or values that are not finite or extreme, or no such level.
    """
    given, path = Path(path), identify(path).scene
    suffix = format_suffix(path)
    if not is_file(path):
        raise InputError(f"There is no file '{path}'.")
    if suffix == STREAMED:
        choice: dict[str, Any] = {"level": level, "bounds": bounds, "say": say}
    elif level is not None or bounds is not None:
        raise InputError(f"'{path}' has no levels of detail and no leaves; only a {STREAMED} is read in part.")
    else:
        choice = {}
        if given != path:
            say(f"{given}: reading {path}")
    with reading(path):
        module = _module(".compressed.ply" if suffix == ".ply" else suffix)  # which reads both kinds
        gaussians: Gaussians = module.read(path, **choice)
        check_values(gaussians, f"'{path}': ")
    return gaussians


def scene_files(path: Path, level: int | None = None) -> list[Path]:
    """Return all files that the Gaussians of a splat file are read from: itself, and textures or chunks.

    Raises:
        InputError: one of them is missing, or the file that lists them is damaged.
    """
    suffix = format_suffix(path)
    return _module(suffix).scene_files(path, level) if suffix in (STREAMED, "meta.json") else [path]


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
    check_gaussians(gaussians)
    suffix = target_suffix(path)
    if len(gaussians) == 0 and suffix not in _HOLD_NOTHING:
        raise InputError(f"Cannot write '{path}': a {suffix} file cannot hold zero Gaussians.")
    _module(suffix).write(gaussians, Path(path), **options)


def losses(gaussians: Gaussians, target: str, source: str) -> str:
    """Return in a sentence what a format does not keep of Gaussians; nothing where it keeps all.

    Args:
        gaussians: as they were read.
        target: suffix of the format that is written.
        source: suffix of the format that they were read from; what that has rounded already stays as it is.
    """
    lost = list[str]()
    if gaussians.sh_degree and target == ".splat":
        lost.append("view-dependent colour")
    if gaussians.extras:
        lost.append(f"{len(gaussians.extras)} extra columns")
    if target not in (*_EXACT, source):
        lost.append("precision")
    return f"Lost in {target}: {', '.join(lost)}." if lost else ""


def write_selected(gaussians: Gaussians, rows: IntArray, appended: Gaussians, path: str | Path) -> None:
    """Write some rows of a scene, (R,), and then other Gaussians, without extra columns; otherwise as `write`.

    A PLY is written piece by piece, since a background is nearly as large as its scene.

    Raises:
        InputError: as for `write`.
    """
    module = _module(target_suffix(path))
    if hasattr(module, "write_selected"):
        module.write_selected(gaussians, rows, appended, Path(path))
    else:
        write(concatenate([gaussians.select(rows), appended]), path)


def convert(source: str | Path, target: str | Path, *, sort: bool = False) -> Gaussians:
    """Read one splat file and write another; return what was written, before the target's format rounded it.

    With `sort`, rows are written in Morton order instead of the source's, which makes compressed files smaller and
    a compressed PLY far more precise; selections of the source then do not fit the target.

    Raises:
        InputError: the source cannot be read or the target cannot be written.
    """
    target_suffix(target)  # a wrong name is found before the work
    gaussians = read(source)
    if sort:
        from gaussian_trimmer.formats.packing import morton_order

        gaussians = gaussians.select(morton_order(gaussians.means))
    write(gaussians, target)
    return gaussians


def _module(suffix: str) -> Any:
    return import_module(f"gaussian_trimmer.formats.{(FORMATS | READ_ONLY)[suffix]}")


def target_suffix(path: str | Path) -> str:
    """Return the suffix of a file that can be written.

    Raises:
        InputError: no format has that name, or it can only be read.
    """
    suffix = max((suffix for suffix in FORMATS if is_named(Path(path).name, suffix)), key=len, default=None)
    if suffix is None:
        raise InputError(f"'{Path(path).name}' cannot be written: give it one of the endings {', '.join(FORMATS)}.")
    return suffix
