"""`selection.json`: the marks that made a selection, with the views that their pixels refer to."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer._version import __version__
from gaussian_trimmer.camera_files.frames import make_lens, rigid_transforms
from gaussian_trimmer.cameras import Camera, unit_up
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.reading import file_bytes, is_file, reading
from gaussian_trimmer.io.writing import atomic_file
from gaussian_trimmer.selecting.marks import KINDS, Mark, Marks, Viewpoint
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import check_settings

CONTENT = "selection marks"
_MAX_BYTES, _MAX_VALUES, _MAX_MARKS = 1 << 24, 1 << 20, 10_000
_CHOICES = {
    "effect": ("add", "remove", "intersect"), "coordinates": ("scene", "up"), "method": ("assignment", "vote"),
}  # fmt: skip
_VECTORS = ("low", "high", "centre", "normal")
_WHOLE = ("x", "y", "x0", "y0", "x1", "y1")
_LARGEST = 1 << 31
_OPTIONS = {option.name: option.default for option in fields(SelectionOptions)}
"""Options of selection files, with their defaults, which are not written."""


def write_marks(marks: Marks, path: Path) -> None:
    """Write marks as JSON.

    Raises:
        InputError: a view is not given as a `Viewpoint`, or the file cannot be written.
    """
    text = json.dumps(marks_as_json(marks, path.parent), indent=1, allow_nan=False) + "\n"
    with atomic_file(path) as part:
        part.write_text(text, encoding="utf-8")


def read_marks(path: str | Path) -> Marks:
    """The marks in a file that `write_marks` wrote. Paths in it are relative to its folder.

    Raises:
        InputError: the file cannot be read, is none of marks, or one of them is not possible.
    """
    path = Path(path)
    if not is_file(path):
        raise InputError(f"There is no file '{path}'.")
    with reading(path):
        data = file_bytes(path, _MAX_BYTES)
    document = _parsed(data, path)
    if not isinstance(document, dict) or document.get("content") != CONTENT:
        raise InputError(f"'{path}' holds no marks; give the .json that 'gaussian-trimmer select' wrote.")
    size = document.get("scene_size")
    if size is not None and not _is_whole(size):
        raise InputError(f"'{path}': scene_size is no number of Gaussians.")
    views = [_view(entry, f"'{path}', view {i}") for i, entry in enumerate(_list(document, "views", path))]
    entries = _list(document, "marks", path)
    photographed = tuple(
        _vector(entry, f"'{path}', photographed_from {i}")
        for i, entry in enumerate(_list(document, "photographed_from", path))
    )
    cameras = document.get("cameras")
    return Marks(
        tuple(_mark(entry, views, path.parent, f"'{path}', mark {i}") for i, entry in enumerate(entries)),
        _unit(document.get("up"), f"'{path}': the up vector"), photographed, size,
        _path(cameras, path.parent, f"'{path}': cameras") if cameras is not None else None,
    )  # fmt: skip


def is_marks_file(path: Path) -> bool:
    """Whether a JSON file holds marks, as far as its beginning tells; other files have other beginnings."""
    if path.suffix.lower() != ".json" or not is_file(path):
        return False
    with path.open("rb") as file:
        return f'"content": "{CONTENT}"'.encode() in file.read(256)


def marks_as_json(marks: Marks, folder: Path) -> dict[str, Any]:
    """Marks as JSON holds them; paths become relative to a folder where that is possible."""
    views: list[Viewpoint] = []
    entries = [_entry(mark, views, folder) for mark in marks.marks]
    return {
        "content": CONTENT,
        "version": __version__,
        "scene_size": marks.scene_size,
        "up": list(marks.up),
        "cameras": _relative(marks.cameras, folder) if marks.cameras is not None else None,
        "marks": entries,
        "views": [_view_entry(view) for view in views],
        "photographed_from": [list(place) for place in marks.photographed_from],
    }


def _entry(mark: Mark, views: list[Viewpoint], folder: Path) -> dict[str, Any]:
    kind = next(name for name, known in KINDS.items() if isinstance(mark, known))
    entry: dict[str, Any] = {"mark": kind}
    for field in fields(mark):
        value = getattr(mark, field.name)
        if isinstance(value, Path):
            value = _relative(value, folder)
        elif isinstance(value, SelectionOptions):
            value = {
                name: _relative(option, folder) if isinstance(option, Path) else option
                for name in _OPTIONS
                if (option := getattr(value, name)) != _OPTIONS[name]
            }
        elif field.name == "view":
            if not isinstance(value, Viewpoint):
                raise InputError(f"The view of a {kind} is {value!r}; marks are saved as `select` returned them.")
            value = next((i for i, view in enumerate(views) if view is value), None)
            if value is None:
                value = len(views)
                views.append(mark.view)  # type: ignore[union-attr, arg-type]
        entry[field.name] = list(value) if isinstance(value, tuple) else value
    return entry


def _view_entry(view: Viewpoint) -> dict[str, Any]:
    camera = view.camera
    drawn = None
    if view.drawn_centre is not None:
        drawn = {"centre": list(view.drawn_centre), "radius": view.drawn_radius}
    return {
        "name": camera.name, "width": camera.width, "height": camera.height, "K": camera.K.tolist(),
        "world_to_camera": camera.world_to_camera.tolist(), "near": camera.near, "drawn": drawn,
    }  # fmt: skip


def _parsed(data: bytes, path: Path) -> Any:
    if sum(map(data.count, (b",", b"[", b"{"))) > _MAX_VALUES:
        raise InputError(f"'{path}' has more than {_MAX_VALUES} values, too many for a list of marks.")
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise InputError(f"'{path}' is no JSON that can be read; select again.") from error


def _list(document: dict[str, Any], name: str, path: Path) -> list[Any]:
    entries = document.get(name, [])
    if not isinstance(entries, list) or len(entries) > _MAX_MARKS:
        raise InputError(f"'{path}': {name} is no list of at most {_MAX_MARKS} entries.")
    return entries


def _mark(entry: Any, views: Sequence[Viewpoint], folder: Path, where: str) -> Mark:
    if not isinstance(entry, dict) or not isinstance(entry.get("mark"), str) or entry["mark"] not in KINDS:
        raise InputError(f"{where} is of no known kind; available: {', '.join(KINDS)}.")
    kind = KINDS[entry["mark"]]
    values: dict[str, Any] = {}
    for field in fields(kind):
        if field.name in entry:
            values[field.name] = _value(field.name, entry[field.name], views, folder, f"{where}: {field.name}")
        elif field.default is MISSING and field.default_factory is MISSING:
            raise InputError(f"{where} has no {field.name}.")
    return kind(**values)


def _value(name: str, value: Any, views: Sequence[Viewpoint], folder: Path, where: str) -> Any:
    if name == "view":
        if not _is_whole(value) or not 0 <= value < len(views):
            raise InputError(f"{where} is none of the file's {len(views)} views.")
        return views[value]
    if name in _CHOICES:
        if value not in _CHOICES[name]:
            raise InputError(f"{where} is not one of {', '.join(_CHOICES[name])}.")
        return value
    if name in ("path", "folder"):
        return _path(value, folder, where)
    if name in _VECTORS:
        return _vector(value, where)
    if name == "options":
        return _options(value, folder, where)
    if name in _WHOLE and not _is_whole(value):
        raise InputError(f"{where} is no whole number.")
    return value if name in _WHOLE else _number(value, where)


def _options(value: Any, folder: Path, where: str) -> SelectionOptions:
    if not isinstance(value, dict) or not value.keys() <= _OPTIONS.keys():
        raise InputError(f"{where} are none of a selection file's; available: {', '.join(_OPTIONS)}.")
    given: dict[str, Any] = {name: tuple(entry) if isinstance(entry, list) else entry for name, entry in value.items()}
    if "classifier" in given:
        given["classifier"] = _path(given["classifier"], folder, where)
    if not isinstance(given.get("property", ""), str):
        raise InputError(f"{where}: property is no name.")
    options = SelectionOptions(**given)
    check_settings(options, "selection")
    return options


def _view(entry: Any, where: str) -> Viewpoint:
    if not isinstance(entry, dict):
        raise InputError(f"{where} is no view.")
    K = np.array([_vector(row, f"{where}: K") for row in _rows(entry.get("K"), 3, f"{where}: K")])
    pose = [_numbers(row, 4, where) for row in _rows(entry.get("world_to_camera"), 4, f"{where}: world_to_camera")]
    width, height = entry.get("width"), entry.get("height")
    lens = make_lens((K[0, 0], K[1, 1], K[0, 2], K[1, 2]), width, height, False, where)
    rigid_transforms([np.array(pose)], lambda _: where)
    near, name, drawn = _number(entry.get("near"), f"{where}: near"), entry.get("name", ""), entry.get("drawn")
    if not isinstance(name, str) or not near > 0:
        raise InputError(f"{where} has no possible name or near plane.")
    # The numbers are taken as they are, so that the view is the same to the last bit.
    camera = Camera(np.array(pose), K, lens.width, lens.height, name, near)
    if drawn is None:
        return Viewpoint(camera)
    if not isinstance(drawn, dict):
        raise InputError(f"{where}: drawn is no ball.")
    return Viewpoint(
        camera, _vector(drawn.get("centre"), f"{where}: drawn"), _number(drawn.get("radius"), f"{where}: drawn")
    )


def _rows(value: Any, n: int, where: str) -> list[Any]:
    if not isinstance(value, list) or len(value) != n:
        raise InputError(f"{where} has not {n} rows.")
    return value


def _numbers(value: Any, n: int, where: str) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) != n:
        raise InputError(f"{where} has not {n} numbers.")
    return tuple(_number(number, where) for number in value)


def _vector(value: Any, where: str) -> tuple[float, float, float]:
    x, y, z = _numbers(value, 3, where)
    return x, y, z


def _unit(value: Any, where: str) -> tuple[float, float, float]:
    vector = _vector(value, where)
    unit_up(vector, where)
    return vector


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e30 or math.isnan(value):
        raise InputError(f"{where} is no finite number.")
    return float(value)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) < _LARGEST


def _path(value: Any, folder: Path, where: str) -> Path:
    if not isinstance(value, str) or not value or "\0" in value or len(value) > 4096:
        raise InputError(f"{where} is no path.")
    return folder / value


def _relative(path: Path, folder: Path) -> str:
    """A path as seen from a folder, with slashes, or an absolute one where the folder is no parent of it."""
    whole, base = path.absolute(), folder.absolute()
    return whole.relative_to(base).as_posix() if whole.is_relative_to(base) else whole.as_posix()
