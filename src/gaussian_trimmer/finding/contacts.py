"""Whether two regions that touch, and both stand on a surface of the room, are one thing.

Parts of one thing meet along a contact that is long beside the smaller part, have colours in common, or are small. The
weights of these three were learned from scenes in which things were put against each other, by
`benchmarks/joining.py`, which also says how well they do on scenes that they were not learned from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.finding.visible_surface import VisibleSurface
from gaussian_trimmer.gaussians import Float64Array, IntArray
from gaussian_trimmer.selecting.surface_estimates import colour_evidence

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
    """Log-odds that the regions of each contact are one thing, (P,)."""
    return np.asarray(contacts.measures @ np.array(WEIGHTS) + INTERCEPT)


class Colours:
    """How well colours tell regions apart; what was compared is kept."""

    def __init__(self, surface: VisibleSurface) -> None:
        self._bins, self._areas = surface.colours, surface.areas
        self._known: dict[tuple[int, int, int, int], float] = {}

    def accuracy(self, regions: IntArray, pairs: IntArray) -> Float64Array:
        """Balanced accuracy of telling the regions (S,) of each pair (P, 2) apart by their colours, 0.5 to 1, (P,)."""
        order = np.argsort(regions, kind="stable")
        starts = np.searchsorted(regions[order], np.arange(int(regions.max(initial=0)) + 2))
        found = np.zeros(len(pairs))
        for place, ends in enumerate(pairs.tolist()):
            first, second = (order[starts[end] : starts[end + 1]] for end in ends)
            # A region grows, but for its first Gaussian and its size it stays the same.
            key = int(first[0]), len(first), int(second[0]), len(second)
            if key not in self._known:
                self._known[key] = self._compared(first, second)
            found[place] = self._known[key]
        return found

    def _compared(self, first: IntArray, second: IntArray) -> float:
        rows = np.concatenate([first, second])
        inside, areas = np.arange(len(rows)) < len(first), self._areas[rows]
        return colour_evidence(self._bins[rows], areas * inside, areas * ~inside)[1]
