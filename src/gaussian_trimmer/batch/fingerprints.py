"""Whether an item must be trimmed again: a digest of the contents of all its inputs, and of its settings.

Names and times of files do not count, so that a copy elsewhere is the same; the version of the program does.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer._version import __version__
from gaussian_trimmer.batch.items import Item
from gaussian_trimmer.cameras import CameraSet, Viewpoint
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.io.reading import is_file, is_folder
from gaussian_trimmer.masks import options_kind
from gaussian_trimmer.selecting.marks import read_marks
from gaussian_trimmer.settings import to_plain


def fingerprint(
    item: Item, scene: Sequence[Path], cameras: CameraSet | None, digest_of: Callable[[Path], str] | None = None
) -> str:
    """Return the digest of an item.

    Args:
        item: the item, whose selection, marks, classifier, masks and models are read.
        scene: the files of its scene.
        cameras: its cameras.
        digest_of: gives the digest of what lies at a path, in place of `digest_of_contents`.

    Raises:
        InputError: an input cannot be read.
    """
    digest_of = digest_of or digest_of_contents
    kind, options = options_kind(item.segmenter), item.segmenter_options
    if options is None and kind is not None:
        options = kind()
    writers: dict[type, Callable[[Any], Any]] = {
        Path: digest_of,
        str: lambda text: digest_of(Path(text)) if _exists(text) else text,
    }
    settings = {
        "version": __version__,
        "scene": [digest_of(path) for path in scene],
        "level": item.level,
        "selection": None if item.selection is None else _selection(Path(item.selection), digest_of),
        "cameras": None if cameras is None else _cameras(cameras),
        "format": item.suffix,
        "background": item.background,
        "html": item.html,
        "placing": to_plain(item.placing),
        "config": to_plain(item.config),
        "segmenter": item.segmenter,
        "segmenter_options": to_plain(options, writers),
        "selection_options": to_plain(item.selection_options, writers),
    }
    text = json.dumps(settings, sort_keys=True, allow_nan=False, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def digest_of_contents(place: Path) -> str:
    """Return the SHA-256 of a file, of all files in a folder, or of all that a pattern with * matches.

    Raises:
        InputError: there is no such file.
    """
    if is_folder(place):
        files = sorted(path for path in place.rglob("*") if path.is_file())
    elif "*" in str(place):
        files = sorted(Path(place.anchor).glob(str(place.relative_to(place.anchor))))
    else:
        files = [place]
    total = hashlib.sha256()
    for path in files:
        if not is_file(path):  # A device or a pipe may never end.
            raise InputError(f"There is no file '{path}'.")
        with path.open("rb") as file:
            total.update(hashlib.file_digest(file, "sha256").digest())
        total.update(path.relative_to(place).as_posix().encode() if is_folder(place) else b"")
    return total.hexdigest()


def _selection(path: Path, digest_of: Callable[[Path], str]) -> list[object]:
    """Return digests of a selection, of the marks beside it, and of the files that marks name."""
    beside = path.with_suffix(".json")
    found: list[object] = [
        digest_of(path),
        digest_of(beside) if beside != path and identify(beside).kind == "marks" else None,
    ]
    if identify(path).kind == "marks":
        marks = read_marks(path)
        named = [mark.path for mark in marks.marks if hasattr(mark, "path")]
        found += [_selection(file, digest_of) for file in named]
        found.append(to_plain(marks.marks, {Path: digest_of, Viewpoint: lambda view: None}))
    return found


def _cameras(cameras: CameraSet) -> str:
    """Return the SHA-256 of all that cameras say, whichever kind of file they came from."""
    total = hashlib.sha256()
    for camera, train in zip(cameras.cameras, cameras.train, strict=True):
        total.update(f"{camera.name!r} {camera.width} {camera.height} {camera.near!r} {train}".encode())
        for matrix in (camera.world_to_camera, camera.K):
            total.update(np.ascontiguousarray(matrix, np.float64).tobytes())
    total.update(repr(None if cameras.up is None else np.asarray(cameras.up, np.float64).tolist()).encode())
    total.update(str(cameras.distorted).encode())
    return total.hexdigest()


def _exists(text: str) -> bool:
    """Return whether a text is a path, as that of a model may be."""
    return ("/" in text or "." in text) and (is_file(Path(text)) or is_folder(Path(text)))
