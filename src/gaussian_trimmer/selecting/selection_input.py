"""A selection from whatever file holds one: a selection file of any kind, with the marks beside it, or marks alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians, check_gaussians
from gaussian_trimmer.rendering import DEFAULT_RENDERER, Renderer
from gaussian_trimmer.selecting.marks import FromFile, Mark
from gaussian_trimmer.selecting.marks_file import is_marks_file, read_marks
from gaussian_trimmer.selecting.saved_selection import excluded_from, note_beside
from gaussian_trimmer.selection_files import SelectionOptions, load_selection
from gaussian_trimmer.selection_files.selection_file import flag

if TYPE_CHECKING:  # most files hold no marks, and need no kernels
    from gaussian_trimmer.selecting.select import SelectionResult


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
    return read_selected_and_removed(path, scene, options, say=say)[0]


def read_selected_and_removed(
    path: str | Path | None,
    scene: Gaussians,
    options: SelectionOptions | None = None,
    further: Sequence[Mark] = (),
    *,
    cameras: CameraSet | None = None,
    camera_path: Path | None = None,
    up: Any = None,
    renderer: Renderer | str = DEFAULT_RENDERER,
    say: Callable[[str], None] = lambda note: None,
) -> tuple[BoolArray, BoolArray, SelectionResult | None]:
    """Return what a file or marks select, what marks removed and a trim keeps out, each (N,), and all that marks say.

    Args:
        path: as for `read_selection`; None: only `further` selects, or everything is selected.
        scene, options, say: as for `read_selection`.
        further: marks that come after the file.
        cameras, camera_path: those that the scene was trained with, and where they came from.
        up: the scene's up vector, (3,), if known.
        renderer: what draws the views of marks.

    Raises:
        InputError: as `read_selection`.
    """
    path, options = None if path is None else Path(path), options or SelectionOptions()
    earlier = read_marks(path) if path is not None and is_marks_file(path) else None
    if earlier is not None and (unused := sorted(options.given())):
        raise InputError(f"'{path}' holds marks and does not use {flag(unused[0])}; leave that out.")
    if earlier is not None or further:
        # Late, since most files hold no marks, and need no kernels.
        from gaussian_trimmer.selecting.select import select
        from gaussian_trimmer.selecting.view_lookup import resolve_views

        if path is not None and earlier is None:
            further = [FromFile(path, options), *further]
        marks = resolve_views(scene, further, cameras=cameras, up=up, camera_path=camera_path)
        marks = marks if earlier is None else earlier.followed_by(marks, camera_path)
        made = select(scene, marks, cameras=cameras, renderer=renderer)
        return made.mask, made.excluded, made
    if path is None:
        return np.ones(len(scene), np.bool_), np.zeros(len(scene), np.bool_), None
    selection, removed = load_selection(path, scene, options, say), excluded_from(path, len(scene))
    beside = path.with_suffix(".json")
    if removed is None:
        if note_beside(path) is not None:
            say(f"{beside} is about another state of {path.name}, so what its marks removed is unknown; select again.")
        return selection, np.zeros(len(scene), np.bool_), None
    if removed.any():
        say(f"{beside}: the {np.count_nonzero(removed):,} Gaussians that its marks removed stay out.")
    if read_marks(beside).have_cuts:
        say(f"An array holds no strokes, so those of {beside} cut nothing; 'select --marks {beside} --trim DIR' cuts.")
    return selection, removed, None
