"""Looks at tiles of a large capture: what stands in one, and what stands at one point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, zip_longest

import numpy as np

from gaussian_trimmer.cameras import up_frame
from gaussian_trimmer.finding.agreement import Candidate, most_agreed_on
from gaussian_trimmer.finding.judging import MIN_SHARE_AT_ALL, FindConfig, name_objects
from gaussian_trimmer.finding.tiles import TallThings, Tile, tile_counts
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.geometry.storey import Storey, find_storey, sampled
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.surface.overview import views_of_all
from gaussian_trimmer.surface.regions import find_regions
from gaussian_trimmer.surface.room_surfaces import find_room
from gaussian_trimmer.surface.visible_surface import (
    Look,
    MeasuredSurface,
    NothingShowsError,
    look_at,
    measure,
    visible_surface,
    with_hidden,
)

HIDDEN_REACH = 0.05
"""Distance, in units, up to which what does not show belongs to the visible Gaussian next to it."""
END_PERCENTILES = (2, 98)
"""Percentiles of an object's centres that are taken for its ends."""
_LEVELS = (3.0, 2.0, 1.0)
"""Log-odds that regions of a tile which touch must have to be joined, ever more easily."""
_MIN_GAUSSIANS = 5
"""Smallest number of Gaussians of an object in a tile."""
_TILE_FILL = 1.8
"""Width of a tile in its pictures: corners, and what is near them, are seen in the middle of the next tile."""
_CUT_SHARE = 0.1
"""An object that ends nearer than this share of its height to where the ceiling was cut off may go on above."""
_MIN_SEEN = 0.5
"""Share of what is seen at the point that is of an object there, at least."""


def close_config(config: FindConfig) -> FindConfig:
    """Return what counts as an object in a tile: all that is named may be sure; its Gaussians tell how large it is."""
    return replace(config, min_shown=MIN_SHARE_AT_ALL * config.min_shown)


def look_at_tile(scene: Gaussians, tile: Tile, up: Float64Array) -> Look | None:
    """Look at a tile of a scene from above; None where hardly anything shows."""
    part = scene.select(tile.rows)
    try:
        look = look_at(part, views_of_all(part, up, _TILE_FILL))
    except NothingShowsError:
        return None
    return replace(look, rows=tile.rows[look.rows])


def candidates_in_tile(
    scene: Gaussians,
    tile: Tile,
    look: Look,
    measured: MeasuredSurface,
    up: Float64Array,
    top: float,
    config: FindConfig,
) -> list[Candidate]:
    """Find the objects that lie whole within a tile; which of them go on up to the ceiling is told later.

    Args:
        scene: the N Gaussians below the cut.
        tile: which of them were looked at.
        look: what shows.
        measured: that of all tiles.
        up: the up vector, (3,).
        top: height at which the capture was cut.
        config: what counts as an object, as `close_config` returns it.
    """
    surface = visible_surface(scene, look, measured, up)
    room, candidates = find_room(surface), []
    for regions in find_regions(surface, room, levels=_LEVELS):
        found, numbers = name_objects(surface, room, regions, config)
        labels = with_hidden(surface, numbers, HIDDEN_REACH, tile.rows)
        order = np.argsort(labels, kind="stable")
        parts = np.split(tile.rows[order], np.searchsorted(labels[order], np.arange(1, len(found) + 1)))[1:]
        for thing, rows in zip(found, parts, strict=True):
            if len(rows) < _MIN_GAUSSIANS or thing.region is None:
                continue
            points = scene.means[rows].astype(np.float64) @ surface.axes.T
            low, high = np.percentile(points, END_PERCENTILES, axis=0)
            if tile.holds(low[:2], high[:2]):
                cut = bool(high[2] > top - _CUT_SHARE * (high[2] - low[2]))
                candidates.append(Candidate(rows, thing, cut))
    return candidates


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
        near, config = self.scene.select(rows), close_config(FindConfig())
        tiles = [Tile(middle - r, 2 * r, np.flatnonzero(looked_at[rows] <= r)) for r in reach]
        looked = [(tile, look) for tile in tiles if (look := look_at_tile(near, tile, self.up)) is not None]
        if not looked:
            return []
        measured, weight = measure(near, [look for _, look in looked]), seen[rows] / max(float(seen.sum()), 1e-9)

        def candidates_in(tile: Tile, look: Look) -> list[Candidate]:
            return candidates_in_tile(near, tile, look, measured, self.up, top, config)

        found_in = parallel_map(candidates_in, *zip(*looked, strict=True))
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
