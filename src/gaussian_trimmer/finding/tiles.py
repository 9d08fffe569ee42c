"""Squares of the plan, overlapped by a third, into which a large capture is divided to be looked at closely."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.gaussians import Float64Array, IntArray

LARGEST_LOOK = 200_000
"""Captures of more Gaussians are looked at in tiles, and so are rooms below a ceiling."""
_SIZES, _LARGEST, _SMALLER = 3, 200_000, 0.3
"""Number of sizes of tiles, Gaussians in the largest ones, and in those of one size relative to the next larger one: a
densely captured bookcase has as many as a whole table with its chairs elsewhere, so that things are whole in tiles of
one size and large enough to be seen in another."""
CELLS, STEP = 3, 2
"""Cells along the side of a tile, and from one to the next: they overlap by a third."""
_MIN_GAUSSIANS = 500
"""Tiles with fewer Gaussians are left out."""
_MARGIN = 0.03
"""Width of the border of a tile, relative to its side, in which nothing whole ends."""
_ROUNDS = 40


@dataclass(frozen=True, eq=False)
class Tile:
    """A square of the plan."""

    low: Float64Array
    """Its corner, (2,)."""
    side: float
    rows: IntArray
    """Which of the Gaussians lie in it, (T,)."""

    def holds(self, low: Float64Array, high: Float64Array) -> bool:
        """Tell whether a box lies within the square and does not touch its border."""
        margin = _MARGIN * self.side
        return bool((low > self.low + margin).all() and (high < self.low + self.side - margin).all())


def tile_counts(shown: int) -> tuple[int, ...]:
    """Return how many Gaussians the tiles of each size hold in the mean: from a whole room to a chair.

    Args:
        shown: number of Gaussians that are divided; of few, the largest tiles hold about all.
    """
    first = max(0, round(np.log(_LARGEST / max(shown, 1)) / np.log(1 / _SMALLER)))
    return tuple(round(_LARGEST * _SMALLER ** (first + step)) for step in range(_SIZES))


def plan_tiles(plan: Float64Array, count: int) -> Iterator[Tile]:
    """Divide a plan into tiles that hold so many Gaussians in the mean, each overlapped by a third with the next.

    Args:
        plan: horizontal coordinates of N Gaussians, (N, 2).
        count: mean number of Gaussians in a tile, as seen from a Gaussian.
    """
    side = _side(plan, count)
    cell, origin = side / CELLS, plan.min(axis=0) - side * (1 - STEP / CELLS)
    keys, place = np.unique(_cells(plan - origin, cell), return_inverse=True)
    order = np.argsort(place, kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(place, minlength=len(keys)))[:-1])
    rows_of = {(key >> 32, key & 0xFFFFFFFF): rows for key, rows in zip(keys.tolist(), groups, strict=True)}
    steps = [(x // STEP - i, y // STEP - j) for x, y in rows_of for i in range(2) for j in range(2)]
    for x, y in sorted(set(steps)):
        within = [(STEP * x + i, STEP * y + j) for i in range(CELLS) for j in range(CELLS)]
        rows = np.sort(np.concatenate([rows_of.get(one, order[:0]) for one in within]))
        if len(rows) >= _MIN_GAUSSIANS:
            yield Tile(origin + cell * np.array([STEP * x, STEP * y]), side, rows)


def _side(plan: Float64Array, count: int) -> float:
    """Find the side of the squares that hold so many Gaussians in the mean over the Gaussians, by bisection."""
    low, high = 0.0, float(np.ptp(plan, axis=0).max()) + 1e-9
    origin = plan.min(axis=0)
    for _ in range(_ROUNDS):
        side = (low + high) / 2
        within = np.unique(_cells(plan - origin, side), return_counts=True)[1]
        mean = float(np.square(within.astype(np.float64)).sum() / len(plan))
        low, high = (side, high) if mean < count else (low, side)
        if high - low < 1e-2 * high:
            break
    return high


def _cells(places: Float64Array, side: float) -> IntArray:
    """Return the number the squares of a grid in which places of the plan (N, 2), not negative, lie, (N,)."""
    x, y = np.floor(places / side).astype(np.int64).T
    return np.asarray((x << 32) | y)
