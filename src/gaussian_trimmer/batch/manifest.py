"""Manifests of a batch: tables (.csv) and lists of objects (.jsonl, one a line) with a row for every object or scene.

| column | |
|---|---|
| `scene` | splat file |
| `selection` | file with one object; or `labels` |
| `labels` | file with an id for every Gaussian, and |
| `objects` | the ids to trim, each an item: "3 5 7", or "all" for every id above zero |
| `name` | folder of the results below the output folder; with `objects`, a folder in it for each |
| `cameras` | training cameras |
| `up` | "z", "-y", or three numbers |
| `options` | options as `gaussian-trimmer trim` has them: "--plan.views 7 --segmenter grabcut" |

Paths are relative to the manifest's folder. In a .jsonl, `objects`, `up` and `options` may be lists.
"""

from __future__ import annotations

import csv
import io
import json
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from gaussian_trimmer.batch.items import Item, default_name
from gaussian_trimmer.batch.options import parse_options
from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.io.reading import file_bytes, is_file
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.selection_files.object_ids import count_ids
from gaussian_trimmer.selection_files.selection_file import open_selection
from gaussian_trimmer.trimming.arguments import vector_of_up

COLUMNS = ("scene", "selection", "labels", "objects", "name", "cameras", "up", "options")
_MAX_BYTES = 1 << 30
_MOST_IDS = 1 << 20
Row = Mapping[str, Any]


def read_manifest(path: str | Path, options: str = "") -> list[Item]:
    """The items of a manifest.

    Arguments:
        options: options as those of a row, which come before the row's own.

    Raises:
        InputError: the file cannot be read, or a row is not possible; the message names the row.
    """
    path = Path(path)
    if not is_file(path):
        raise InputError(f"There is no manifest '{path}'.")
    ending = path.suffix.lower()
    if ending not in (".csv", ".jsonl"):
        raise InputError(f"'{path}' is no manifest; known endings: .csv, .jsonl.")
    try:
        text = file_bytes(path, _MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"'{path}' is no text in UTF-8 (byte {error.start}); save it as such.") from error
    first = _words(options)
    items: list[Item] = []
    for line, row in _table(text, path) if ending == ".csv" else _json_lines(text, path):
        try:
            items += _items_of(row, path.parent, first)
        except InputError as error:
            raise InputError(f"'{path}', line {line}: {error}") from error
    if not items:
        raise InputError(f"'{path}' has no rows.")
    return items


def _table(text: str, path: Path) -> Iterator[tuple[int, Row]]:
    reader = csv.DictReader(io.StringIO(text, newline=""), strict=True)
    try:
        _check_columns(reader.fieldnames or (), f"'{path}'")
        for row in reader:
            if None in row or None in row.values():
                raise InputError(f"'{path}', line {reader.line_num}: it has not as many columns as the first line.")
            if any(row.values()):
                yield reader.line_num, row
    except csv.Error as error:
        raise InputError(f"'{path}', line {reader.line_num}: {error}.") from error


def _json_lines(text: str, path: Path) -> Iterator[tuple[int, Row]]:
    for number, line in enumerate(text.split("\n"), 1):
        if not line.strip():
            continue
        try:
            row = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise InputError(f"'{path}', line {number}: it is no JSON object ({error}).") from error
        if not isinstance(row, dict):
            raise InputError(f"'{path}', line {number}: it is no JSON object.")
        _check_columns(row, f"'{path}', line {number}:")
        yield number, row


def _check_columns(names: Any, place: str) -> None:
    if unknown := [name for name in names if name not in COLUMNS]:
        raise InputError(f"{place} has the unknown column '{shown(str(unknown[0]))}'; known: {', '.join(COLUMNS)}.")
    if "scene" not in names:
        raise InputError(f"{place} has no column 'scene'; known: {', '.join(COLUMNS)}.")


def _items_of(row: Row, folder: Path, options: tuple[str, ...]) -> list[Item]:
    """The items of one row: one, or one for every id."""
    scene, selection, labels = (_path(row, name, folder) for name in ("scene", "selection", "labels"))
    if scene is None:
        raise InputError("No scene is named.")
    if selection is not None and labels is not None:
        raise InputError("It has both a selection and labels; leave one out.")
    chosen = parse_options((*options, *_words(row.get("options") or "")))
    up = _up(row.get("up"))
    item = Item(
        scene,
        selection or labels,
        _text(row, "name"),
        cameras=_path(row, "cameras", folder),
        trust_paths=chosen.trust_paths,
        format=chosen.format,
        config=chosen.trim_config(),
        segmenter=chosen.segmenter,
        segmenter_options=chosen.used_options(),
        renderer=chosen.renderer,
        selection_options=chosen.selection_options,
    )
    if up is not None:
        item = replace(item, config=replace(item.config, up=up))
    wanted = row.get("objects")
    if labels is None:
        if wanted not in (None, "", []):
            raise InputError("It has objects, but no labels; name the file with an id for every Gaussian as labels.")
        objects = [item]
    else:
        reading = item.selection_options
        objects = [
            replace(
                item,
                name=f"{item.name}/{i}" if item.name else "",
                selection_options=replace(reading, kind="labels", object_id=(i,)),
            )
            for i in _ids(wanted, labels, reading)
        ]
    return [item if item.name else replace(item, name=_name(row, item)) for item in objects]


def _name(row: Row, item: Item) -> str:
    """The default name by the paths in the manifest, so that it does not hang on where the manifest lies."""
    written = [_text(row, name) for name in ("scene", "selection", "labels")]
    return default_name(replace(item, scene=written[0], selection=written[1] or written[2] or None))


def _ids(wanted: Any, labels: str, options: SelectionOptions) -> list[int]:
    if wanted == "all":
        return list(_ids_above_zero(labels, options.property))
    if isinstance(wanted, str):
        wanted = wanted.replace(",", " ").replace(";", " ").split()
    try:
        ids = [int(str(i)) for i in wanted or ()]
    except (ValueError, TypeError) as error:
        raise InputError(f"The objects are '{shown(str(wanted))}'; give ids, as in '3 5 7', or 'all'.") from error
    if not ids:
        raise InputError("It has labels, but no objects; give their ids, as in '3 5 7', or 'all'.")
    if len(set(ids)) < len(ids):
        raise InputError(f"The objects '{shown(' '.join(map(str, ids)))}' name an id twice.")
    return ids


@cache
def _ids_above_zero(labels: str, name: str | None) -> tuple[int, ...]:
    from gaussian_trimmer.batch.storage import local_copy

    with local_copy(labels) as path:
        values = open_selection(path).vector(SelectionOptions(property=name), "labels", "label", "ids", "instance")
    if values is None or values.dtype.kind not in "iu":
        raise InputError(f"'{labels}' holds no one-dimensional array of whole numbers that could be labels.")
    ids = tuple(i for i in count_ids(values)[0] if i > 0)
    if not 0 < len(ids) <= _MOST_IDS:
        raise InputError(f"'{labels}' has {len(ids)} ids above zero; at least one is needed, and at most {_MOST_IDS}.")
    return ids


def _up(given: Any) -> tuple[float, float, float] | None:
    if given in (None, "", []):
        return None
    if isinstance(given, str) and len(words := given.replace(",", " ").split()) == 3:
        given = words
    if isinstance(given, list):
        try:
            given = [float(value) for value in given]
        except (TypeError, ValueError):
            given = str(given)
    return vector_of_up(given)


def _text(row: Row, name: str) -> str:
    value = row.get(name)
    if value is None:
        return ""
    if not isinstance(value, str):
        raise InputError(f"Its {name} is a {type(value).__name__}; give text.")
    return value.strip()


def _path(row: Row, name: str, folder: Path) -> str | None:
    text = _text(row, name)
    if not text or "://" in text:
        return text or None
    if "\0" in text:
        raise InputError(f"Its {name} is '{shown(text)}', which no file can be named.")
    return str(folder / text)


def _words(options: Any) -> tuple[str, ...]:
    if isinstance(options, list) and all(isinstance(word, str) for word in options):
        return tuple(options)
    if not isinstance(options, str):
        raise InputError("Its options are no text; give them as on the command line.")
    try:
        return tuple(shlex.split(options))
    except ValueError as error:
        raise InputError(f"The options '{shown(options)}' cannot be taken apart ({error}).") from error
