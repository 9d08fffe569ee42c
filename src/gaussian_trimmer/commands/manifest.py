"""Manifests of batches, whose columns docs/batch.md explains: the words of `trim` for each object of each scene."""

from __future__ import annotations

import csv
import io
import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.io.reading import is_file
from gaussian_trimmer.io.writing import safe_file_name
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.selection_files.kinds import count_ids
from gaussian_trimmer.selection_files.selection_file import open_selection

COLUMNS = ("scene", "selection", "labels", "objects", "name", "cameras", "up", "options")
FOUND_OBJECTS = "batch.csv"
"""The manifest that `objects` writes into its folder."""
_ELSEWHERE = {
    **{f"--{name}": f"is the column '{name}'" for name in ("cameras", "labels", "objects")},
    "--output": "is the column 'name', below --output of the batch",
    **{f"--{name}": "is an option of the batch itself" for name in ("overwrite", "json", "quiet")},
}
"""Options of `trim` that a row cannot have, and where a batch has them."""
_PUNCTUATION = "._-+"
"""In names of folders."""
_MOST_TOLD = 8
"""Wrong rows that one message describes."""


@dataclass(frozen=True)
class Item:
    """One object of one scene."""

    name: str
    """Folder of its results below `items` in the output."""
    words: tuple[str, ...] = ()
    """What `trim` is told of it: scene, selection and options, but not where the results go."""
    files: Mapping[str, list[int]] = field(default_factory=dict)
    """What it is made from: number of files, bytes and latest change in nanoseconds at each path."""


def read_manifest(path: Path, item_of: Callable[[str, Sequence[str]], Item]) -> list[Item]:
    """Return the items of a manifest.

    Args:
        path: the file.
        item_of: makes an item of a name, which may be empty, and words of `trim`; refuses those that are not possible.

    Raises:
        InputError: the file cannot be read, or rows are not possible; the message names the rows.
    """
    if is_file(path / FOUND_OBJECTS):
        raise InputError(f"'{path}' is a folder; give the manifest in it, '{path / FOUND_OBJECTS}'.")
    if not is_file(path) or path.suffix.lower() != ".csv":
        raise InputError(f"There is no manifest '{path}'; give a table that ends with .csv.")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"'{path}' is not text in UTF-8 (byte {error.start}); save it as such.") from error
    items, wrong = list[Item](), list[str]()
    for line, row in _rows(text):
        try:
            items += [item_of(name, words) for name, words in _trims_of(row, path.absolute().parent)]
        except InputError as error:
            wrong.append(f"line {line}: {error}")
    if wrong:
        more = f" {len(wrong) - _MOST_TOLD} more rows are wrong." if len(wrong) > _MOST_TOLD else ""
        raise InputError(f"'{path}', {' '.join(wrong[:_MOST_TOLD])}{more}")
    if not items:
        raise InputError(f"'{path}' has no rows.")
    return items


def check_names(items: Iterable[Item]) -> None:
    """Refuse items whose results would lie in the same folder, or in those of another.

    Raises:
        InputError: two items have the same name, or the folder of one would lie in that of another.
    """
    known = set[str]()
    for item in items:
        if (name := item.name.casefold()) in known:  # some file systems fold cases
            raise InputError(f"Two items are named '{clip_name(item.name)}'; give each a name of its own.")
        known.add(name)
    for inner in known:
        if outer := known.intersection(map(str, PurePosixPath(inner).parents)):
            raise InputError(
                f"The folder of item '{clip_name(inner)}' would lie in that of '{clip_name(min(outer))}'; give one of "
                "them another name."
            )


def option_words(text: str) -> list[str]:
    """Return the words of a text of options, which a row may have.

    Raises:
        InputError: a quotation mark has no partner, or a batch has an option in another way.
    """
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise InputError(f"The options '{clip_name(text)}' cannot be split into words ({error}).") from error
    for word in words:
        flag = word.partition("=")[0].replace("_", "-")
        if where := _ELSEWHERE.get(flag.replace("--no-", "--", 1)):
            raise InputError(f"{flag} {where}; leave it out.")
    return words


def _rows(text: str) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the numbers of lines and their cells by column; a first line that is wrong counts as a row."""
    reader = csv.DictReader(io.StringIO(text, newline=""), strict=True)
    try:
        header = reader.fieldnames or ()
        if header and not {"scene"} <= set(header) <= set(COLUMNS):
            yield reader.line_num, dict.fromkeys(header, "")
            return
        yield from ((reader.line_num, row) for row in reader if any(row.values()))
    except csv.Error as error:
        raise InputError(f"The manifest cannot be read from line {reader.line_num} on: {error}.") from error


def _trims_of(row: dict[str, Any], folder: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the name, empty if there is none, and the words of each trim that a row asks for."""
    if None in row or None in row.values():
        raise InputError("It does not have as many columns as the first line.")
    if unknown := [name for name in row if name not in COLUMNS]:
        cure = " Cells are separated by commas." if set(unknown[0]) & set(";\t") else ""
        raise InputError(f"'{clip_name(unknown[0])}' is not a column; known: {', '.join(COLUMNS)}.{cure}")
    cells = {name: str(row.get(name, "")).strip() for name in COLUMNS}
    scene, selection, labels, cameras = (
        str(folder / cells[name]) if cells[name] else "" for name in ("scene", "selection", "labels", "cameras")
    )
    name, objects = cells["name"], cells["objects"]
    if not scene:
        raise InputError("The column 'scene' is missing or empty.")
    if selection and labels:
        raise InputError("It has both a selection and labels; leave one out.")
    if objects and not labels:
        raise InputError("It has objects, but no labels; name the file with an id for every Gaussian as labels.")
    if labels and not objects:
        raise InputError("It has labels, but no objects; give the ids to trim, as in '3 5 7', or 'all'.")
    more = option_words(cells["options"])
    more += ["--cameras", cameras] if cameras else []
    more += ["--up", *cells["up"].replace(",", " ").split()] if cells["up"] else []
    if not labels:
        yield name, [scene, *([selection] if selection else []), *more]
        return
    for number in _ids(objects, Path(labels)):
        one = ["--set", "selection.kind=labels", "--set", f"selection.object-id={number}"]
        yield f"{name}/{number}" if name else "", [scene, labels, *more, *one]


def _ids(wanted: str, labels: Path) -> list[int]:
    """Return the ids that are wanted of a file of labels, which is read for 'all' alone."""
    if wanted == "all":
        values = open_selection(labels).vector(SelectionOptions(), "labels", "label", "ids", "instance")
        if values is None or values.dtype.kind not in "iu":
            raise InputError(f"'{labels}' holds no one-dimensional array of whole numbers that could be labels.")
        if not (ids := [number for number in count_ids(values)[0] if number > 0]):
            raise InputError(f"'{labels}' has no ids above zero.")
        return ids
    words = wanted.replace(",", " ").replace(";", " ").split()
    if len(set(words)) < len(words) or not all(re.fullmatch(r"-?\d{1,10}", word) for word in words):
        raise InputError(f"The objects are '{clip_name(wanted)}'; give each id once, as in '3 5 7', or 'all'.")
    return [int(word) for word in words]


def checked_name(name: str) -> str:
    """Return a name of a folder that is possible on every system.

    Raises:
        InputError: it is not.
    """
    parts = [part for part in name.split("/") if part not in ("", ".", "..")]
    possible = "/".join(safe_file_name(part, _PUNCTUATION) for part in parts or ["_"])
    if name != possible:
        raise InputError(
            f"The name '{clip_name(name)}' cannot name a folder on every system, as '{clip_name(possible)}' can."
        )
    return name
