"""A selection from whatever file holds one: a selection file of any kind, or marks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import BoolArray, Gaussians, check_gaussians
from gaussian_trimmer.selecting.marks import FromFile, Mark, read_marks
from gaussian_trimmer.selecting.selection import Selection
from gaussian_trimmer.selection_files import SelectionOptions, load_selection
from gaussian_trimmer.selection_files.selection_file import flag


def read_selection(
    path: str | Path,
    scene: Gaussians,
    options: SelectionOptions | None = None,
    say: Callable[[str], None] = lambda note: None,
) -> BoolArray:
    """Return which Gaussians of the scene a file selects, (N,); at least one.

    Args:
        path: a selection file of any kind, a folder in which a method left one, or marks saved as .json.
        scene: the scene, of N Gaussians.
        options: how a selection file is read.
        say: called with what a user should know of how the file was understood, such as rows that matched nothing.

    Raises:
        InputError: an option is not possible, or the file cannot be read, does not fit the scene or the options, could
            be of several kinds, or selects nothing.
    """
    check_gaussians(scene)
    return read_selection_result(path, scene, options, say=say).mask


def read_selection_result(
    path: str | Path | None,
    scene: Gaussians,
    options: SelectionOptions | None = None,
    further: Sequence[Mark] = (),
    *,
    cameras: CameraSet | None = None,
    camera_path: Path | None = None,
    up: Any = None,
    say: Callable[[str], None] = lambda note: None,
) -> Selection:
    """Return what a file or marks select, with all that marks say of it.

    Args:
        path: as for `read_selection`; None: only `further` selects, or everything is selected.
        scene, options, say: as for `read_selection`.
        further: marks that come after the file.
        cameras, camera_path: those that the scene was trained with, and where they came from.
        up: the scene's up vector, (3,), if known.

    Raises:
        InputError: as `read_selection`.
    """
    path, options = None if path is None else Path(path), options or SelectionOptions()
    earlier = read_marks(path) if path is not None and identify(path).kind == "marks" else None
    if earlier is not None and (unused := sorted(options.given())):
        raise InputError(f"'{path}' holds marks and does not use {flag(unused[0])}; leave that out.")
    if earlier is not None or further:
        # Late, since most files hold no marks, and need no kernels.
        from gaussian_trimmer.selecting.select import resolve_views, select

        if path is not None and earlier is None:
            further = [FromFile(path, options), *further]
        marks = resolve_views(scene, further, cameras=cameras, up=up, camera_path=camera_path)
        marks = marks if earlier is None else earlier.followed_by(marks, camera_path)
        return select(scene, marks, cameras=cameras)
    if path is None:
        return Selection(np.ones(len(scene), np.bool_))
    with suppress(InputError):
        if identify(beside := path.with_suffix(".json")).kind == "marks" and read_marks(beside).exclude:
            say(f"{path.name} does not say what its marks removed; give {beside} as the selection to keep that out.")
    return Selection(load_selection(path, scene, options, say))
