"""Which regions of the visible surface are objects, how sure that is, and which of the found ones are wanted."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from gaussian_trimmer.cameras import Point, Viewpoint
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians, IntArray, mask_of_rows
from gaussian_trimmer.settings import Range, Share
from gaussian_trimmer.surface.regions import FILLED, MIN_AREA, split_region
from gaussian_trimmer.surface.room_surfaces import Room, RoomSurface
from gaussian_trimmer.surface.visible_surface import (
    VisibleSurface,
    find_visible_surface,
    seen_share,
    views_of,
    with_hidden,
)
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


MIN_SHARE_AT_ALL = 0.1
"""What shows less than this, relative to a sure object, is not named."""
DOUBTFUL = 0.4
"""Confidence in what has no surface under it, or carries a surface of the room, at most."""
_MIN_INSIDE = 0.95
"""Share of a region that must lie within the pictures, in scenes that fill them and have no floor."""
_MIN_SHARE_OF_LARGEST = 0.1
"""What shows less than this share of the largest object is a fragment of it, where there is no room."""
_NEARLY_ALL = 0.9
"""What shows more than this share of all, where there is no room, may be several things on one another."""
_CARRYING = 0.1
"""Share of a region close below a surface of the room from which on it carries it, as the legs of a table."""
_END_QUANTILES = (0.02, 0.98)


@dataclass(frozen=True)
class FindConfig:
    """What counts as an object."""

    min_shown: Share = 0.005
    """Smallest share of the views' pixels that an object must fill to be sure."""
    min_seen: Share = 0.5
    """Smallest share of the views in which it must be seen well, relative to what is seen in most."""
    max_size: Annotated[float, Range(0.1, 100)] = 1.25
    """Largest length of an object, relative to what a picture's longer side spans at the usual depth."""
    parts: bool = False
    """Also name the parts of things, such as the cushions of a sofa; the thing is then what is left of it. Only in
    captures that are looked at in tiles."""
    surfaces: bool = False
    """Also name the surfaces of the room: table tops, floors and walls; not in captures that are looked at in tiles."""


def name_objects(
    surface: VisibleSurface, room: Room, regions: IntArray, config: FindConfig
) -> tuple[list[FoundObject], IntArray]:
    """Choose the objects among the regions; return them and the number of that of each Gaussian, from 1, 0: none, (S,).

    Args:
        surface: what shows of the scene, S Gaussians.
        room: its flat surfaces.
        regions: as `find_regions` gives them, (S,).
        config: what counts as an object.
    """
    found = objects_among(surface, room, regions, config)
    numbers = np.zeros(len(surface.rows), np.int64)
    for number, thing in enumerate(found, 1):
        numbers[regions == thing.region] = number
    if config.surfaces:
        for one in room.surfaces:
            rows = one.own & (regions < 0) & (numbers == 0)
            if rows.any():
                found.append(surface_as_object(surface, one, rows))
                numbers[rows] = len(found)
    return found, numbers


def objects_among(surface: VisibleSurface, room: Room, regions: IntArray, config: FindConfig) -> list[FoundObject]:
    """Return the regions that are objects, the sure ones first, then those that show most.

    Args:
        regions: as `find_regions` gives them, (S,).
        config: what counts.
    """
    free = regions >= 0
    areas = np.bincount(regions[free], surface.areas[free])
    total = surface.shown.sum(axis=0)
    shown = np.bincount(regions[free], total[free]) / max(float(total.sum()), 1e-12)
    candidates = np.flatnonzero((areas > MIN_AREA) & (shown > MIN_SHARE_AT_ALL * config.min_shown))
    order = np.argsort(regions, kind="stable")
    ends = np.searchsorted(regions[order], np.arange(len(areas) + 1))
    members = {number: order[ends[number] : ends[number + 1]] for number in candidates.tolist()}
    by_view = {number: surface.shown[:, rows].sum(axis=1) for number, rows in members.items()}
    seen = {number: seen_share(shares) for number, shares in by_view.items()}
    most = max(seen.values(), default=1.0)
    of_largest = 0.0 if room.has_floor else _MIN_SHARE_OF_LARGEST * float(shown.max(initial=0.0))
    least = max(config.min_shown, of_largest)
    found = []
    for number, rows in members.items():
        low, high = np.quantile(surface.points[rows], _END_QUANTILES, axis=0)
        length = float((high - low).max()) / 2
        ratios = {
            "small": float(shown[number]) / max(least, 1e-12),
            "seen in few views": seen[number] / max(config.min_seen * most, 1e-12),
            "larger than a picture": config.max_size / max(length, 1e-12),
        }
        confidence = min(ratio / (1 + ratio) for ratio in ratios.values())
        doubts = [name for name, ratio in ratios.items() if ratio < 1]
        rests_on = _rests_on(surface, room, rows)
        if surface.areas[rows[room.under[rows]]].sum() > _CARRYING * surface.areas[rows].sum():
            confidence, doubts = min(confidence, DOUBTFUL), ["is under a surface", *doubts]
        if not room.has_floor and surface.filled > FILLED and surface.inside[rows].mean() < _MIN_INSIDE:
            confidence, doubts = min(confidence, DOUBTFUL), ["goes on beyond the pictures", *doubts]
        if not room.has_floor and shown[number] > _NEARLY_ALL:
            confidence, doubts = min(confidence, DOUBTFUL), ["is nearly the whole scene; click on parts", *doubts]
        if not rests_on:
            confidence, doubts = min(confidence, DOUBTFUL), ["no surface was found under it", *doubts]
        view, box, said = int(np.argmax(by_view[number])), surface.box_in_scene(low, high), tuple(doubts)
        found.append(FoundObject(number, float(shown[number]), seen[number], view, *box, confidence, rests_on, said))
    return sorted(found, key=lambda one: (not one.sure, -one.shown))


def surface_as_object(surface: VisibleSurface, one: RoomSurface, rows: BoolArray) -> FoundObject:
    """Return what is said of a surface of the room.

    Args:
        one: the surface.
        rows: which Gaussians of the visible surface are left to it, (S,).
    """
    by_view = surface.shown[:, rows].sum(axis=1)
    shown = float(by_view.sum()) / max(float(surface.shown.sum()), 1e-12)
    box = surface.box_in_scene(surface.points[rows].min(axis=0), surface.points[rows].max(axis=0))
    what = "a table top, floor or shelf" if one.horizontal else "a wall"
    return FoundObject(None, shown, seen_share(by_view), int(np.argmax(by_view)), *box, 1.0, what, ())


def _rests_on(surface: VisibleSurface, room: Room, rows: IntArray) -> str:
    """Return what a region rests on, in words; empty if nothing was found."""
    if not room.has_floor:
        return "touches nothing else"
    if (surface.areas[rows] * room.feet[rows]).any():
        return "stands on a surface"
    if (surface.areas[rows] * room.leaning[rows]).any():
        return "touches a wall"
    return ""
