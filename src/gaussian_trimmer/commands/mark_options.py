"""Marks on the command line: clicks, boxes, volumes and files, in the order in which they are given."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Suppress, UseAppendAction, arg

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.selecting.marks import Box, Box3D, Click, Effect, FromFile, Grow, Mark, Plane, Shrink, Sphere
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
    """What to select, each on top of what was said before it: marks add, remove, or keep only what they mean."""

    view: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="NAME")] = ()
    """The view of the clicks and boxes that follow: the name of a picture of --cameras, with or without its ending, or
    a number. May be repeated; a single one may also follow them."""
    view_index: Annotated[UseAppendAction[tuple[int, ...]], arg(metavar="INT")] = ()
    """The same by the view's number, from 0."""
    click: Annotated[UseAppendAction[tuple[_Pixel, ...]], arg(metavar="X Y")] = ()
    """A pixel on the object, counted from the left and the top; once something is selected, one in the middle of what
    is missing. May be repeated, as all marks."""
    remove_click: Annotated[UseAppendAction[tuple[_Pixel, ...]], arg(metavar="X Y")] = ()
    """A pixel in the middle of what is selected and should not be."""
    box: Annotated[UseAppendAction[tuple[_PixelBox, ...]], arg(metavar="X0 Y0 X1 Y1")] = ()
    """Left, top, right and bottom of a box around the object."""
    remove_box: Annotated[UseAppendAction[tuple[_PixelBox, ...]], arg(metavar="X0 Y0 X1 Y1")] = ()
    """A box around what should not be selected."""
    box3d: Annotated[UseAppendAction[tuple[_Six, ...]], arg(metavar="X0 Y0 Z0 X1 Y1 Z1")] = ()
    """Everything between two corners."""
    remove_box3d: Annotated[UseAppendAction[tuple[_Six, ...]], arg(metavar="X0 Y0 Z0 X1 Y1 Z1")] = ()
    """Deselect everything inside this box."""
    intersect_box3d: Annotated[UseAppendAction[tuple[_Six, ...]], arg(metavar="X0 Y0 Z0 X1 Y1 Z1")] = ()
    """Only what is between two corners."""
    sphere: Annotated[UseAppendAction[tuple[_Four, ...]], arg(metavar="X Y Z RADIUS")] = ()
    """Everything in a ball."""
    remove_sphere: Annotated[UseAppendAction[tuple[_Four, ...]], arg(metavar="X Y Z RADIUS")] = ()
    """Deselect everything inside this ball."""
    intersect_sphere: Annotated[UseAppendAction[tuple[_Four, ...]], arg(metavar="X Y Z RADIUS")] = ()
    """Only what is in a ball."""
    plane: Annotated[UseAppendAction[tuple[_Four, ...]], arg(metavar="NX NY NZ OFFSET")] = ()
    """Everything above a plane: points p with N . p > OFFSET. With --coordinates up, 0 0 1 H is all above height H."""
    remove_plane: Annotated[UseAppendAction[tuple[_Four, ...]], arg(metavar="NX NY NZ OFFSET")] = ()
    """Deselect everything above this plane."""
    intersect_plane: Annotated[UseAppendAction[tuple[_Four, ...]], arg(metavar="NX NY NZ OFFSET")] = ()
    """Only what is above a plane."""
    coordinates: Literal["scene", "up"] = "scene"
    """Coordinates of boxes in 3D, balls and planes: the scene's own, or turned so that z is up."""
    add: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="FILE[#ID,...]")] = ()
    """Also what a selection file of any kind selects; ids of its objects stand behind a #."""
    subtract: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="FILE[#ID,...]")] = ()
    """Without what a selection file selects."""
    intersect: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="FILE[#ID,...]")] = ()
    """Only what a selection file selects."""
    grow: Annotated[UseAppendAction[tuple[_Spacings, ...]], arg(metavar="SPACINGS")] = ()
    """Also take what lies this near, in median distances between neighbouring Gaussians of the selection."""
    shrink: Annotated[UseAppendAction[tuple[_Spacings, ...]], arg(metavar="SPACINGS")] = ()
    """Leave out what lies this near to Gaussians that are not selected."""
    given: Suppress[tuple[tuple[str, Any], ...]] = ()
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
        if kind == "plane":
            return Plane(value[:3], value[3], self.coordinates, effect)
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
