"""Manifests of a batch: tables (.csv) and lists of objects (.jsonl, one a line) with a row for every object or scene.

| column | |
|---|---|
| `scene` | splat file, or folder of a training |
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
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from gaussian_trimmer.batch.items import Item, default_name
from gaussian_trimmer.batch.options import parse_options
from gaussian_trimmer.batch.storage import local_copy
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
        raise InputError(f"'{path}' is not a manifest; known endings: .csv, .jsonl.")
    try:
        text = file_bytes(path, _MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"'{path}' is not text in UTF-8 (byte {error.start}); save it as such.") from error
    rows = _Rows(path.parent, _words(options))
    items: list[Item] = []
    for line, row in _table(text, path) if ending == ".csv" else _json_lines(text, path):
        try:
            items += rows.items_of(row)
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
            raise InputError(f"'{path}', line {number}: it is not a JSON object ({error}).") from error
        if not isinstance(row, dict):
            raise InputError(f"'{path}', line {number}: it is not a JSON object.")
        _check_columns(row, f"'{path}', line {number}:")
        yield number, row


def _check_columns(names: Any, place: str) -> None:
    if unknown := [name for name in names if name not in COLUMNS]:
        raise InputError(f"{place} has the unknown column '{shown(str(unknown[0]))}'; known: {', '.join(COLUMNS)}.")
    if "scene" not in names:
        raise InputError(f"{place} has no column 'scene'; known: {', '.join(COLUMNS)}.")


@dataclass(frozen=True)
class _Rows:
    """What the rows of a manifest have in common."""

    folder: Path
    options: tuple[str, ...]
    ids_of_files: dict[tuple[str, str | None], tuple[int, ...]] = field(default_factory=dict)
    """Ids above zero in files of labels, which are read once for all rows."""

    def items_of(self, row: Row) -> list[Item]:
        """The items of a row: one, or one for every id."""
        scene, selection, labels = (_path(row, name, self.folder) for name in ("scene", "selection", "labels"))
        if scene is None:
            raise InputError("No scene is named.")
        if selection is not None and labels is not None:
            raise InputError("It has both a selection and labels; leave one out.")
        chosen = parse_options((*self.options, *_words(row.get("options") or "")))
        config, up = chosen.trim_config(), _up(row.get("up"))
        item = Item(
            scene,
            selection or labels,
            _text(row, "name"),
            cameras=_path(row, "cameras", self.folder),
            trust_paths=chosen.trust_paths,
            format=chosen.format,
            config=config if up is None else replace(config, up=up),
            segmenter=chosen.segmenter,
            segmenter_options=chosen.used_options(),
            renderer=chosen.renderer,
            selection_options=chosen.selection_options,
        )
        items = [item] if labels is None else self._objects(item, row.get("objects"))
        if labels is None and row.get("objects") not in (None, "", []):
            raise InputError("It has objects, but no labels; name the file with an id for every Gaussian as labels.")
        return [item if item.name else replace(item, name=_name(row, item)) for item in items]

    def _objects(self, item: Item, wanted: Any) -> list[Item]:
        """An item for each object of a file of labels."""
        reading = item.selection_options
        if reading.object_id or reading.kind not in ("auto", "labels"):
            raise InputError("Its objects say what is selected; leave --selection.object-id and --selection.kind out.")
        return [
            replace(
                item,
                name=f"{item.name}/{i}" if item.name else "",
                selection_options=replace(reading, kind="labels", object_id=(i,)),
            )
            for i in (self._all_ids(item) if wanted == "all" else _ids(wanted))
        ]

    def _all_ids(self, item: Item) -> tuple[int, ...]:
        assert item.selection is not None
        key = item.selection, item.selection_options.property
        if key not in self.ids_of_files:
            self.ids_of_files[key] = _ids_above_zero(*key)
        return self.ids_of_files[key]


def _name(row: Row, item: Item) -> str:
    """The default name from the paths as they are written, so that it is the same wherever the manifest lies."""
    written = [_text(row, name) for name in ("scene", "selection", "labels")]
    return default_name(replace(item, scene=written[0], selection=written[1] or written[2] or None))


def _ids(wanted: Any) -> list[int]:
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


def _ids_above_zero(labels: str, name: str | None) -> tuple[int, ...]:
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
        raise InputError("Its options are not text; give them as on the command line.")
    try:
        return tuple(shlex.split(options))
    except ValueError as error:
        raise InputError(f"The options '{shown(options)}' cannot be taken apart ({error}).") from error
