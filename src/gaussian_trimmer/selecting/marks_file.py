"""`selection.json`: the marks that made a selection, with the views that their pixels refer to."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer._version import __version__
from gaussian_trimmer.camera_files.frames import make_lens, rigid_transforms
from gaussian_trimmer.cameras import Camera, Point, Viewpoint, unit_up
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import MARKS
from gaussian_trimmer.io.reading import read_json
from gaussian_trimmer.io.writing import write_json
from gaussian_trimmer.selecting.marks import KINDS, Mark, Marks, View
from gaussian_trimmer.settings import from_plain, to_plain, wrong_value

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


def write_marks(marks: Marks, path: Path) -> None:
    """Write marks as JSON.

    Raises:
        InputError: the file cannot be written.
    """
    write_json(marks_as_json(marks, path.parent), path)


def marks_as_json(marks: Marks, folder: Path) -> dict[str, Any]:
    """Turn marks whose views are resolved into JSON; paths become relative to a folder where that is possible."""
    views: list[Viewpoint] = []

    def number_of(view: Viewpoint) -> int:
        if not any(view is known for known in views):
            views.append(view)
        return next(i for i, known in enumerate(views) if known is view)

    writers: dict[Any, Any] = {Path: lambda path: relative_to(path, folder), Viewpoint: number_of}
    names = {kind: name for name, kind in KINDS.items()}
    entries = [{"mark": names[type(mark)], **to_plain(mark, writers)} for mark in marks.marks]
    rest = to_plain(replace(marks, marks=()), writers)
    saved = [
        to_plain(view.camera)
        | {"drawn": None if view.drawn_centre is None else {"centre": view.drawn_centre, "radius": view.drawn_radius}}
        for view in views
    ]
    return {"content": MARKS, "version": __version__, **rest, "marks": entries, "views": saved}


def read_marks(path: str | Path) -> Marks:
    """Return the marks in a file that `write_marks` wrote. Paths in it are relative to its folder.

    Raises:
        InputError: the file cannot be read, holds no marks, or one of them is not possible.
    """
    path = Path(path)
    return marks_from_json(read_json(path), path)


def marks_from_json(raw: Any, path: Path) -> Marks:
    """Return the marks in what `marks_as_json` made, as it stands in a file.

    Raises:
        InputError: it holds no marks, or one of them is not possible.
    """
    where = f"'{path}': "
    if not isinstance(raw, dict) or raw.get("content") != MARKS:
        raise InputError(f"'{path}' holds no marks; give the .json that 'gaussian-trimmer select' wrote.")
    readers: dict[Any, Any] = {Path: lambda data, place: path.parent / from_plain(data, Path, place)}
    saved: tuple[_SavedView, ...] = from_plain(raw.get("views", []), tuple[_SavedView, ...], f"{where}views")
    views = [_view(view, f"{where}views[{i}]") for i, view in enumerate(saved)]

    def numbered_view(data: Any, place: str) -> Viewpoint:
        number: int = from_plain(data, int, place)
        if number not in range(len(views)):
            raise wrong_value(number, place, f"the number of one of the file's {len(views)} views")
        return views[number]

    def mark(data: Any, place: str) -> Mark:
        given = dict(data) if isinstance(data, dict) else {}
        kind = given.pop("mark", None)
        if kind not in [*KINDS]:
            raise InputError(f"{place} is of no known kind; available: {', '.join(KINDS)}.")
        return from_plain(given, KINDS[kind], place, readers)  # type: ignore[no-any-return]

    readers |= {View: numbered_view, Mark: mark}
    given = {field.name: raw[field.name] for field in fields(Marks) if field.name in raw}
    marks: Marks = from_plain(given, Marks, where, readers)
    unit_up(marks.up, f"{where}the up vector")
    return marks


def relative_to(path: Path, folder: Path) -> str:
    """Return a path as seen from a folder, with slashes, or an absolute one where the folder is no parent of it."""
    whole, base = path.absolute(), folder.absolute()
    return whole.relative_to(base).as_posix() if whole.is_relative_to(base) else whole.as_posix()


def _view(saved: _SavedView, where: str) -> Viewpoint:
    K, pose = np.array(saved.K), np.array(saved.world_to_camera)
    make_lens((K[0, 0], K[1, 1], K[0, 2], K[1, 2]), saved.width, saved.height, where)
    rigid_transforms([pose], lambda _: where)
    if not saved.near > 0:
        raise wrong_value(saved.near, f"{where}.near", "above zero")
    # The numbers are taken as they are, so that the view is the same to the last bit.
    camera = Camera(pose, K, saved.width, saved.height, saved.name, saved.near)
    return Viewpoint(camera) if saved.drawn is None else Viewpoint(camera, saved.drawn.centre, saved.drawn.radius)
