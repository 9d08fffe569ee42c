"""Coarse selections of one object, from any tool or method: which rows of the scene are the object.

The container of a file is told by its ending, what it means by its content. Every kind is one module with

- `OPTIONS`: the options that it understands,
- `offers(file, n, options)`: whether the file can be of this kind for a scene of n Gaussians,
- `select(file, gaussians, options)`: the selection, (N,).
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Protocol, cast

from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.selection_files.options import Kind, SelectionOptions, flag
from gaussian_trimmer.selection_files.selection_file import SelectionFile, open_selection
from gaussian_trimmer.settings import check_settings

__all__ = ["KINDS", "Kind", "SelectionOptions", "load_selection", "offered_kinds"]

KINDS = {
    "mask": "gaussian_trimmer.selection_files.mask",
    "labels": "gaussian_trimmer.selection_files.labels",
    "indices": "gaussian_trimmer.selection_files.indices",
    "subset": "gaussian_trimmer.selection_files.subset",
    "property": "gaussian_trimmer.selection_files.splat_property",
    "classifier": "gaussian_trimmer.selection_files.classifier",
    "similarity": "gaussian_trimmer.selection_files.similarity",
    "clusters": "gaussian_trimmer.selection_files.clusters",
    "checkpoint": "gaussian_trimmer.selection_files.checkpoint",
    "flashsplat": "gaussian_trimmer.selection_files.flashsplat",
    "trimmed": "gaussian_trimmer.selection_files.trimmed",
}
_LISTED = 12


class SelectionKind(Protocol):
    """What the module of a kind has."""

    OPTIONS: frozenset[str]

    def offers(self, file: SelectionFile, n: int, options: SelectionOptions) -> bool:
        """Whether the file can be of this kind for a scene of n Gaussians."""
        ...

    def select(self, file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
        """The selection, (N,)."""
        ...


def load_selection(
    path: str | Path, gaussians: Gaussians, options: SelectionOptions | None = None,
    say: Callable[[str], None] = lambda note: None,
) -> BoolArray:  # fmt: skip
    """Which Gaussians of the scene a selection file means, (N,); at least one.

    Args:
        say: called with what a user should know of how the file was understood, such as rows that matched nothing.

    Raises:
        InputError: an option is not possible, or the file cannot be read, does not fit the scene or the options, could
            be of several kinds, or selects nothing.
    """
    path, options = Path(path), options or SelectionOptions()
    check_settings(options, "selection")
    file = open_selection(path, len(gaussians))
    kind = options.kind if options.kind != "auto" else _detect(file, len(gaussians), options)
    module = _module(kind)
    if unused := sorted(options.given() - module.OPTIONS):
        raise InputError(
            f"'{path.name}' is read as a selection of the kind '{kind}', which has no use for "
            f"{', '.join(map(flag, unused))}; leave that out or choose another kind with {flag('kind')}."
        )
    selection = module.select(file, gaussians, options)
    for note in file.notes:
        say(f"{path.name}: {note}")
    if not selection.any():
        raise InputError(f"'{path.name}', read as the kind '{kind}', selects none of the {len(gaussians)} Gaussians.")
    return selection


def offered_kinds(file: SelectionFile, n: int, options: SelectionOptions) -> list[str]:
    """The kinds that a file can be of, for a scene of n Gaussians; what the program wrote is that and nothing else."""
    if _module("trimmed").offers(file, n, options):
        return ["trimmed"]
    return [kind for kind in KINDS if _module(kind).offers(file, n, options)]


def _detect(file: SelectionFile, n: int, options: SelectionOptions) -> str:
    kinds = offered_kinds(file, n, options)
    if len(kinds) > 1:
        raise InputError(
            f"'{file.path.name}' can be read as {' or as '.join(kinds)}; say which with {flag('kind')} {kinds[0]}."
        )
    if not kinds:
        raise InputError(f"'{file.path.name}' {_content(file)} is no selection for {n} Gaussians with these options.")
    return kinds[0]


def _content(file: SelectionFile) -> str:
    if not file.arrays:
        return "with splats" if file.rows is not None else "with a checkpoint"
    listed = list(file.arrays.items())[:_LISTED]
    arrays = [f"{shown(name) or 'one'}: {array.dtype} {array.shape}" for name, array in listed]
    more = f"; and {len(file.arrays) - _LISTED} more" if len(file.arrays) > _LISTED else ""
    return f"with the arrays ({'; '.join(arrays)}{more})"


def _module(kind: str) -> SelectionKind:
    if kind not in KINDS:
        raise InputError(f"Unknown kind of selection '{kind}'; available: auto, {', '.join(KINDS)}.")
    return cast(SelectionKind, import_module(KINDS[kind]))
