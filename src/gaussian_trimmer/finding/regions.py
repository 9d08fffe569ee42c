"""Which parts of the visible surface are one thing: neighbours are joined, the strongest link first.

Two regions are linked along their contact: by how much Gaussians of both overlap there, how alike their colours are,
and how convex the surface is. A link is measured against the size of the smaller region, so that neither scale nor
density matter, and in each round those join that are each other's strongest link. What stands on a surface of the room
by itself is another thing than its neighbour that does so too, if both hardly touch, or have other colours and touch
along a short line or in a concave one. All else joins, however weak the link is: what does not stand is part of
something that does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.finding.room_surfaces import Room
from gaussian_trimmer.finding.visible_surface import VisibleSurface
from gaussian_trimmer.gaussians import BoolArray, Float64Array, IntArray
from gaussian_trimmer.geometry.components import connected_pairs
from gaussian_trimmer.selecting.surface_estimates import colour_evidence

MIN_AREA = 0.01
"""Smallest area of a thing, in square units."""
_MIN_FOOT = 1e-4
"""Area close above a surface of the room, in square units, from which on a region stands on it."""
FILLED = 0.9
"""Share of its pictures from which on a scene fills them, so that nothing in it stands alone."""
_MIN_AREA_BY_ITSELF = 0.05
"""Smallest area of a region that stands by itself there, in square units."""
_MIN_LINK, _MIN_LINK_OF_STANDING = 1e-5, 0.003
"""Weakest link that joins regions, and ones that both stand."""
_SHORT_CONTACT = 0.3
"""Length of the contact as far as it is convex, relative to the root of the smaller area, below which two standing
regions may be two things."""
_CONCAVE = 0.6
"""Mean convexity of the contact below which they may be two things, however long it is: parts of a thing have 0.7."""
_OTHER_COLOURS = 0.83
"""Accuracy with which colours must tell two things apart, 0.5 to 1."""
_LARGE_PART = 0.15
"""Smallest share of an object's area that its main parts have, where it is split."""
_BORDER_ROUNDS = 20


@dataclass(frozen=True, eq=False)
class _Links:
    """The regions' contacts."""

    pairs: IntArray
    """Numbers of two regions, the smaller first, each pair once, (P, 2)."""
    weight: Float64Array
    """Strength of each link, in units, (P,)."""
    smooth: Float64Array
    """Length of each contact, as far as the surface is convex there, in units, (P,)."""
    contact: Float64Array
    """Length of each contact, in units, (P,)."""

    def renumbered(self, numbers: IntArray) -> _Links:
        """The links of the regions that have got new numbers (R,); what was within one is gone."""
        ends = np.sort(numbers[self.pairs], axis=1)
        across = ends[:, 0] != ends[:, 1]
        keys, place = np.unique((ends[across, 0] << 32) | ends[across, 1], return_inverse=True)
        pairs = np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=1)
        sums = (np.bincount(place, one[across], len(keys)) for one in (self.weight, self.smooth, self.contact))
        return _Links(pairs, *(np.asarray(one, np.float64) for one in sums))


def find_regions(surface: VisibleSurface, room: Room) -> IntArray:
    """Number of the region that each Gaussian of the visible surface is in, (S,); -1 for the room's own surfaces.

    Where the scene fills its pictures and has no surfaces to stand on, every large region stands by itself.
    """
    free, colours = ~room.own, _Colours(surface)
    by_itself = not room.has_floor and surface.filled > FILLED

    def joins(links: _Links, regions: IntArray, areas: Float64Array) -> tuple[BoolArray, BoolArray]:
        stands = (np.bincount(regions, surface.areas * room.feet) > _MIN_FOOT) & (areas > MIN_AREA)
        if by_itself:
            stands = areas > _MIN_AREA_BY_ITSELF
        size = np.sqrt(areas[links.pairs].min(axis=1))
        both = stands[links.pairs].all(axis=1)
        allowed = links.weight >= size * np.where(both, _MIN_LINK_OF_STANDING, _MIN_LINK)
        apart = (links.smooth < _SHORT_CONTACT * size) | (links.smooth < _CONCAVE * links.contact)
        return np.asarray(allowed), np.asarray(both & apart)

    regions = _joined(surface, free, joins, lambda regions, a, b: colours.accuracy(regions, a, b) < _OTHER_COLOURS)
    return _with_borders(surface, room, np.where(free, regions, -1))


def split_region(surface: VisibleSurface, part: BoolArray) -> IntArray:
    """Number, from 0, of the main part of a region (S,) that each Gaussian of it is in, (S,); -1 elsewhere.

    The weakest links are those between large parts; what is small joins one of these.
    """
    total = float(surface.areas[part].sum())

    def joins(links: _Links, regions: IntArray, areas: Float64Array) -> tuple[BoolArray, BoolArray]:
        large: BoolArray = areas > _LARGE_PART * total
        return np.asarray(~large[links.pairs].all(axis=1)), np.zeros(len(links.pairs), np.bool_)

    regions = _joined(surface, part, joins, lambda regions, a, b: True)
    areas = np.bincount(regions[part], surface.areas[part])
    large = np.flatnonzero(areas > _LARGE_PART * total)
    large = large[np.argsort(-areas[large])]
    parts = np.zeros(len(areas), np.int64)
    parts[large] = np.arange(len(large))
    return np.where(part, parts[np.minimum(regions, len(parts) - 1)], -1)


def _joined(
    surface: VisibleSurface,
    free: BoolArray,
    joins: Callable[[_Links, IntArray, Float64Array], tuple[BoolArray, BoolArray]],
    confirmed: Callable[[IntArray, int, int], bool],
) -> IntArray:
    """Number of the region that each Gaussian is in, (S,), as neighbours join that are each other's strongest link.

    Args:
        surface: the visible surface.
        free: which of its Gaussians join others, (S,).
        joins: says of the links between regions, whose areas (R,) are given, which may join, (P,), and which of these
            only if it is confirmed, (P,).
        confirmed: whether two regions join after all, asked where nothing else keeps them apart.
    """
    inner = free[surface.edges].all(axis=1)
    contact = surface.contact[inner]
    links = _Links(surface.edges[inner], contact * surface.affinity[inner], contact * surface.convexity[inner], contact)
    regions = np.arange(len(free))
    links = links.renumbered(regions)
    while len(links.pairs):
        areas = np.asarray(np.bincount(regions, surface.areas), np.float64)
        allowed, doubtful = joins(links, regions, areas)
        strength = links.weight / np.sqrt(areas[links.pairs].min(axis=1))
        mutual = _mutual(links, np.where(allowed, strength, 0.0), len(areas))
        while len(asked := np.flatnonzero(mutual & doubtful)):
            for pair in asked.tolist():
                allowed[pair] = confirmed(regions, *links.pairs[pair].tolist())
            doubtful[asked] = False
            mutual = _mutual(links, np.where(allowed, strength, 0.0), len(areas))
        if not mutual.any():
            break
        roots = connected_pairs(len(areas), links.pairs[mutual])
        numbers = np.unique(roots, return_inverse=True)[1]
        regions, links = numbers[regions], links.renumbered(numbers)
    return regions


def _mutual(links: _Links, strength: Float64Array, count: int) -> BoolArray:
    """Which links are the strongest ones of both of their regions, of so many, and not zero, (P,)."""
    strongest = np.zeros(count)
    for end in links.pairs.T:
        np.maximum.at(strongest, end, strength)
    return np.asarray((strength > 0) & (strength >= strongest[links.pairs].max(axis=1)))


def _with_borders(surface: VisibleSurface, room: Room, regions: IntArray) -> IntArray:
    """The regions (S,) with what lies thin on surfaces of the room: each grows to where the room is linked better."""
    settled, regions = ~room.border, regions.copy()
    weight = surface.contact * surface.affinity
    for _ in range(_BORDER_ROUNDS):
        a, b = np.concatenate([surface.edges, surface.edges[:, ::-1]]).T
        grows = settled[a] & ~settled[b]
        if not grows.any():
            break
        # The sum of the links of each Gaussian to each region beside it; the room is number 0.
        keys, place = np.unique((b[grows] << 32) | (regions[a[grows]] + 1), return_inverse=True)
        link = np.bincount(place, np.tile(weight, 2)[grows], len(keys))
        order = np.lexsort((link, keys >> 32))
        last = np.append(np.diff(keys[order] >> 32) > 0, True)
        chosen = keys[order[last]]
        regions[chosen >> 32] = (chosen & 0xFFFFFFFF) - 1
        settled[chosen >> 32] = True
    return regions


class _Colours:
    """How well colours tell two regions apart; what was compared is kept."""

    def __init__(self, surface: VisibleSurface) -> None:
        self._bins, self._areas = surface.colours, surface.areas
        self._known: dict[tuple[int, int, int, int], float] = {}

    def accuracy(self, regions: IntArray, a: int, b: int) -> float:
        """Balanced accuracy of telling two regions apart by their colours, 0.5 to 1."""
        first, second = (np.flatnonzero(regions == number) for number in (a, b))
        # A region grows, but for its first Gaussian and its size it stays the same.
        key = int(first[0]), len(first), int(second[0]), len(second)
        if key not in self._known:
            rows = np.concatenate([first, second])
            inside: BoolArray = np.arange(len(rows)) < len(first)
            areas = self._areas[rows]
            self._known[key] = colour_evidence(self._bins[rows], areas * inside, areas * ~inside)[1]
        return self._known[key]
