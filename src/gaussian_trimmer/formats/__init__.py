"""Splat files: `read` and `write` pick the format by the file's name, and PLY's two kinds by the header."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

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
from gaussian_trimmer.formats.packing import SMALLEST_SCALE
from gaussian_trimmer.gaussians import Gaussians, IntArray, check_gaussians, concatenate, logit
from gaussian_trimmer.geometry.limits import blank_unusable, lost_places
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
FILTER = "filter_3D"
"""Column of Mip-Splatting's files: the width of each Gaussian's smoothing filter, which its program adds on drawing."""
_WITHOUT_MODEL = {"antialiased": (".splat", ".glb"), "2dgs": (".splat", ".glb", ".spz")}
"""Formats that cannot say what Gaussians were trained as."""
_EXACT = (".ply", ".glb")
"""Formats that round nothing."""
Values = Literal["stored", "activated"]
"""What scales and opacities of a file are: logarithms and logits, as stored in training, or what these stand for."""
_FEW = 16
"""So many Gaussians may have any values by chance."""
_LOG = logging.getLogger("gaussian_trimmer")


@np.errstate(over="ignore", invalid="ignore")  # what damaged numbers become is found by the check of values
def read(
    path: str | Path,
    *,
    level: int | None = None,
    bounds: Sequence[Sequence[float]] | None = None,
    values: Values | None = None,
    say: Callable[[str], None] | None = None,
) -> Gaussians:
    """Return the Gaussians of a splat file, rows in the file's own order; of a training's folder, the latest ones.

    Args:
        path: the file or folder.
        level: of a streamed SOG, the level of detail, of which 0 is the finest; by default the finest that memory
            allows to work on.
        bounds: of a streamed SOG, least and greatest corner of a box: only leaves that touch it are read.
        values: what scales and opacities of the file are; by default stored ones, and those that look like activated
            ones are refused.
        say: called with sentences on what is read of a folder or of a streamed SOG, and on what is not read or changed,
            which is a warning in the log otherwise.

    Raises:
        InputError: the file is missing, of no known format, damaged, or changes while it is read, or it holds no
            Gaussians whose values can be used, or no such level.
    """
    given, path = Path(path), identify(path).scene
    suffix = format_suffix(path)
    if not is_file(path):
        raise InputError(f"There is no file '{path}'.")
    if suffix == STREAMED:
        choice: dict[str, Any] = {"level": level, "bounds": bounds, "say": say or _say_nothing}
    elif level is not None or bounds is not None:
        raise InputError(f"'{path}' has no levels of detail and no leaves; only a {STREAMED} is read in part.")
    else:
        choice = {}
        if given != path:
            (say or _say_nothing)(f"{given}: reading {path}")
    with reading(path):
        module = _module(".compressed.ply" if suffix == ".ply" else suffix)  # which reads both kinds
        gaussians: Gaussians = module.read(path, **choice)
        if values == "activated":
            gaussians = _stored(gaussians)
        gaussians = blank_unusable(_with_fused_filter(gaussians), f"'{path}': ")
        if values is None and _seem_activated(gaussians):
            raise InputError(
                f"All scales in '{path}' are above 0 and all opacities from 0 to 1, as if they were no logarithms and "
                "logits; have these written: 'gaussian-trimmer convert SOURCE TARGET --values activated', or, if they "
                "are logarithms and logits, '--values stored'."
            )
    for note in gaussians.notes:
        (say or _LOG.warning)(f"{path}: {note}.")
    return gaussians


def _say_nothing(text: str) -> None:
    pass


def _stored(gaussians: Gaussians) -> Gaussians:
    """Return Gaussians whose scales and opacities are logarithms and logits of what they were."""
    scales = np.where(gaussians.log_scales > 0, gaussians.log_scales, np.float32(SMALLEST_SCALE))
    opacities = gaussians.opacity_logits.astype(np.float64)
    return gaussians.replace(log_scales=np.log(scales), opacity_logits=logit(opacities).astype(np.float32))


def _with_fused_filter(gaussians: Gaussians) -> Gaussians:
    """Return Gaussians of Mip-Splatting with the widths of its smoothing filter in scales and opacities."""
    if FILTER not in gaussians.extras:
        return gaussians
    extras = dict(gaussians.extras)
    with np.errstate(divide="ignore"):  # a width of zero changes nothing
        log_widths = np.log(np.abs(np.asarray(extras.pop(FILTER), np.float64)))
    log_scales = np.logaddexp(2 * gaussians.log_scales.astype(np.float64), 2 * log_widths[:, None]) / 2
    kept = np.exp(np.sum(gaussians.log_scales - log_scales, axis=1))
    return gaussians.replace(
        log_scales=log_scales.astype(np.float32),
        opacity_logits=logit(gaussians.opacities * kept).astype(np.float32),
        extras=extras,
        notes=(*gaussians.notes, f"{FILTER} of Mip-Splatting is fused into scales and opacities"),
    )


def _seem_activated(gaussians: Gaussians) -> bool:
    """Say whether scales look like lengths, and opacities like numbers from 0 to 1."""
    opacities = gaussians.opacity_logits[~gaussians.blank]
    within = len(opacities) > _FEW and 0 <= opacities.min() < opacities.max() <= 1
    return bool(within and (gaussians.log_scales > 0).all())


def scene_files(path: Path, level: int | None = None) -> list[Path]:
    """Return all files that the Gaussians of a splat file are read from: itself, and textures or chunks.

    Raises:
        InputError: one of them is missing, or the file that lists them is damaged.
    """
    suffix = format_suffix(path)
    return _module(suffix).scene_files(path, level) if suffix in (STREAMED, "meta.json", ".gltf") else [path]


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
    if target in _WITHOUT_MODEL.get(gaussians.model, ()):
        lost.append(f"that the Gaussians are {gaussians.model}")
    if gaussians.extras:
        lost.append(f"{len(gaussians.extras)} extra columns")
    if target not in (*_EXACT, source):
        lost.append("precision")
    kept = f"Lost in {target}: {', '.join(lost)}." if lost else ""
    far = lost_places(gaussians)
    return " ".join(filter(None, [kept, f"Coordinates have lost digits: {far}." if far else ""]))


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

    Rows that cannot be used are left out.

    With `sort`, rows are written in Morton order instead of the source's, which makes compressed files smaller and
    a compressed PLY far more precise; selections of the source then do not fit the target.

    Raises:
        InputError: the source cannot be read or the target cannot be written.
    """
    target_suffix(target)  # a wrong name is found before the work
    gaussians = without_blank(read(source))
    if sort:
        from gaussian_trimmer.formats.packing import morton_order

        gaussians = gaussians.select(morton_order(gaussians.means))
    write(gaussians, target)
    return gaussians


def without_blank(gaussians: Gaussians) -> Gaussians:
    """Return the Gaussians without the rows that stand for those of a file that cannot be used."""
    blank = gaussians.blank
    return gaussians.select(~blank) if blank.any() else gaussians


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
