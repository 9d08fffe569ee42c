"""Whether two regions that touch, and both stand on a surface of the room, are one thing.

Parts of one thing meet along a contact that is long beside the smaller part, have colours in common, or are small. The
weights of these three were learned from scenes in which things were put against each other; docs/objects.md says how
well they do on scenes that they were not learned from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from gaussian_trimmer.gaussians import Float64Array, FloatArray, IntArray
from gaussian_trimmer.geometry.compiling import CACHE
from gaussian_trimmer.surface.surface_estimates import COLOURS, blurred_histograms
from gaussian_trimmer.surface.visible_surface import VisibleSurface

_jit = numba.njit(cache=CACHE, nogil=True)
_REGIONS_AT_ONCE = 64
WEIGHTS = (19.32, -5.69, -0.92)
"""Change of the log-odds that two regions are one thing with each of the measures."""
INTERCEPT = -2.04
"""Log-odds where all measures are zero."""


@dataclass(frozen=True, eq=False)
class Contacts:
    """P contacts between regions of the visible surface, of S Gaussians."""

    regions: IntArray
    """Number of the region that each Gaussian is in, (S,)."""
    pairs: IntArray
    """Numbers of the two regions that touch, (P, 2)."""
    spread: Float64Array
    """Standard deviation of the places where they touch, relative to the root of the smaller area, (P,)."""
    areas: Float64Array
    """Area of the smaller region, in square units, (P,)."""
    accuracy: Float64Array
    """Balanced accuracy of telling both apart by their colours, 0.5 to 1, (P,)."""

    @property
    def measures(self) -> Float64Array:
        """What tells whether both are one thing: spread, how well colours tell them apart, and the log area, (P, 3)."""
        return np.stack([self.spread, np.square(2 * self.accuracy - 1), np.log(self.areas)], axis=1)


def one_thing(contacts: Contacts) -> Float64Array:
    """Return log-odds that the regions of each contact are one thing, (P,)."""
    return np.asarray(contacts.measures @ np.array(WEIGHTS) + INTERCEPT)


class Colours:
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
