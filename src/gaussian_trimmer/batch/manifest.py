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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from gaussian_trimmer.batch.items import Item, default_name, has_whole_path
from gaussian_trimmer.cameras import vector_of_up
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.io.reading import is_file
from gaussian_trimmer.io.writing import write_whole
from gaussian_trimmer.options import arg, parse
from gaussian_trimmer.output.placing import PlacingOptions
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.selection_files.labels import count_ids
from gaussian_trimmer.selection_files.selection_file import open_selection
from gaussian_trimmer.trimming.trim_options import TrimOptions

COLUMNS = ("scene", "selection", "labels", "objects", "name", "cameras", "up", "options")
Row = Mapping[str, Any]
FOUND_OBJECTS = "batch.csv"
"""The manifest that `objects` writes into its folder."""
ELSEWHERE = {
    **{f"--{name}": f"is the column '{name}'" for name in ("cameras", "labels", "objects")},
    "--output": "is the column 'name', below --output of the batch",
    "--overwrite": "is not needed: a batch replaces its own results",
    "--json": "is an option of the batch itself",
    "--quiet": "is an option of the batch itself",
    **dict.fromkeys(
        ("--exclude", "--photos", "--log-level", "--coordinates", "--view",
         "--view-index", "--click", "--box", "--box3d", "--sphere", "--plane", "--remove-click", "--remove-box",
         "--remove-box3d", "--remove-sphere", "--remove-plane", "--intersect-box3d", "--intersect-sphere",
         "--intersect-plane", "--add", "--subtract", "--intersect", "--grow", "--shrink"),
        "is not for a batch",
    ),
}  # fmt: skip
"""Options of `trim` that are none of `RowOptions`: where a batch has them, if it does."""
_MOST_TOLD = 8
"""Wrong rows that one message describes."""


@dataclass(frozen=True, kw_only=True)
class RowOptions(TrimOptions):
    """The options of a row: those of `trim` that concern a trim itself, and not where its files are."""

    selection_options: Annotated[SelectionOptions, arg(name="selection")] = field(default_factory=SelectionOptions)
    placing: Annotated[PlacingOptions, arg(name="")] = field(default_factory=PlacingOptions)
    html: bool = False


def read_manifest(path: str | Path, options: str = "") -> list[Item]:
    """The items of a manifest.

    Arguments:
        options: options as those of a row, which come before the row's own.

    Raises:
        InputError: the file cannot be read, or a row is not possible; the message names the row.
    """
    path = Path(path)
    if is_file(path / FOUND_OBJECTS):
        raise InputError(f"'{path}' is a folder; give the manifest in it, '{path / FOUND_OBJECTS}'.")
    if not is_file(path):
        raise InputError(f"There is no manifest '{path}'.")
    readers = {".csv": _table, ".jsonl": _json_lines}
    if path.suffix.lower() not in readers:
        raise InputError(f"'{path}' is not a manifest; known endings: {', '.join(readers)}.")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"'{path}' is not text in UTF-8 (byte {error.start}); save it as such.") from error
    rows, items, wrong = _Rows(path.parent, _common_options(options)), list[Item](), list[str]()
    for line, found in readers[path.suffix.lower()](text):
        try:
            items += rows.items_of(_row(found))
        except InputError as error:
            wrong.append(f"line {line}: {error}")
    if wrong:
        more = f" {len(wrong) - _MOST_TOLD} more rows are wrong." if len(wrong) > _MOST_TOLD else ""
        raise InputError(f"'{path}', {' '.join(wrong[:_MOST_TOLD])}{more}")
    if not items:
        raise InputError(f"'{path}' has no rows.")
    return items


def write_manifest(rows: Sequence[Row], path: Path) -> None:
    """Write rows, which have the same columns, as a table.

    Raises:
        InputError: the file cannot be written.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, [name for name in COLUMNS if name in rows[0]], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(path, text.getvalue())


def _table(text: str) -> Iterator[tuple[int, Any]]:
    reader = csv.DictReader(io.StringIO(text, newline=""), strict=True)
    try:
        header = reader.fieldnames or ()
        if header and not {"scene"} <= set(header) <= set(COLUMNS):  # what is wrong stands in the first line
            yield reader.line_num, dict.fromkeys(header, "")
            return
        yield from ((reader.line_num, row) for row in reader if any(row.values()))
    except csv.Error as error:
        raise InputError(f"The manifest cannot be read from line {reader.line_num} on: {error}.") from error


def _json_lines(text: str) -> Iterator[tuple[int, Any]]:
    return ((number, line) for number, line in enumerate(text.split("\n"), 1) if line.strip())


def _row(found: Any) -> Row:
    """A row, from a line of JSON or from what `csv` makes of one."""
    try:
        row = json.loads(found) if isinstance(found, str) else found
    except (ValueError, RecursionError):
        row = None
    if not isinstance(row, dict):
        raise InputError("It is not a JSON object.")
    if row is found and (None in row or None in row.values()):
        raise InputError("It does not have as many columns as the first line.")
    if unknown := [name for name in row if name not in COLUMNS]:
        cure = " Cells are separated by commas." if set(unknown[0]) & set(";\t") else ""
        raise InputError(f"'{clip_name(unknown[0])}' is not a column; known: {', '.join(COLUMNS)}.{cure}")
    return row


@dataclass(frozen=True)
class _Rows:
    """What the rows of a manifest have in common."""

    folder: Path
    options: tuple[str, ...]
    known_options: dict[tuple[str, ...], RowOptions] = field(default_factory=dict)
    """By the words they are made of."""
    ids_of_files: dict[tuple[str, str | None], tuple[int, ...]] = field(default_factory=dict)
    """Ids above zero in files of labels."""

    def items_of(self, row: Row) -> list[Item]:
        """The items of a row: one, or one for every id."""
        scene, selection, labels, cameras = (
            self._path(row, name) for name in ("scene", "selection", "labels", "cameras")
        )
        if scene is None:
            raise InputError("The column 'scene' is missing or empty.")
        if selection is not None and labels is not None:
            raise InputError("It has both a selection and labels; leave one out.")
        if labels is None and row.get("objects"):
            raise InputError("It has objects, but no labels; name the file with an id for every Gaussian as labels.")
        if labels is not None and not row.get("objects"):
            raise InputError("It has labels, but no objects; give the ids to trim, as in '3 5 7', or 'all'.")
        chosen, up = self._options_of(row), _up(row.get("up"))
        config = chosen.settings()
        item = Item(
            scene,
            selection or labels,
            _text(row, "name"),
            cameras=cameras,
            level=chosen.level,
            trust_paths=chosen.trust_paths,
            format=chosen.format,
            html=chosen.html,
            placing=chosen.placing,
            config=config if up is None else replace(config, up=up),
            segmenter=chosen.segmenter,
            segmenter_options=chosen.used_options(),
            selection_options=chosen.selection_options,
        )
        items = [item] if labels is None else self._objects(item, row.get("objects"))
        return [item if item.name else replace(item, name=_name(row, item)) for item in items]

    def _options_of(self, row: Row) -> RowOptions:
        words = (*self.options, *_words(row.get("options") or ""))
        if words not in self.known_options:
            self.known_options[words] = _row_options(words)
        return self.known_options[words]

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

    def _path(self, row: Row, name: str) -> str | None:
        text = _text(row, name)
        return str(self.folder / text) if text else None


def _name(row: Row, item: Item) -> str:
    """The default name from the paths as they are written, so that it is the same wherever the manifest lies.

    Of whole paths it is left to `check_items`, which knows those of all items.
    """
    written = [_text(row, name) for name in ("scene", "selection", "labels")]
    as_written = replace(item, scene=written[0], selection=written[1] or written[2] or None)
    return "" if has_whole_path(as_written) else default_name(as_written)


def _ids(wanted: Any) -> list[int]:
    words = wanted.replace(",", " ").replace(";", " ").split() if isinstance(wanted, str) else wanted or ()
    try:
        ids = [int(str(i)) for i in words]
    except (ValueError, TypeError):
        ids = []
    if not ids or len(set(ids)) < len(ids):
        raise InputError(f"The objects are '{clip_name(str(wanted))}'; give each id once, as in '3 5 7', or 'all'.")
    return ids


def _ids_above_zero(labels: str, name: str | None) -> tuple[int, ...]:
    values = open_selection(Path(labels)).vector(SelectionOptions(property=name), "labels", "label", "ids", "instance")
    if values is None or values.dtype.kind not in "iu":
        raise InputError(f"'{labels}' holds no one-dimensional array of whole numbers that could be labels.")
    ids = tuple(i for i in count_ids(values)[0] if i > 0)
    if not ids:
        raise InputError(f"'{labels}' has no ids above zero.")
    return ids


def _up(given: Any) -> tuple[float, float, float] | None:
    if isinstance(given, str) and len(numbers := given.replace(",", " ").split()) == 3:
        given = numbers
    return vector_of_up(given) if given else None


def _text(row: Row, name: str) -> str:
    value = row.get(name) or ""
    if not isinstance(value, str):
        raise InputError(f"Its {name} is a {type(value).__name__}; give text.")
    return value.strip()


def _common_options(options: str) -> tuple[str, ...]:
    """Return the words of the options of all rows, of which it is said once if they are not possible."""
    try:
        words = _words(options)
        _row_options(words)
    except InputError as error:
        raise InputError(f"--options: {error}") from error
    return words


def _row_options(words: tuple[str, ...]) -> RowOptions:
    try:
        return parse(RowOptions, words, "trim")
    except InputError:
        for word in words:
            flag = word.partition("=")[0].replace("_", "-")
            if where := ELSEWHERE.get(flag.replace("--no-", "--", 1)):
                raise InputError(f"{flag} {where}; leave it out.") from None
        raise


def _words(options: Any) -> tuple[str, ...]:
    try:
        words = shlex.split(options) if isinstance(options, str) else options
    except ValueError as error:
        raise InputError(f"The options '{clip_name(options)}' cannot be split into words ({error}).") from error
    if not isinstance(words, list) or not all(isinstance(word, str) for word in words):
        raise InputError("Its options are not text; give them as on the command line.")
    return tuple(words)
