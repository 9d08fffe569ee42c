"""Which parts of the visible surface are one thing: neighbours are joined, the strongest link first.

Two regions are linked along their contact: by how much Gaussians of both overlap there, how alike their colours are,
and how convex the surface is. A link is measured against the size of the smaller region, so that neither scale nor
density matter, and in each round those join that are each other's strongest link. What does not stand on a surface of
the room by itself is part of something that does, however weak the link is. When nothing else is left to join, regions
that stand do, the likeliest first, as long as they are rather one thing than two: `contacts.py` says which are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from gaussian_trimmer.finding.contacts import Colours, Contacts, one_thing
from gaussian_trimmer.finding.room_surfaces import Room
from gaussian_trimmer.finding.visible_surface import VisibleSurface
from gaussian_trimmer.gaussians import BoolArray, Float64Array, IntArray
from gaussian_trimmer.geometry.components import connected_pairs

MIN_AREA = 0.01
"""Smallest area of a thing, in square units."""
_MIN_FOOT = 1e-4
"""Area close above a surface of the room, in square units, from which on a region stands on it."""
FILLED = 0.9
"""Share of its pictures from which on a scene fills them, so that nothing in it stands alone."""
_MIN_AREA_BY_ITSELF = 0.05
"""Smallest area of a region that stands by itself there, in square units."""
_MIN_LINK = 1e-5
"""Weakest link that joins regions."""
_OTHER_COLOURS = 0.83
"""Accuracy, 0.5 to 1, with which colours must tell two regions apart there, so that they are two things."""
_LARGE_PART = 0.15
"""Smallest share of an object's area that its main parts have, where it is split."""
_BORDER_ROUNDS = 20

Odds = Callable[[Contacts], Float64Array]
"""Says of P contacts how likely each joins one thing, above zero if it rather does, (P,)."""


class _Partition:
    """R regions of the visible surface, and the P links between them, while they grow."""

    def __init__(self, surface: VisibleSurface, free: BoolArray, feet: BoolArray) -> None:
        inner = free[surface.edges].all(axis=1)
        contact, middle = surface.contact[inner], surface.points[surface.edges[inner]].mean(axis=1)
        self.regions = np.arange(len(free))
        """Number of the region of each Gaussian, (S,)."""
        self.areas, self.feet = surface.areas, surface.areas * feet
        """Area of each region, and of its feet, in square units, (R,)."""
        self.pairs = surface.edges[inner]
        """Numbers of two regions, the smaller first, each pair once, (P, 2)."""
        moments = np.vstack([np.ones(len(middle)), middle.T, np.einsum("pi,pi->p", middle, middle)])
        self._links = np.vstack([contact * surface.affinity[inner], contact * moments])
        """Strength of each link, in units; length of its contact; that times its middle, and the square, (6, P)."""
        self._renumber(self.regions)

    @property
    def weight(self) -> Float64Array:
        """Strength of each link, in units, (P,)."""
        return np.asarray(self._links[0])

    @property
    def size(self) -> Float64Array:
        """Root of the area of the smaller region of each link, in units, (P,)."""
        return np.asarray(np.sqrt(self.areas[self.pairs].min(axis=1)))

    def spread(self, asked: IntArray) -> Float64Array:
        """Standard deviation of the places along some contacts, in units, (A,)."""
        moments = self._links[2:, asked] / np.maximum(self._links[1, asked], 1e-30)
        return np.asarray(np.sqrt(np.maximum(moments[3] - np.square(moments[:3]).sum(axis=0), 0)))

    def grow(self, joins: Callable[[_Partition], Float64Array]) -> IntArray:
        """Join neighbours that are each other's strongest link, until there are none; return the regions, (S,).

        Args:
            joins: the strength of each link, zero for regions that may not join, (P,).
        """
        while len(self.pairs):
            strength = joins(self)
            mutual = _mutual(self.pairs, strength, len(self.areas))
            if not mutual.any():
                break
            numbers = connected_pairs(len(self.areas), self.pairs[mutual])
            self.regions = numbers[self.regions]
            self._renumber(numbers)
        return self.regions

    def _renumber(self, numbers: IntArray) -> None:
        """Give the regions new numbers (R,); the links within one are gone, and those of the same two are summed."""
        ends = np.sort(numbers[self.pairs], axis=1)
        across = ends[:, 0] != ends[:, 1]
        keys, place = np.unique((ends[across, 0] << 32) | ends[across, 1], return_inverse=True)
        self.pairs = np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=1)
        self._links = np.array([np.bincount(place, one[across], len(keys)) for one in self._links])
        self.areas, self.feet = np.array([np.bincount(numbers, one) for one in (self.areas, self.feet)], np.float64)


def find_regions(
    surface: VisibleSurface,
    room: Room,
    odds: Odds = one_thing,
    levels: Sequence[float] = (0.0,),
) -> list[IntArray]:
    """Number of the region that each Gaussian of the visible surface is in, (S,); -1 for the room's own surfaces.

    Where the scene fills its pictures and has no surfaces to stand on, every large region stands by itself, and colours
    alone say what is one thing.

    Args:
        surface: the visible surface.
        room: its flat surfaces.
        odds: says of regions that touch and stand which are one thing.
        levels: log-odds from which on such regions are joined, falling: the regions of a level are joined at the next.
    """
    free, colours = ~room.own, Colours(surface)
    by_itself = not room.has_floor and surface.filled > FILLED

    def joins(partition: _Partition, level: float) -> Float64Array:
        stands = (partition.feet > _MIN_FOOT) & (partition.areas > MIN_AREA)
        if by_itself:
            stands = partition.areas > _MIN_AREA_BY_ITSELF
        size, pairs = partition.size, partition.pairs
        linked, both = partition.weight >= size * _MIN_LINK, stands[pairs].all(axis=1)
        certain = linked & ~both
        if certain.any():
            return np.where(certain, partition.weight / size, 0.0)
        asked, likely = np.flatnonzero(linked), np.zeros(len(pairs))
        contacts = Contacts(
            partition.regions,
            pairs[asked],
            partition.spread(asked) / size[asked],
            np.square(size[asked]),
            colours.accuracy(partition.regions, pairs[asked]),
        )
        likely[asked] = _OTHER_COLOURS - contacts.accuracy if by_itself else odds(contacts) - level
        return np.maximum(likely, 0.0)

    partition = _Partition(surface, free, room.feet)
    found = [partition.grow(partial(joins, level=level)) for level in levels]
    return [_with_borders(surface, room, np.where(free, regions, -1)) for regions in found]


def split_region(surface: VisibleSurface, part: BoolArray) -> IntArray:
    """Number, from 0, of the main part of a region (S,) that each Gaussian of it is in, (S,); -1 elsewhere.

    The weakest links are those between large parts; what is small joins one of these.
    """
    total = float(surface.areas[part].sum())

    def joins(partition: _Partition) -> Float64Array:
        large = (partition.areas > _LARGE_PART * total)[partition.pairs].all(axis=1)
        return np.where(large, 0.0, partition.weight / partition.size)

    regions = _Partition(surface, part, part).grow(joins)
    areas = np.bincount(regions[part], surface.areas[part])
    large = np.flatnonzero(areas > _LARGE_PART * total)
    large = large[np.argsort(-areas[large])]
    parts = np.zeros(len(areas), np.int64)
    parts[large] = np.arange(len(large))
    return np.where(part, parts[np.minimum(regions, len(parts) - 1)], -1)


def _mutual(pairs: IntArray, strength: Float64Array, count: int) -> BoolArray:
    """Which links are the strongest ones of both of their regions, of so many, and not zero, (P,)."""
    strongest = np.zeros(count)
    for end in pairs.T:
        np.maximum.at(strongest, end, strength)
    return np.asarray((strength > 0) & (strength >= strongest[pairs].max(axis=1)))


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
