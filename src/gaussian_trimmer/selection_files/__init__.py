"""Selections of one object, from any tool or method: which rows of the scene are the object.

The container of a file is told by its ending, what it means by its content.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.io.reading import is_folder
from gaussian_trimmer.selection_files.kinds import KINDS, offered_kinds
from gaussian_trimmer.selection_files.method_files import selection_in
from gaussian_trimmer.selection_files.options import Kind, SelectionOptions, flag
from gaussian_trimmer.selection_files.selection_file import SelectionFile, open_selection
from gaussian_trimmer.settings import check_settings

__all__ = ["KINDS", "Kind", "SelectionOptions", "arrays_that_select", "load_selection", "offered_kinds"]


@np.errstate(over="ignore", invalid="ignore")  # what damaged numbers become is found where they are used
def load_selection(
    path: str | Path,
    gaussians: Gaussians,
    options: SelectionOptions | None = None,
    say: Callable[[str], None] = lambda note: None,
) -> BoolArray:
    """Return which Gaussians of the scene a selection file means, (N,); at least one.

    Args:
        path: the file, or a folder in which a method left one.
        gaussians: the scene.
        options: how the file is read.
        say: called with what a user should know of how the file was understood, such as rows that matched nothing.

    Raises:
        InputError: an option is not possible, or the file cannot be read, does not fit the scene or the options, could
            be of several kinds, or selects nothing.
    """
    path, options = Path(path), options or SelectionOptions()
    check_settings(options, "selection")
    if is_folder(path):
        path = selection_in(path)
        say(f"selection: {path}")
    file = open_selection(path, len(gaussians))
    name = options.kind if options.kind != "auto" else _detect(file, len(gaussians), options)
    select, understood = KINDS[name]
    if unused := sorted(options.given() - set(understood)):
        raise InputError(
            f"'{path.name}' is read as a selection of the kind '{name}', which does not use "
            f"{', '.join(map(flag, unused))}; leave that out or choose another kind with {flag('kind')}."
        )
    selection = select(file, gaussians, options)
    for note in file.notes:
        say(f"{path.name}: {note}")
    if not selection.any():
        raise InputError(f"'{path.name}', read as the kind '{name}', selects none of the {len(gaussians)} Gaussians.")
    return selection


def arrays_that_select(file: SelectionFile, n: int, options: SelectionOptions) -> list[str]:
    """Return the names of the arrays of a file that select from a scene of n Gaussians once they are named."""
    return [name for name in file.arrays if name and offered_kinds(file, n, replace(options, property=name))]


def _detect(file: SelectionFile, n: int, options: SelectionOptions) -> str:
    kinds = offered_kinds(file, n, options)
    if len(kinds) > 1:
        raise InputError(
            f"'{file.path.name}' can be read as {' or as '.join(kinds)}; say which with {flag('kind')} {kinds[0]}."
        )
    if not kinds:
        names = arrays_that_select(file, n, options)
        choose = f"; name an array, such as {flag('property')} {names[0]}" if names else ""
        raise InputError(
            f"'{file.path.name}' with {file.content} is not a selection for {n} Gaussians with these options{choose}."
        )
    return kinds[0]
