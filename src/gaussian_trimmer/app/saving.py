"""What the app saves: the same as the command line, with the marks from which it can be made again."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gaussian_trimmer import formats
from gaussian_trimmer.app.documents import Document, Progress
from gaussian_trimmer.app.snapshots import MarkedObject, Snapshot
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.writing import atomic_folder
from gaussian_trimmer.output.report import file_stems
from gaussian_trimmer.output.saving import RESULTS, result_files, suffix_of, write_trim
from gaussian_trimmer.selecting.marks import FromFile, FromMasks
from gaussian_trimmer.selecting.marks_file import write_marks
from gaussian_trimmer.selecting.select import SelectionResult
from gaussian_trimmer.trimming.trim import trim_objects

MARKS = "selection.json"
"""Name of the file of marks among the results, the same as the command line's."""


@dataclass(frozen=True)
class Target:
    """Where to save, and how."""

    folder: Path
    """New or empty, or with earlier results."""
    format: str | None = None
    """Ending of the splat files; the scene's own, or the nearest that can be written, if it is not given."""
    overwrite: bool = False
    """Replace earlier results in the folder."""

    def suffix(self, document: Document) -> str:
        """Ending of the splat files that are made from a document."""
        return _own_suffix(document) if self.format is None else suffix_of(self.format)


def save_one(now: Snapshot, target: Target) -> str:
    """Save the trim of the active object and its marks; returns the command that makes the same files.

    Raises:
        InputError: the object has not been trimmed since it was marked, or the files cannot be written.
    """
    part = now.object
    if part.result is None:
        raise InputError(f"'{part.name}' has not been trimmed since it was marked; trim it first.")
    suffix, inputs = target.suffix(now.document), _inputs(now.document, [part])
    names = (*result_files(suffix), MARKS)
    with atomic_folder(target.folder, RESULTS, names=names, inputs=inputs, overwrite=target.overwrite) as results:
        write_marks(replace(now.basis, marks=part.marks), results / MARKS)
        write_trim(part.result, results, suffix, {**_shown(now.document), "name": part.name})
    return command_for(now, target)


def save_all(now: Snapshot, target: Target, progress: Progress) -> str:
    """Trim all marked objects together, so that no Gaussian is in two, and save them by name with the marks of each.

    Args:
        now: the state to save.
        target: where to save it.
        progress: called with the name of each stage when it begins.

    Returns:
        what was saved, in a few words.

    Raises:
        InputError: no object is marked, or the files cannot be written.
    """
    marked = [part for part in now.objects if part.n_selected]
    if not marked:
        raise InputError("No object is marked; mark one first.")
    document, suffix = now.document, target.suffix(now.document)
    names = (*result_files(suffix, several=True), "selection_*.json")
    inputs = _inputs(document, marked)
    with atomic_folder(target.folder, RESULTS, names=names, inputs=inputs, overwrite=target.overwrite) as results:
        result = trim_objects(
            document.scene,
            {part.name: _selection(now, part) for part in marked},
            config=now.object.choices.config(now.up),
            renderer=document.renderer,
            cameras=document.cameras,
            progress=progress,
        )
        progress("write")
        write_trim(result, results, suffix, _shown(document))
        for part, stem in zip(
            marked, file_stems((part.id, part.name) for part in result.objects).values(), strict=True
        ):
            name = stem.replace("object", MARKS.removesuffix(".json"), 1)
            write_marks(replace(now.basis, marks=part.marks), results / f"{name}.json")
    return f"{len(marked)} objects with {sum(len(part.gaussians) for part in result.objects):,} Gaussians"


def command_for(now: Snapshot, target: Target) -> str:
    """The command that makes what was saved again, from wherever it is run."""
    document, suffix = now.document, target.suffix(now.document)
    marks = (target.folder / MARKS).absolute()
    parts = ["gaussian-trimmer", "select", str(document.path.absolute()), "--marks", str(marks)]
    if document.camera_path is not None:
        parts += ["--cameras", str(document.camera_path.absolute())]
    if now.up.source == "given":
        parts += ["--up", *(repr(value) for value in now.up.direction.tolist())]
    if suffix != _own_suffix(document):
        parts += ["--format", suffix.lstrip(".")]
    return shlex.join([*parts, *now.object.choices.arguments(), "--output", "again.npy", "--trim", "again"])


def _selection(now: Snapshot, part: MarkedObject) -> SelectionResult:
    selected = part.selected
    return SelectionResult(
        selected.mask, replace(now.basis, marks=part.marks), selected.interpretations, selected.excluded
    )


def _own_suffix(document: Document) -> str:
    return formats.written_suffix(formats.find_scene(document.path))


def _inputs(document: Document, objects: list[MarkedObject]) -> list[Path]:
    """Files that must not be replaced."""
    given = [document.path, document.camera_path]
    for mark in (mark for part in objects for mark in part.marks):
        given += [mark.path] if isinstance(mark, FromFile) else [mark.folder] if isinstance(mark, FromMasks) else []
    return [path for path in given if path is not None and (path.is_file() or path is not document.camera_path)]


def _shown(document: Document) -> Mapping[str, Any]:
    return {
        "scene": str(document.path),
        "cameras": str(document.camera_path) if document.camera_path else None,
        "selection": MARKS,
    }
