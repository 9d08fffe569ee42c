"""Whether an item must be trimmed again: a digest of the contents of its inputs and of its settings.

Names and times of files do not count, so that a copy elsewhere is the same; the version of the program does.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer._version import __version__
from gaussian_trimmer.batch.items import Item
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.reading import is_file, is_folder
from gaussian_trimmer.segmentation.segmenters import options_kind
from gaussian_trimmer.settings import to_plain


def fingerprint(item: Item, scene: str, selection: str | None, cameras: str | None) -> str:
    """The digest of an item.

    Args:
        item: the item, whose other inputs (a classifier, masks, a model's folder) are read.
        scene, selection, cameras: digests of these; None where there is none.

    Raises:
        InputError: another input cannot be read.
    """
    options = item.segmenter_options
    kind = options_kind(item.segmenter)
    if options is None and kind is not None:
        options = kind()
    settings = {
        "version": __version__,
        "scene": scene,
        "level": item.level,
        "selection": selection,
        "cameras": cameras,
        "format": item.suffix,
        "background": item.background,
        "config": to_plain(item.config),
        "renderer": item.renderer,
        "segmenter": item.segmenter,
        "segmenter_options": _with_contents(options) if options is not None else None,
        "selection_options": _with_contents(item.selection_options),
    }
    text = json.dumps(settings, sort_keys=True, allow_nan=False, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def digest_of_file(path: Path) -> str:
    """The SHA-256 of a file's contents.

    Raises:
        InputError: there is no such file.
    """
    if not is_file(path):  # A device or a pipe may never end.
        raise InputError(f"There is no file '{path}'.")
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digest_of_cameras(cameras: CameraSet) -> str:
    """The SHA-256 of all that a set of cameras says, whichever kind of file it came from."""
    total = hashlib.sha256()
    for camera, train in zip(cameras.cameras, cameras.train, strict=True):
        total.update(f"{camera.name!r} {camera.width} {camera.height} {camera.near!r} {train}".encode())
        for matrix in (camera.world_to_camera, camera.K):
            total.update(np.ascontiguousarray(matrix, np.float64).tobytes())
    total.update(repr(None if cameras.up is None else np.asarray(cameras.up, np.float64).tolist()).encode())
    total.update(str(cameras.distorted).encode())
    return total.hexdigest()


def _with_contents(options: Any) -> dict[str, Any]:
    """Options, with digests in place of the files and folders that they name."""
    return {name: _contents(value) if _is_place(value) else value for name, value in vars(options).items()}


def _is_place(value: Any) -> bool:
    return isinstance(value, Path) or (isinstance(value, str) and is_folder(Path(value)))


def _contents(place: Path | str) -> str:
    place = Path(place)
    if not place.is_dir():
        return digest_of_file(place)
    total = hashlib.sha256()
    for path in sorted(path for path in place.rglob("*") if path.is_file()):
        total.update(f"{path.relative_to(place).as_posix()!r} {digest_of_file(path)}".encode())
    return total.hexdigest()
