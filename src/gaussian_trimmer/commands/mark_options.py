"""Marks on the command line: clicks, boxes and selection files, in the order in which they are given."""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.parser import Parser
from gaussian_trimmer.selecting.marks import Box, Click, Effect, FromFile, Grow, Mark, Shrink
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import Range

_Spacings = Annotated[float, Range(0.01, 1000)]
_IDS = re.compile(r"(?P<path>.+)#(?P<ids>-?\d+(?:,-?\d+)*)")
_VIEWS = ("view", "view_index")
_PIXELS = ("click", "remove_click", "box", "remove_box")
_EFFECTS: dict[str, Effect] = {"add": "add", "subtract": "remove", "intersect": "intersect"}
_OPTIONS: tuple[tuple[str, Any, str, str], ...] = (
    ("--view", str, "NAME", "View of the clicks and boxes that follow, by the name or number of its picture"),
    ("--view-index", int, "INT", "The same by its number, from 0"),
    ("--click", tuple[int, int], "X Y", "Pixel on the object, or in the middle of what is missing"),
    ("--remove-click", tuple[int, int], "X Y", "Pixel in the middle of what is selected but should not be"),
    ("--box", tuple[int, int, int, int], "X0 Y0 X1 Y1", "Box around the object: left, top, right, bottom"),
    ("--remove-box", tuple[int, int, int, int], "X0 Y0 X1 Y1", "Box around what should not be selected"),
    ("--add", str, "FILE[#ID,...]", "Add what a selection file of any kind selects; #ID picks objects in it"),
    ("--subtract", str, "FILE[#ID,...]", "Take away what a selection file selects"),
    ("--intersect", str, "FILE[#ID,...]", "Keep only what a selection file selects"),
    ("--grow", _Spacings, "SPACINGS", "Add what lies this near to the selection, in distances between neighbours"),
    ("--shrink", _Spacings, "SPACINGS", "Take away what lies this near to what is not selected"),
)


def add_marks(parser: Parser, *, rare: bool = False) -> None:
    """Add what to select. Marks apply in the order given, and each may be repeated."""
    group = parser.add_argument_group("marks, in any number and order")
    for flag, kind, metavar, help in _OPTIONS:
        group.add_argument(flag, action="mark", kind=kind, metavar=metavar, help=help, rare=rare)


def marks_of(arguments: Namespace) -> list[Mark]:
    """Return the marks, in order; views by name or number. A single view may also follow its pixels.

    Raises:
        InputError: a click or a box has no view, or a view has neither.
    """
    names, views = [name for name, _ in arguments.in_order], views_of(arguments)
    if views and not set(names) & set(_PIXELS) and "selection.query-point" not in arguments.settings:
        raise InputError(
            "--view names the picture of a --click or --box, and there is none; leave it out. The number of virtual "
            "views is --views."
        )
    for name, following in pairwise([*names, "view"] if len(views) > 1 else ()):
        if name in _VIEWS and following in _VIEWS:
            raise InputError("A view has no --click or --box after it, before the next one; leave it out.")
    current, marks = views[0] if len(views) == 1 else None, list[Mark]()
    for name, value in arguments.in_order:
        if name in _VIEWS:
            current = value
        elif name in _EFFECTS:
            path, ids = _file(value)
            marks.append(FromFile(path, SelectionOptions(object_id=ids), _EFFECTS[name]))
        elif name in ("grow", "shrink"):
            marks.append(Grow(value) if name == "grow" else Shrink(value))
        elif current is None and views:
            kind = name.rpartition("_")[2]
            raise InputError(f"A {kind} comes before the first of several views; name its view before it: --view NAME.")
        elif current is None:
            raise InputError("Name the view of the pixels: --view NAME or --view-index INT (see --list-views DIR).")
        else:
            mark: Any = Click if name.endswith("click") else Box
            marks.append(mark(*value, current, "remove" if name.startswith("remove") else "add"))
    return marks


def views_of(arguments: Namespace) -> list[str | int]:
    """Return the views that are named, in order."""
    return [value for name, value in arguments.in_order if name in _VIEWS]


def mark_files(arguments: Namespace) -> Iterator[Path]:
    """Yield the selection files that are combined."""
    return (_file(value)[0] for name, value in arguments.in_order if name in _EFFECTS)


def _file(text: str) -> tuple[Path, tuple[int, ...]]:
    """Return a path, and the ids behind the # at its end; a # that is part of an existing file's name stays in it."""
    found = _IDS.fullmatch(text)
    if found is None or Path(text).exists():
        return Path(text), ()
    return Path(found["path"]), tuple(map(int, found["ids"].split(",")))
