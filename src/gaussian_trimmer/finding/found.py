"""What finding the objects of a scene returns, and which of them are wanted."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Point, Viewpoint
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians, IntArray, mask_of_rows
from gaussian_trimmer.surface.regions import split_region
from gaussian_trimmer.surface.visible_surface import VisibleSurface, find_visible_surface, views_of, with_hidden
from gaussian_trimmer.trimming.up_vector import UpVector

SURE = 0.5
"""How sure the program must be of an object, from 0 to 1, so that it is trimmed unless it is taken out."""


@dataclass(frozen=True, eq=False)
class FoundObject:
    """One object, or one surface of the room."""

    region: int | None
    """Number of the region; None for a surface of the room."""
    shown: float
    """Share of the views' pixels that it fills."""
    seen: float
    """Share of the views in which it is seen well."""
    view: int
    """Number of the view that shows it best."""
    centre: Float64Array
    """Middle of its box, in the scene's coordinates, (3,)."""
    size: Float64Array
    """Length along both horizontal axes of the frame and height of its box, in scene units, (3,)."""
    confidence: float
    """How sure it is that this is one object, 0 to 1."""
    rests_on: str
    """What it rests on, in words; empty if nothing was found."""
    doubts: tuple[str, ...]
    """Why it may be no object; there are some if and only if it is unsure."""
    id: int = 0
    """Its number among the labels, from 1; 0 while it is a candidate."""
    gaussians: int = 0
    """Number of its Gaussians."""
    colour: Point = (0.0, 0.0, 0.0)
    """Its mean colour, 0 to 1."""

    @property
    def sure(self) -> bool:
        """Whether it is trimmed unless it is taken out."""
        return self.confidence >= SURE

    @property
    def why(self) -> str:
        """What it rests on and, if it is unsure, why."""
        return ", ".join(text for text in (self.rests_on, *self.doubts) if text)

    @property
    def kind(self) -> str:
        """`object`, or `surface` for a table top, floor or wall."""
        return "surface" if self.region is None else "object"


@dataclass(frozen=True, eq=False)
class FoundObjects:
    """The objects of a scene of N Gaussians, the sure ones first."""

    scene: Gaussians
    labels: IntArray
    """Number of the object that each Gaussian belongs to, 0 for the rest, (N,)."""
    objects: tuple[FoundObject, ...]
    views: tuple[Viewpoint, ...]
    """Where the scene was looked at from."""
    looked_at: BoolArray
    """Which Gaussians were looked at, (N,): all but the ceiling and what is above head height below one."""
    up: UpVector
    seconds: Mapping[str, float]
    """Time taken by each step."""
    surface: VisibleSurface | None = None
    """What shows of the scene; None if it was looked at in tiles."""

    def __repr__(self) -> str:
        sure = sum(found.sure for found in self.objects)
        return f"<FoundObjects: {sure} sure, {len(self.objects) - sure} unsure, of {len(self.scene):,} Gaussians>"

    def __len__(self) -> int:
        return len(self.objects)

    def __iter__(self) -> Iterator[FoundObject]:
        return iter(self.objects)

    def mask(self, number: int) -> BoolArray:
        """Return which Gaussians one object has, (N,).

        Raises:
            InputError: there is no object of that number.
        """
        if number not in {found.id for found in self.objects}:
            raise InputError(f"There is no object {number}; there are {len(self.objects)}, numbered from 1.")
        return np.asarray(self.labels == number)

    def selections(self, *, unsure: bool = False) -> dict[int, IntArray]:
        """Return the rows of the objects, ascending, by their numbers, as `trim_objects` takes them.

        Args:
            unsure: with the objects that the program is not sure of.
        """
        rows = np.argsort(self.labels, kind="stable")
        ends = np.searchsorted(self.labels[rows], np.arange(len(self.objects) + 2))
        return {one.id: rows[ends[one.id] : ends[one.id + 1]] for one in self.objects if one.sure or unsure}


def chosen_objects(
    found: FoundObjects,
    *,
    keep: Sequence[int] | None = None,
    merge: Iterable[Sequence[int]] = (),
    split: Iterable[int] = (),
    names: Mapping[int, str] | None = None,
) -> dict[str, IntArray]:
    """Return the rows, ascending, of the objects that are wanted, by their names, as `trim_objects` takes them.

    Args:
        found: the objects.
        keep: numbers of those that are wanted; without it, the sure ones.
        merge: numbers of objects that are one.
        split: numbers of objects that are several; each falls apart into its main parts, named 3a, 3b and so on.
        names: what to call objects; else by their numbers.

    Raises:
        InputError: a number is none of an object, or two objects have the same name, or none is left.
    """
    names, merge = names or {}, list(merge)
    kept = list(keep) if keep is not None else [one.id for one in found if one.sure and one.kind == "object"]
    rows = found.selections(unsure=True)
    if unknown := sorted({*kept, *(number for group in merge for number in group)} - rows.keys()):
        raise InputError(f"There is no object {unknown[0]}; there are {len(found)}, numbered from 1.")
    wanted = {number: rows[number] for number in kept}
    for group in merge:
        first = next((number for number in group if number in wanted), group[0])
        for number in group:
            wanted.pop(number, None)
        wanted[first] = np.unique(np.concatenate([rows[number] for number in group]))
    selections: dict[str, IntArray] = {}
    several = set(split)
    for number in sorted(wanted):
        name = names.get(number, str(number))
        parts = _parts(found, wanted[number]) if number in several else [wanted[number]]
        if number in several and len(parts) == 1:
            raise InputError(f"Object {number} does not fall apart; select its parts by clicks or boxes: select SCENE.")
        for place, part in enumerate(parts):
            key = name + (chr(ord("a") + place) if len(parts) > 1 else "")
            if key in selections:
                raise InputError(f"Two objects are called '{key}'; give each another name.")
            selections[key] = part
    if not selections:
        raise InputError("No object is left; name those to keep, as in --keep 1 or keep=[1].")
    return selections


def _parts(found: FoundObjects, rows: IntArray) -> list[IntArray]:
    """Return rows of an object's main parts; an object of a large capture is looked at by itself for that."""
    surface, mask = found.surface, mask_of_rows(rows, len(found.scene))
    if surface is not None:
        numbers: IntArray = split_region(surface, mask[surface.rows])
        labels = with_hidden(surface, numbers + 1, np.inf, np.arange(len(mask)))[rows]
    else:
        scene, up = found.scene.select(rows), found.up.direction
        surface = find_visible_surface(scene, views_of(scene, None, up), up)
        numbers = split_region(surface, np.ones(len(surface.rows), np.bool_))
        labels = with_hidden(surface, numbers + 1, np.inf, np.arange(len(scene)))
    return [rows[labels == number] for number in range(1, int(numbers.max()) + 2)]
