"""Which parts of the visible surface are one thing: neighbours are joined, the strongest link first.

Two regions are linked along their contact: by how much Gaussians of both overlap there, how alike their colours are,
and how convex the surface is. A link is measured against the size of the smaller region, so that neither scale nor
density matter, and in each round those join that are each other's strongest link. What does not stand on a surface of
the room by itself is part of something that does, however weak the link is. When nothing else is left to join, regions
that stand do, the likeliest first, as long as they are rather one thing than two. Parts of one thing meet along a
contact that is long beside the smaller part, have colours in common, or are small; the weights of these three were
learned from scenes in which things were put against each other.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, IntArray
from gaussian_trimmer.geometry.graphs import connected_pairs
from gaussian_trimmer.parallel import compiled
from gaussian_trimmer.surface.room_surfaces import Room
from gaussian_trimmer.surface.surface_estimates import COLOURS, blurred_histograms
from gaussian_trimmer.surface.visible_surface import VisibleSurface

_jit = compiled(nogil=True)
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
_REGIONS_AT_ONCE = 64
_WEIGHTS, _INTERCEPT = (19.32, -5.69, -0.92), -2.04
"""Change of the log-odds that two regions are one thing with each of the measures; and where all of these are zero."""


def one_thing(spread: Float64Array, areas: Float64Array, accuracy: Float64Array) -> Float64Array:
    """Return log-odds that two regions which touch, and both stand, are one thing, for P contacts, (P,).

    Args:
        spread: standard deviation of the places where they touch, relative to the root of the smaller area, (P,).
        areas: area of the smaller region, in square units, (P,).
        accuracy: balanced accuracy of telling both apart by their colours, 0.5 to 1, (P,).
    """
    measures = np.stack([spread, np.square(2 * accuracy - 1), np.log(areas)], axis=1)
    return np.asarray(measures @ np.array(_WEIGHTS) + _INTERCEPT)


class _Partition:
    """R regions of the visible surface, and the P links between them, while they grow."""

    def __init__(self, pairs: IntArray, links: Float64Array, sizes: Float64Array) -> None:
        self.pairs = pairs
        """Numbers of two regions, the smaller first, each pair once, (P, 2)."""
        self.links = links
        """Strength of each link, in units; length of its contact; that times its middle, and the square, (P, 6)."""
        self.sizes = sizes
        """Area of each region, and of its feet, in square units, (R, 2)."""
        self.regions = np.arange(len(sizes))
        """Number of the region of each Gaussian, (S,)."""

    @classmethod
    def of(cls, surface: VisibleSurface, free: BoolArray, feet: BoolArray) -> _Partition:
        """Return the free Gaussians of a surface (S,), each a region, some of which stand on the room, (S,)."""
        a, b = surface.edges.T
        inner = np.flatnonzero(free[a] & free[b] & (a != b))  # Gaussians at one place are their own neighbours
        pairs, contact = surface.edges.take(inner, axis=0), surface.contact[inner]
        middle = (surface.points.take(pairs[:, 0], axis=0) + surface.points.take(pairs[:, 1], axis=0)) / 2
        moments = np.column_stack([np.ones(len(middle)), middle, np.einsum("pi,pi->p", middle, middle)])
        links = np.column_stack([contact * surface.affinity[inner], contact[:, None] * moments])
        return cls(pairs, links, np.stack([surface.areas, surface.areas * feet], axis=1))

    @property
    def size(self) -> Float64Array:
        """Root of the area of the smaller region of each link, in units, (P,)."""
        return np.asarray(np.sqrt(self.sizes[:, 0][self.pairs].min(axis=1)))

    def spread(self, asked: IntArray) -> Float64Array:
        """Return the standard deviation of the places along some contacts, in units, (A,)."""
        moments = self.links[asked, 2:] / np.maximum(self.links[asked, 1:2], 1e-30)
        return np.asarray(np.sqrt(np.maximum(moments[:, 3] - np.square(moments[:, :3]).sum(axis=1), 0)))

    def settle(self, least: Sequence[float]) -> None:
        """Join what does not stand by itself, until only links between regions that do, and the weakest, are left.

        Args:
            least: the area, and that of its feet, in square units, that a region which stands by itself exceeds.
        """
        while len(self.pairs):
            if not self.join(self.certain_links(least, _MIN_LINK)):
                break

    def certain_links(self, least: Sequence[float], weakest: float) -> Float64Array:
        """Return the strength of links (P,) of regions of which one does not exceed the least sizes, (P,)."""
        return np.asarray(_certain_links(self.pairs, self.links, self.sizes, np.array(least, np.float64), weakest))

    def join(self, strength: Float64Array) -> bool:
        """Join the regions of links (P,) that are the strongest ones of both, above zero; tell if there are any."""
        mutual = _mutual(self.pairs, strength, len(self.sizes))
        if mutual.any():
            numbers = connected_pairs(len(self.sizes), self.pairs[mutual])
            self.regions = numbers[self.regions]
            self._renumber(numbers)
        return bool(mutual.any())

    def _renumber(self, numbers: IntArray) -> None:
        """Give the regions new numbers (R,); the links within one are gone, and those of the same two are summed."""
        self.pairs, self.links, self.sizes = _merged(numbers, self.pairs, self.links, self.sizes)


class _Colours:
    """How well colours tell regions apart; the histograms of regions are kept until they grow."""

    def __init__(self, surface: VisibleSurface) -> None:
        self._present, self._bins = np.unique(surface.colours, return_inverse=True)
        self._areas = surface.areas
        self._known: dict[tuple[int, int], FloatArray] = {}

    def accuracy(self, regions: IntArray, pairs: IntArray) -> Float64Array:
        """Return balanced accuracies of telling the regions (S,) of pairs (P, 2) apart by colour, 0.5 to 1, (P,)."""
        if not len(pairs):
            return np.zeros(0)
        numbers, ends = np.unique(pairs, return_inverse=True)
        order = np.argsort(regions, kind="stable")
        first, last = (np.searchsorted(regions[order], numbers, side) for side in ("left", "right"))
        # A region grows, but for its first Gaussian and its size it stays the same.
        keys = list(zip(order[first].tolist(), (last - first).tolist(), strict=True))
        new = np.array([key not in self._known for key in keys])
        for start in range(0, int(new.sum()), _REGIONS_AT_ONCE):
            places = np.flatnonzero(new)[start : start + _REGIONS_AT_ONCE]
            rows = np.concatenate([order[first[place] : last[place]] for place in places])
            counts = np.zeros((len(places), COLOURS))
            of = np.repeat(np.arange(len(places)), (last - first)[places])
            np.add.at(counts, (of, self._present[self._bins[rows]]), self._areas[rows])
            both = counts / counts.sum(axis=1, keepdims=True), blurred_histograms(counts)
            found = np.stack([one[:, self._present] for one in both], axis=1).astype(np.float32)
            self._known.update((keys[place], one) for place, one in zip(places.tolist(), found, strict=True))
        self._known = {key: self._known[key] for key in keys}
        return np.asarray(_accuracies(np.stack(list(self._known.values())), ends.reshape(-1, 2)))


def find_regions(surface: VisibleSurface, room: Room, levels: Sequence[float] = (0.0,)) -> list[IntArray]:
    """Return the number of each visible Gaussian's region, (S,), at each level; -1 for the room's own surfaces.

    Where the scene fills its pictures and has no surfaces to stand on, every large region stands by itself, and colours
    alone say what is one thing.

    Args:
        surface: the visible surface.
        room: its flat surfaces.
        levels: log-odds from which on such regions are joined, falling: the regions of a level are joined at the next.
    """
    free, colours = ~room.own, _Colours(surface)
    by_itself = not room.has_floor and surface.filled > FILLED
    stands = (_MIN_AREA_BY_ITSELF, -1.0) if by_itself else (MIN_AREA, _MIN_FOOT)
    partition, found = _Partition.of(surface, free, room.feet), list[IntArray]()

    def likely(level: float) -> Float64Array:
        pairs, size, likely = partition.pairs, partition.size, np.zeros(len(partition.pairs))
        asked = np.flatnonzero(partition.links[:, 0] >= size * _MIN_LINK)
        accuracy = colours.accuracy(partition.regions, pairs[asked])
        if by_itself:
            likely[asked] = _OTHER_COLOURS - accuracy
        else:
            spread = partition.spread(asked) / size[asked]
            likely[asked] = one_thing(spread, np.square(size[asked]), accuracy) - level
        return np.maximum(likely, 0.0)

    for level in levels:
        partition.settle(stands)
        while len(partition.pairs) and partition.join(likely(level)):
            partition.settle(stands)
        found.append(_with_borders(surface, room, np.where(free, partition.regions, -1)))
    return found


def split_region(surface: VisibleSurface, part: BoolArray) -> IntArray:
    """Number the main parts of a region (S,), from 0, and say which each Gaussian of it is in, (S,); -1 elsewhere.

    The weakest links are those between large parts; what is small joins one of these.
    """
    total = float(surface.areas[part].sum())

    partition = _Partition.of(surface, part, part)
    partition.settle((_LARGE_PART * total, -1.0))
    regions = partition.regions
    areas = np.bincount(regions[part], surface.areas[part])
    large = np.flatnonzero(areas > _LARGE_PART * total)
    large = large[np.argsort(-areas[large])]
    parts = np.zeros(len(areas), np.int64)
    parts[large] = np.arange(len(large))
    return np.where(part, parts[np.minimum(regions, len(parts) - 1)], -1)


def region_apart(edges: IntArray, weights: Float64Array, areas: Float64Array, node: int, others: IntArray) -> BoolArray:
    """Return the largest region of a surface that holds a node and none of some others, (S,).

    All regions join, the strongest link relative to the smaller one first, until the node's would join another's.

    Args:
        edges: pairs of neighbouring nodes, each once, (E, 2).
        weights: how strongly each pair hangs together, (E,).
        areas: of the nodes, (S,).
        node: the node.
        others: numbers of the others; none: all that hangs together with the node.
    """
    partition = _Partition(np.sort(edges, axis=1), weights[:, None], np.stack([areas, areas], axis=1))
    found: BoolArray = partition.regions == node
    while len(partition.pairs) and partition.join(partition.certain_links((np.inf, np.inf), 0.0)):
        joined = np.asarray(partition.regions == partition.regions[node])
        if joined[others].any():
            break
        found = joined
    return found


@_jit
def _accuracies(histograms, pairs):  # type: ignore[no-untyped-def]
    """Return the balanced accuracy of telling by the blurred histogram which of two a colour is of, 0.5 to 1, (P,).

    The histograms (R, 2, B) are as they are, and blurred.
    """
    found = np.empty(len(pairs))
    for pair in range(len(pairs)):
        a, b = histograms[pairs[pair, 0]], histograms[pairs[pair, 1]]
        hits = np.float32(0)
        for colour in range(a.shape[1]):
            if a[1, colour] > b[1, colour]:
                hits += a[0, colour]
            elif a[1, colour] < b[1, colour]:
                hits += b[0, colour]
        found[pair] = hits / 2
    return found


@_jit
def _certain_links(pairs, links, sizes, least, weakest):  # type: ignore[no-untyped-def]
    """Return the strength of links of regions of which one does not stand by itself, relative to the smaller, (P,)."""
    stands, strength = (sizes > least).sum(axis=1) == 2, np.zeros(len(pairs))
    for pair in range(len(pairs)):
        a, b = pairs[pair, 0], pairs[pair, 1]
        size = np.sqrt(min(sizes[a, 0], sizes[b, 0]))
        if not (stands[a] and stands[b]) and links[pair, 0] >= weakest * size:
            strength[pair] = links[pair, 0] / max(size, 1e-30)
    return strength


@_jit
def _mutual(pairs, strength, count):  # type: ignore[no-untyped-def]
    """Tell which links are the strongest ones of both of their regions, of so many, and not zero, (P,)."""
    strongest, mutual = np.zeros(count), np.zeros(len(pairs), np.bool_)
    for pair in range(len(pairs)):
        for side in range(2):
            strongest[pairs[pair, side]] = max(strongest[pairs[pair, side]], strength[pair])
    for pair in range(len(pairs)):
        a, b = pairs[pair, 0], pairs[pair, 1]
        mutual[pair] = strength[pair] > 0 and strength[pair] >= max(strongest[a], strongest[b])
    return mutual


@_jit
def _merged(numbers, pairs, links, sizes):  # type: ignore[no-untyped-def]
    """Return pairs, links and sizes of regions by their new numbers (R,): links of the same two are summed."""
    count = numbers.max() + 1
    merged_sizes, starts = np.zeros((count, 2)), np.zeros(count + 1, np.int64)
    for region in range(len(numbers)):
        for column in range(2):
            merged_sizes[numbers[region], column] += sizes[region, column]
    for pair in range(len(pairs)):
        a, b = numbers[pairs[pair, 0]], numbers[pairs[pair, 1]]
        starts[min(a, b) + 1] += a != b
    starts = np.cumsum(starts)
    order, filled = np.empty(starts[-1], np.int64), starts[:-1].copy()
    for pair in range(len(pairs)):
        a, b = numbers[pairs[pair, 0]], numbers[pairs[pair, 1]]
        if a != b:
            order[filled[min(a, b)]] = pair
            filled[min(a, b)] += 1
    found, place = 0, np.full(count, -1)  # place of the link from the region at hand to each other one
    merged_pairs, merged_links = np.empty((len(order), 2), np.int64), np.zeros((len(order), links.shape[1]))
    for region in range(count):
        first = found
        for pair in order[starts[region] : starts[region + 1]]:
            other = max(numbers[pairs[pair, 0]], numbers[pairs[pair, 1]])
            if place[other] < first:
                place[other] = found
                merged_pairs[found, 0], merged_pairs[found, 1] = region, other
                found += 1
            for column in range(links.shape[1]):
                merged_links[place[other], column] += links[pair, column]
    return merged_pairs[:found].copy(), merged_links[:found].copy(), merged_sizes


def _with_borders(surface: VisibleSurface, room: Room, regions: IntArray) -> IntArray:
    """Return regions (S,) with what lies thin on surfaces of the room: they grow to where the room is linked better."""
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
