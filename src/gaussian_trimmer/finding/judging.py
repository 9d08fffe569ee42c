"""Which regions of the visible surface are objects, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from gaussian_trimmer.finding.found import FoundObject
from gaussian_trimmer.gaussians import BoolArray, IntArray
from gaussian_trimmer.settings import Range, Share
from gaussian_trimmer.surface.regions import FILLED, MIN_AREA
from gaussian_trimmer.surface.room_surfaces import Room, RoomSurface
from gaussian_trimmer.surface.visible_surface import VisibleSurface, seen_share

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
