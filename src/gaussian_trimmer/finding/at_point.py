"""What stands at one point of a large capture: the finder's look at the tiles around it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import chain, zip_longest

import numpy as np

from gaussian_trimmer.cameras import up_frame
from gaussian_trimmer.finding.agreement import Candidate, most_agreed_on
from gaussian_trimmer.finding.find import Looks
from gaussian_trimmer.finding.judging import FindConfig
from gaussian_trimmer.finding.tall_things import TallThings
from gaussian_trimmer.finding.tiles import Tile, tile_counts
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.geometry.storey import Storey, find_storey, sampled
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.surface.visible_surface import measure

_MIN_SEEN = 0.5
"""Share of what is seen at the point that is of an object there, at least."""


@dataclass(frozen=True, eq=False)
class ThingsAtPoints:
    """Finds what stands at points of a capture of N Gaussians; what is the same for all points is found once."""

    scene: Gaussians
    up: Float64Array
    """The up vector, (3,)."""

    def at(self, point: Float64Array, seen: FloatArray) -> list[IntArray]:
        """Return the objects at a point, the rows of each, ascending.

        The first is the one that the looks agree on most, then come the next larger one, the next smaller one, and so
        on.

        Args:
            point: a point on what is meant, (3,).
            seen: weight of each Gaussian in what is seen there, (N,).
        """
        x, y, heights, storey = self._plan
        height, top = float(self.up @ point), storey.head_height
        if storey.ceiling is not None:
            top = (height + storey.ceiling) / 2
        below = heights < top
        if height >= top or not below.any():
            return []
        middle = up_frame(self.up)[:2] @ point
        distance = np.maximum(np.abs(x - middle[0]), np.abs(y - middle[1]))
        looked_at = np.where(below, distance, np.inf)
        shown = int(below.sum())
        counts = [min(n, shown - 1) for n in tile_counts(shown)[1:]]  # the smaller ones: what is meant is seen nearby
        reach = np.partition(looked_at, counts)[counts].tolist()
        rows = np.flatnonzero(looked_at <= max(reach))
        near, looks = self.scene.select(rows), Looks(self.up, FindConfig()).close()
        tiles = [Tile(middle - r, 2 * r, np.flatnonzero(looked_at[rows] <= r)) for r in reach]
        looked = [(tile, look) for tile in tiles if (look := looks.tile(near, tile)) is not None]
        if not looked:
            return []
        measured, weight = measure(near, [look for _, look in looked]), seen[rows] / max(float(seen.sum()), 1e-9)
        found_in = parallel_map(
            lambda tile, look: looks.candidates(near, tile, look, measured, top), *zip(*looked, strict=True)
        )
        found = [one for of_tile in found_in for one in of_tile if weight[one.rows].sum() > _MIN_SEEN]
        around = np.flatnonzero(distance <= max(reach))
        tall = TallThings(self.scene.select(around), self.up, storey, top)

        def whole(one: Candidate) -> IntArray:
            """Return the rows of a thing, with what was cut off it."""
            thing = rows[one.rows]
            if not one.cut_off or tall.reaches_ceiling(np.searchsorted(around, thing)):
                return thing
            return around[np.flatnonzero(tall.grown(np.isin(around, thing).astype(np.int64), [1]))]

        first, *others = [whole(one) for one in most_agreed_on(found, len(rows))] or [rows[:0]]
        larger = sorted((one for one in others if len(one) > len(first)), key=len)
        smaller = sorted((one for one in others if len(one) <= len(first)), key=len, reverse=True)
        in_turn = chain.from_iterable(zip_longest(larger, smaller))
        return [one for one in (first, *in_turn) if one is not None and len(one)]

    @cached_property
    def _plan(self) -> tuple[Float64Array, Float64Array, Float64Array, Storey]:
        """Two horizontal coordinates and heights, (N,) each, and where floor and ceiling are."""
        means = self.scene.means.astype(np.float64)
        x, y = np.ascontiguousarray((means @ up_frame(self.up)[:2].T).T)
        return x, y, means @ self.up, find_storey(sampled(self.scene), self.up)
