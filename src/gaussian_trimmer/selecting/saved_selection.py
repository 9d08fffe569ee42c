"""A selection on disk: the mask as .npy, and beside it, as JSON, its marks, its scene, and what the marks removed.

A checksum says whether the .npy is still what the marks made, and so whether what is beside it is about it.
"""

from __future__ import annotations

import zlib
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.io.reading import file_bytes, is_file, read_json
from gaussian_trimmer.io.writing import atomic_file, npy_bytes, write_json
from gaussian_trimmer.selecting.marks_file import marks_as_json, relative_to
from gaussian_trimmer.selecting.row_packing import pack_rows, unpack_rows
from gaussian_trimmer.selecting.selection_result import SelectionResult
from gaussian_trimmer.settings import from_plain, to_plain


@dataclass(frozen=True)
class SelectionNote:
    """What the marks beside a selection say of it."""

    crc32: int
    """Checksum of the .npy."""
    selected: int
    """Number of selected Gaussians."""
    excluded: str
    """Which Gaussians the marks removed: a bit each, compressed, as base 64."""
    file: str = ""
    scene: Path | None = None
    """The scene that the selection was made in."""

    def is_of(self, scene: Path) -> bool:
        """Tell whether the selection was made in a scene, by its path."""
        return self.scene is not None and self.scene.resolve() == scene.resolve()


def save_selection(selection: SelectionResult, path: Path, scene: Path | None = None) -> None:
    """Write a selection as .npy and, beside it, its marks.

    Args:
        selection: what marks select.
        path: of the .npy.
        scene: file or folder of the scene.

    Raises:
        InputError: a file cannot be written.
    """
    assert selection.marks is not None and selection.excluded is not None, "marks made it"
    rows, removed = npy_bytes(selection.mask), pack_rows(selection.excluded)
    note = SelectionNote(zlib.crc32(rows), int(np.count_nonzero(selection.mask)), removed, path.name, scene)
    document = marks_as_json(selection.marks, path.parent)
    document["selection"] = to_plain(note, {Path: lambda place: relative_to(place, path.parent)})
    with atomic_file(path) as part:  # both are on the disk before either takes its place
        part.write_bytes(rows)
        write_json(document, path.with_suffix(".json"))


def note_on(path: Path) -> SelectionNote | None:
    """Return what the marks beside a selection say of it; None without marks, or if the selection was changed since."""
    note = note_beside(path)
    return note if note is not None and note.crc32 == zlib.crc32(file_bytes(path)) else None


def note_beside(path: Path) -> SelectionNote | None:
    """Return what the marks beside a selection say of it, be it as it is now or as it was before it was changed."""
    marks_path = path.with_suffix(".json")
    if is_file(path) and identify(marks_path).kind == "marks":
        with suppress(InputError):
            readers = {Path: lambda data, where: path.parent / from_plain(data, Path, where)}
            data = dict(read_json(marks_path)).get("selection")
            note: SelectionNote = from_plain(data, SelectionNote, "selection", readers)
            return note
    return None


def excluded_from(path: Path, n: int) -> BoolArray | None:
    """Return which of n Gaussians the marks of a saved selection removed, (N,).

    None if the selection was not made by marks, was changed since, or is of another scene.
    """
    note = note_on(path)
    with suppress(InputError):
        return None if note is None else unpack_rows(note.excluded, n)
    return None
