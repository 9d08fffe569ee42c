"""Which parts of the visible surface are one thing: neighbours are joined, the strongest link first.

Two regions are linked along their contact: by how much Gaussians of both overlap there, how alike their colours are,
and how convex the surface is. A link is measured against the size of the smaller region, so that neither scale nor
density matter, and in each round those join that are each other's strongest link. What does not stand on a surface of
the room by itself is part of something that does, however weak the link is. When nothing else is left to join, regions
that stand do, the likeliest first, as long as they are rather one thing than two: `contacts.py` says which are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

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


@dataclass(frozen=True, eq=False)
class _Links:
    """The regions' contacts."""

    pairs: IntArray
    """Numbers of two regions, the smaller first, each pair once, (P, 2)."""
    weight: Float64Array
    """Strength of each link, in units, (P,)."""
    moments: Float64Array
    """Length of each contact, in units; that times its middle; and that times the middle's square, (P, 5)."""

    def renumbered(self, numbers: IntArray) -> _Links:
        """The links of the regions that have got new numbers (R,); what was within one is gone."""
        ends = np.sort(numbers[self.pairs], axis=1)
        across = ends[:, 0] != ends[:, 1]
        keys, place = np.unique((ends[across, 0] << 32) | ends[across, 1], return_inverse=True)
        pairs = np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=1)
        columns = [self.weight, *self.moments.T]
        weight, *moments = (np.bincount(place, one[across], len(keys)).astype(np.float64) for one in columns)
        return _Links(pairs, weight, np.stack(moments, axis=1))

    @property
    def spread(self) -> Float64Array:
        """Standard deviation of the places along each contact, in units, (P,)."""
        length, middle = np.maximum(self.moments[:, :1], 1e-30), self.moments[:, 1:4]
        variance = self.moments[:, 4:] / length - np.square(middle / length).sum(axis=1, keepdims=True)
        return np.asarray(np.sqrt(np.maximum(variance[:, 0], 0)))


def find_regions(
    surface: VisibleSurface, room: Room, odds: Odds = one_thing, colours: Colours | None = None, level: float = 0.0
) -> IntArray:
    """Number of the region that each Gaussian of the visible surface is in, (S,); -1 for the room's own surfaces.

    Where the scene fills its pictures and has no surfaces to stand on, every large region stands by itself, and colours
    alone say what is one thing.

    Args:
        surface: the visible surface.
        room: its flat surfaces.
        odds: says of regions that touch and stand which are one thing.
        colours: what is known of the colours of this surface; found anew if not given.
        level: log-odds from which on such regions are joined.
    """
    free, colours = ~room.own, colours or Colours(surface)
    by_itself = not room.has_floor and surface.filled > FILLED

    def joins(links: _Links, regions: IntArray, areas: Float64Array) -> Float64Array:
        stands = (np.bincount(regions, surface.areas * room.feet) > _MIN_FOOT) & (areas > MIN_AREA)
        if by_itself:
            stands = areas > _MIN_AREA_BY_ITSELF
        size = np.sqrt(areas[links.pairs].min(axis=1))
        linked, both = links.weight >= size * _MIN_LINK, stands[links.pairs].all(axis=1)
        certain = linked & ~both
        if certain.any():
            return np.where(certain, links.weight / size, 0.0)
        asked, likely = np.flatnonzero(linked), np.zeros(len(links.pairs))
        pairs = links.pairs[asked]
        contacts = Contacts(
            regions,
            pairs,
            links.spread[asked] / size[asked],
            np.square(size[asked]),
            colours.accuracy(regions, pairs),
        )
        likely[asked] = _OTHER_COLOURS - contacts.accuracy if by_itself else odds(contacts) - level
        return np.maximum(likely, 0.0)

    regions = _joined(surface, free, joins)
    return _with_borders(surface, room, np.where(free, regions, -1))


def split_region(surface: VisibleSurface, part: BoolArray) -> IntArray:
    """Number, from 0, of the main part of a region (S,) that each Gaussian of it is in, (S,); -1 elsewhere.

    The weakest links are those between large parts; what is small joins one of these.
    """
    total = float(surface.areas[part].sum())

    def joins(links: _Links, regions: IntArray, areas: Float64Array) -> Float64Array:
        large = (areas > _LARGE_PART * total)[links.pairs].all(axis=1)
        return np.where(large, 0.0, links.weight / np.sqrt(areas[links.pairs].min(axis=1)))

    regions = _joined(surface, part, joins)
    areas = np.bincount(regions[part], surface.areas[part])
    large = np.flatnonzero(areas > _LARGE_PART * total)
    large = large[np.argsort(-areas[large])]
    parts = np.zeros(len(areas), np.int64)
    parts[large] = np.arange(len(large))
    return np.where(part, parts[np.minimum(regions, len(parts) - 1)], -1)


def _joined(
    surface: VisibleSurface, free: BoolArray, joins: Callable[[_Links, IntArray, Float64Array], Float64Array]
) -> IntArray:
    """Number of the region that each Gaussian is in, (S,), as neighbours join that are each other's strongest link.

    Args:
        surface: the visible surface.
        free: which of its Gaussians join others, (S,).
        joins: the strength of the links between regions (S,) whose areas (R,) are given, zero for those that may not
            join, (P,).
    """
    inner = free[surface.edges].all(axis=1)
    edges, contact = surface.edges[inner], surface.contact[inner]
    middle = surface.points[edges].mean(axis=1)
    moments = contact[:, None] * np.column_stack([np.ones(len(edges)), middle, np.square(middle).sum(axis=1)])
    links = _Links(edges, contact * surface.affinity[inner], moments)
    regions = np.arange(len(free))
    links = links.renumbered(regions)
    while len(links.pairs):
        areas = np.asarray(np.bincount(regions, surface.areas), np.float64)
        mutual = _mutual(links, joins(links, regions, areas), len(areas))
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
