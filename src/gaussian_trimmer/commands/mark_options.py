"""Marks on the command line: clicks, boxes, volumes and files, in the order in which they are given."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.options import Ordered, arg
from gaussian_trimmer.selecting.marks import Box, Box3D, Click, Effect, FromFile, Grow, Mark, Shrink, Sphere
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import Range

_Number = Annotated[float, Range(-1e30, 1e30)]
_Pixel = tuple[int, int]
_PixelBox = tuple[int, int, int, int]
_Four = tuple[_Number, _Number, _Number, _Number]
_Six = tuple[_Number, _Number, _Number, _Number, _Number, _Number]
_Spacings = Annotated[float, Range(0.01, 1000)]
_IDS = re.compile(r"(?P<path>.+)#(?P<ids>-?\d+(?:,-?\d+)*)")
_EFFECTS: dict[str, Effect] = {"": "add", "remove": "remove", "intersect": "intersect"}
_FILE_EFFECTS: dict[str, Effect] = {"add": "add", "subtract": "remove", "intersect": "intersect"}


@dataclass(frozen=True)
class MarkOptions:
    """What to select. Marks apply in the order given: each adds, removes, or keeps only what it means."""

    view: Annotated[Ordered[str], arg(metavar="NAME")] = ()
    """View of the clicks and boxes that follow, by the name of its picture. The ending may be left out, and a number
    is understood. May be repeated; a single one may also follow them."""
    view_index: Annotated[Ordered[int], arg(metavar="INT")] = ()
    """The same by its number, from 0."""
    click: Annotated[Ordered[_Pixel], arg(metavar="X Y")] = ()
    """Pixel on the object, from the left and the top. Once something is selected, a pixel in the middle of what is
    missing. May be repeated, as all marks."""
    remove_click: Annotated[Ordered[_Pixel], arg(metavar="X Y")] = ()
    """Pixel in the middle of what is selected but should not be."""
    box: Annotated[Ordered[_PixelBox], arg(metavar="X0 Y0 X1 Y1")] = ()
    """Box around the object: left, top, right, bottom."""
    remove_box: Annotated[Ordered[_PixelBox], arg(metavar="X0 Y0 X1 Y1")] = ()
    """Box around what should not be selected."""
    box3d: Annotated[Ordered[_Six], arg(metavar="X0 Y0 Z0 X1 Y1 Z1")] = ()
    """Select everything inside this box."""
    remove_box3d: Annotated[Ordered[_Six], arg(metavar="X0 Y0 Z0 X1 Y1 Z1")] = ()
    """Deselect everything inside this box."""
    intersect_box3d: Annotated[Ordered[_Six], arg(metavar="X0 Y0 Z0 X1 Y1 Z1")] = ()
    """Deselect everything outside this box."""
    sphere: Annotated[Ordered[_Four], arg(metavar="X Y Z RADIUS")] = ()
    """Select everything inside this ball."""
    remove_sphere: Annotated[Ordered[_Four], arg(metavar="X Y Z RADIUS")] = ()
    """Deselect everything inside this ball."""
    intersect_sphere: Annotated[Ordered[_Four], arg(metavar="X Y Z RADIUS")] = ()
    """Deselect everything outside this ball."""
    coordinates: Literal["scene", "up"] = "scene"
    """Coordinates of 3D boxes and balls: the scene's own, or turned so that z is up."""
    add: Annotated[Ordered[str], arg(metavar="FILE[#ID,...]")] = ()
    """Add what a selection file of any kind selects; #ID picks objects in it."""
    subtract: Annotated[Ordered[str], arg(metavar="FILE[#ID,...]")] = ()
    """Take away what a selection file selects."""
    intersect: Annotated[Ordered[str], arg(metavar="FILE[#ID,...]")] = ()
    """Keep only what a selection file selects."""
    grow: Annotated[Ordered[_Spacings], arg(metavar="SPACINGS")] = ()
    """Add what lies this near to the selection, in median distances between its neighbouring Gaussians."""
    shrink: Annotated[Ordered[_Spacings], arg(metavar="SPACINGS")] = ()
    """Take away what lies this near to Gaussians that are not selected."""
    given: Annotated[tuple[tuple[str, Any], ...], arg(order=True)] = ()
    """Names and values of all views and marks, in the order in which they were given."""

    def marks(self) -> list[Mark]:
        """The marks, in order; views by name or number.

        Raises:
            InputError: a click or a box has no view, or it is not clear which.
        """
        single: list[str | int] = [*self.view, *self.view_index]
        current: str | int | None = single[0] if len(single) == 1 else None
        marks: list[Mark] = []
        for name, value in self.given:
            if name in ("view", "view_index"):
                current = value
            else:
                marks.append(self._mark(name, value, current))
        return marks

    @property
    def files(self) -> list[Path]:
        """Selection files that are combined."""
        return [_file(text)[0] for text in (*self.add, *self.subtract, *self.intersect)]

    def _mark(self, name: str, value: Any, view: str | int | None) -> Mark:
        if name in _FILE_EFFECTS:
            path, ids = _file(value)
            return FromFile(path, SelectionOptions(object_id=ids), _FILE_EFFECTS[name])
        if name in ("grow", "shrink"):
            return Grow(value) if name == "grow" else Shrink(value)
        prefix, _, kind = name.rpartition("_")
        effect = _EFFECTS[prefix]
        if kind == "box3d":
            return Box3D(value[:3], value[3:], self.coordinates, effect)
        if kind == "sphere":
            return Sphere(value[:3], value[3], self.coordinates, effect)
        if view is None:
            if self.view or self.view_index:
                raise InputError(
                    f"A {kind} comes before the first of several views; name its view before it: --view NAME."
                )
            raise InputError("Name the view of the pixels: --view NAME or --view-index INT (see --list-views DIR).")
        if kind == "click":
            x, y = value
            return Click(x, y, view, effect)
        x0, y0, x1, y1 = value
        return Box(x0, y0, x1, y1, view, effect)


def _file(text: str) -> tuple[Path, tuple[int, ...]]:
    """A path, and the ids behind the # at its end; a # that is part of an existing file's name stays in it."""
    found = _IDS.fullmatch(text)
    if found is None or Path(text).exists():
        return Path(text), ()
    return Path(found["path"]), tuple(map(int, found["ids"].split(",")))
