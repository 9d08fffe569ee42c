"""`selection.json`: the marks that made a selection, with the views that their pixels refer to."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer._version import __version__
from gaussian_trimmer.camera_files.frames import make_lens, rigid_transforms
from gaussian_trimmer.cameras import Camera, unit_up
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.dataclass_json import from_plain, to_plain, wrong_value
from gaussian_trimmer.io.reading import file_bytes, is_file, reading
from gaussian_trimmer.io.writing import atomic_file
from gaussian_trimmer.selecting.marks import KINDS, Mark, Marks, Point, View, Viewpoint

CONTENT = "selection marks"
_MAX_BYTES = 1 << 24
_Row = tuple[float, float, float, float]


@dataclass(frozen=True)
class _Ball:
    centre: Point
    radius: float


@dataclass(frozen=True)
class _SavedView:
    """A view as the file has it."""

    width: int
    height: int
    K: tuple[Point, Point, Point]
    world_to_camera: tuple[_Row, _Row, _Row, _Row]
    near: float
    name: str = ""
    drawn: _Ball | None = None


@dataclass(frozen=True)
class _Document:
    content: str
    up: Point
    marks: tuple[Any, ...]
    """Each is an object with the mark's kind as `mark`, and its fields; a view is the number of one of `views`."""
    views: tuple[_SavedView, ...] = ()
    photographed_from: tuple[Point, ...] = ()
    scene_size: int | None = None
    cameras: Path | None = None
    version: str = __version__
    selection: Any = None
    """What else is noted of the selection that the marks made."""


def write_marks(marks: Marks, path: Path) -> None:
    """Write marks as JSON.

    Raises:
        InputError: a view is not given as a `Viewpoint`, or the file cannot be written.
    """
    write_json(marks_as_json(marks, path.parent), path)


def write_json(document: dict[str, Any], path: Path) -> None:
    """Write what `marks_as_json` gave, perhaps with more in it.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic_file(path) as part:
        part.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def read_marks(path: str | Path) -> Marks:
    """The marks in a file that `write_marks` wrote. Paths in it are relative to its folder.

    Raises:
        InputError: the file cannot be read, holds no marks, or one of them is not possible.
    """
    path = Path(path)
    where, raw = f"'{path}': ", read_json(path)
    if not isinstance(raw, dict) or raw.get("content") != CONTENT:
        raise InputError(f"'{path}' holds no marks; give the .json that 'gaussian-trimmer select' wrote.")
    readers: dict[Any, Any] = {Path: lambda data, place: path.parent / from_plain(data, Path, place)}
    document: _Document = from_plain(raw, _Document, where, readers)
    unit_up(document.up, f"{where}the up vector")
    views = [_view(view, f"{where}views[{i}]") for i, view in enumerate(document.views)]
    readers[View] = partial(_numbered_view, views)
    marks = tuple(_mark(entry, f"{where}marks[{i}]", readers) for i, entry in enumerate(document.marks))
    return Marks(marks, document.up, document.photographed_from, document.scene_size, document.cameras)


def read_json(path: Path) -> Any:
    """What a JSON file holds.

    Raises:
        InputError: there is no file, or it cannot be read as JSON.
    """
    if not is_file(path):
        raise InputError(f"There is no file '{path}'.")
    with reading(path):
        data = file_bytes(path, _MAX_BYTES)
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise InputError(f"'{path}' cannot be read as JSON; select again.") from error


def is_marks_file(path: Path) -> bool:
    """Whether a JSON file holds marks, as far as its beginning tells; other files have other beginnings."""
    if path.suffix.lower() != ".json" or not is_file(path):
        return False
    with path.open("rb") as file:
        return f'"content": "{CONTENT}"'.encode() in file.read(256)


def marks_as_json(marks: Marks, folder: Path) -> dict[str, Any]:
    """Marks as JSON holds them; paths become relative to a folder where that is possible."""
    views: list[Viewpoint] = []

    def number_of(view: Viewpoint) -> int:
        if not any(view is known for known in views):
            views.append(view)
        return next(i for i, known in enumerate(views) if known is view)

    writers: dict[type, Any] = {Path: lambda path: relative_to(path, folder), Viewpoint: number_of}
    entries = tuple(_entry(mark, writers) for mark in marks.marks)
    saved = tuple(map(_saved_view, views))
    document = _Document(CONTENT, marks.up, entries, saved, marks.photographed_from, marks.scene_size, marks.cameras)
    return to_plain(document, {Path: writers[Path]})  # type: ignore[no-any-return]


def relative_to(path: Path, folder: Path) -> str:
    """A path as seen from a folder, with slashes, or an absolute one where the folder is no parent of it."""
    whole, base = path.absolute(), folder.absolute()
    return whole.relative_to(base).as_posix() if whole.is_relative_to(base) else whole.as_posix()


def _entry(mark: Mark, writers: dict[type, Any]) -> dict[str, Any]:
    kind = next(name for name, known in KINDS.items() if isinstance(mark, known))
    view = getattr(mark, "view", None)
    if view is not None and not isinstance(view, Viewpoint):
        raise InputError(f"The view of a {kind} is {view!r}; save the marks that `select` returned.")
    return {"mark": kind, **to_plain(mark, writers)}


def _saved_view(view: Viewpoint) -> _SavedView:
    camera = view.camera
    drawn = None if view.drawn_centre is None else _Ball(view.drawn_centre, view.drawn_radius)
    return _SavedView(
        camera.width, camera.height, camera.K.tolist(), camera.world_to_camera.tolist(), camera.near, camera.name, drawn
    )


def _mark(entry: Any, where: str, readers: dict[Any, Any]) -> Any:
    if not isinstance(entry, dict) or not isinstance(entry.get("mark"), str) or entry["mark"] not in KINDS:
        raise InputError(f"{where} is of no known kind; available: {', '.join(KINDS)}.")
    given = {name: value for name, value in entry.items() if name != "mark"}
    return from_plain(given, KINDS[entry["mark"]], where, readers)


def _numbered_view(views: list[Viewpoint], number: Any, where: str) -> Viewpoint:
    chosen: int = from_plain(number, int, where)
    if chosen not in range(len(views)):
        raise wrong_value(number, where, f"the number of one of the file's {len(views)} views")
    return views[chosen]


def _view(saved: _SavedView, where: str) -> Viewpoint:
    K, pose = np.array(saved.K), np.array(saved.world_to_camera)
    lens = make_lens((K[0, 0], K[1, 1], K[0, 2], K[1, 2]), saved.width, saved.height, False, where)
    rigid_transforms([pose], lambda _: where)
    if not saved.near > 0:
        raise wrong_value(saved.near, f"{where}.near", "above zero")
    # The numbers are taken as they are, so that the view is the same to the last bit.
    camera = Camera(pose, K, lens.width, lens.height, saved.name, saved.near)
    return Viewpoint(camera) if saved.drawn is None else Viewpoint(camera, saved.drawn.centre, saved.drawn.radius)
