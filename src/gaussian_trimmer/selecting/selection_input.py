"""A selection from whatever file holds one: a selection file of any kind, with the marks beside it, or marks alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.rendering import DEFAULT_RENDERER, Renderer
from gaussian_trimmer.selecting.marks_file import is_marks_file
from gaussian_trimmer.selecting.saved_selection import excluded_from
from gaussian_trimmer.selection_files import SelectionOptions, load_selection
from gaussian_trimmer.selection_files.options import flag


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
    return read_selected_and_removed(path, scene, options, say=say)[0]


def read_selected_and_removed(
    path: str | Path,
    scene: Gaussians,
    options: SelectionOptions | None = None,
    *,
    cameras: CameraSet | None = None,
    renderer: Renderer | str = DEFAULT_RENDERER,
    say: Callable[[str], None] = lambda note: None,
) -> tuple[BoolArray, BoolArray]:
    """Return which Gaussians a file selects, (N,), and which its marks removed and a trim therefore keeps out, (N,).

    Args:
        path, scene, options, say: as for `read_selection`.
        cameras: those that the scene was trained with, for masks among the marks.
        renderer: what draws the views of marks.

    Raises:
        InputError: as `read_selection`.
    """
    path = Path(path)
    if is_marks_file(path):
        if options is not None and (unused := sorted(options.given())):
            raise InputError(f"'{path}' holds marks and does not use {flag(unused[0])}; leave that out.")
        from gaussian_trimmer.selecting.select import select  # most files hold no marks, and need no kernels

        made = select(scene, path, cameras=cameras, renderer=renderer)
        return made.mask, made.excluded
    selection, removed = load_selection(path, scene, options, say), excluded_from(path, len(scene))
    if removed is None:
        return selection, np.zeros(len(scene), np.bool_)
    if removed.any():
        kept_out = f"the {np.count_nonzero(removed):,} Gaussians that its marks removed stay out"
        say(f"{path.with_suffix('.json')}: {kept_out}.")
    return selection, removed
