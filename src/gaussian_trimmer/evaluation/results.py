"""Results of a trim or of any other tool on disk, as a scene cut in two."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.scoring import Cut, cut_by
from gaussian_trimmer.gaussians import Gaussians, concatenate, mask_of_rows
from gaussian_trimmer.io.reading import is_folder, path_inside, read_json
from gaussian_trimmer.selection_files import SelectionOptions, kinds, load_selection
from gaussian_trimmer.selection_files.kinds import MASK, check_ids
from gaussian_trimmer.selection_files.selection_file import open_selection


def read_result(path: Path, scene: Gaussians, options: SelectionOptions | None = None) -> Cut:
    """Return the object that a folder of a trim, a splat file or a selection file holds.

    - A folder must be one that `gaussian-trimmer trim` wrote: object, background, and the selection before the trim. Of
      several objects the options name one.
    - A splat file with fewer Gaussians than the scene is the object itself. The background is the scene without the
      object's rows, if they are found in it.
    - Anything else is a selection of the scene's rows.

    Args:
        path: folder or file.
        scene: all N Gaussians.
        options: how a selection file is read.

    Raises:
        InputError: nothing readable is there, or it does not fit the scene.
    """
    if is_folder(path):
        return _read_folder(path, scene, options.object_id if options else ())
    if path.name.lower().endswith(tuple(formats.FORMATS)):
        columns = open_selection(path, len(scene)).columns
        if columns is not None and MASK not in columns and len(columns["x"]) < len(scene):
            return _read_object(path, scene)
    return cut_by(scene, load_selection(path, scene, options))


def read_background(path: Path) -> Gaussians:
    """Return the scene without the object: the background in a folder of a trim, or a splat file of any program.

    Raises:
        InputError: there is none, or it cannot be read.
    """
    if not is_folder(path):
        return formats.read(path)
    found = _only(path, "background")
    if found is None:
        raise InputError(f"'{path}' holds no background file; give the splat file of the scene without the object.")
    return formats.read(found)


def _read_object(path: Path, scene: Gaussians) -> Cut:
    found = formats.read(path)
    try:
        selection = load_selection(path, scene)
    except InputError as error:
        return Cut(found, None, unknown=str(error))
    return Cut(found, scene.select(~selection), selection)


def _read_folder(folder: Path, scene: Gaussians, wanted: Sequence[int]) -> Cut:
    """Return the object of a trim's folder, or of several the one with an id; the others are part of the background."""
    labels, n = folder / "labels.npz", len(scene)
    if not labels.is_file():
        raise InputError(
            f"'gaussian-trimmer trim' did not write the folder '{folder}': it lacks labels.npz; name another tool's "
            "file itself."
        )
    file = open_selection(labels, n)
    rows = kinds.rows_of_objects(file, n)
    if wanted or len(rows) > 1:
        check_ids(wanted, list(rows), [len(own) for own in rows.values()], folder)
    files = _object_files(folder, list(rows))
    parts = {number: formats.read(path) for number, path in files.items()}
    chosen = [number for number in rows if not wanted or number in wanted]
    background = _only(folder, "background")
    rest = [formats.read(background), *(parts[i] for i in parts if i not in chosen)] if background else None
    nothing = scene.select(slice(0, 0))
    before = kinds.selected_rows(file, n)
    return Cut(
        concatenate([nothing, *(parts[i] for i in chosen if i in parts)]),
        concatenate(rest) if rest else None,
        mask_of_rows(np.concatenate([rows[number] for number in chosen]), n),
        None if before is None else mask_of_rows(before, n),
        "" if background else f"'{folder}' holds no background file.",
    )


def _object_files(folder: Path, ids: Sequence[int]) -> dict[int, Path]:
    """Return the splat files of a trim's objects by their ids; those without a single Gaussian have none."""
    if len(ids) == 1 and (only := _only(folder, "object")):
        return {ids[0]: only}
    try:
        entries = {entry["id"]: entry["file"] for entry in read_json(folder / "report.json")["objects"]}
        found = {number: path_inside(folder, str(entries[number])) for number in ids if entries[number]}
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"'{folder}' lacks an object file, or its report.json the names of several.") from error
    return {number: path for number, path in found.items() if path is not None}


def _only(folder: Path, stem: str) -> Path | None:
    """Return the splat file of that name, whatever its format; None if there is none.

    Raises:
        InputError: there are several.
    """
    found = [path for ending in formats.FORMATS if (path := folder / f"{stem}{ending}").is_file()]
    if len(found) > 1:
        names = ", ".join(path.name for path in found)
        raise InputError(f"'{folder}' holds several files of the {stem} ({names}); leave one.")
    return found[0] if found else None
