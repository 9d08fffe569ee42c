"""Squares of the plan, overlapped by a third, into which a large capture is divided to be looked at closely.

Rooms are looked at from above without what is above a height. Bookcases, lamps and plants go on there, and get their
upper part back; so do walls, which go on up to the ceiling. Where matter lies just below the ceiling, a column of the
plan belongs to the room itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from gaussian_trimmer.cameras import up_frame
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians, IntArray
from gaussian_trimmer.geometry.graphs import connected_voxels
from gaussian_trimmer.geometry.storey import Storey
from gaussian_trimmer.views.view import HALF

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
_CELL = 1 / 40
"""Side of a cell of the plan, relative to the height of the storey: about as thick as a wall."""
_BELOW_CEILING = 0.85, 0.95
"""Heights, relative to that of the storey, between which walls have matter and things do not."""
_AT_CUT = 0.1
"""Depth of what lies right below the cut, relative to the height of the storey."""


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


@dataclass(frozen=True, eq=False)
class TallThings:
    """Tells what goes on above the height at which a room of N Gaussians is cut."""

    scene: Gaussians
    up: Float64Array
    """The up vector, (3,)."""
    storey: Storey
    """Where floor and ceiling are."""
    cut: float
    """Height above which nothing was looked at."""

    def reaches_ceiling(self, rows: IntArray) -> bool:
        """Tell whether what stands below the cut goes on up to the ceiling, by its Gaussians, (C,)."""
        at_cut = rows[self._is_at_cut[rows]]
        return bool(self._is_of_room[at_cut].mean() >= HALF) if len(at_cut) else False

    def grown(self, labels: IntArray, cut_off: Sequence[int]) -> IntArray:
        """Return labels (N,) in which things have what hangs together with them above the cut.

        Where several hang together, each gets what is nearest to it on the plan.

        Args:
            labels: number of the thing that each Gaussian is of, 0 for none, (N,).
            cut_off: numbers of the things that were cut off.
        """
        own = np.isin(labels, cut_off) & self._is_at_cut
        free = (labels == 0) & (self._heights >= self.cut) & (self._heights < self._ends[1]) & ~self._is_of_room
        rows, labels = np.flatnonzero(own | free), labels.copy()
        pieces = connected_voxels(self.scene.means[rows].astype(np.float64), self._side)
        order = np.argsort(pieces, kind="stable")
        for piece in np.split(rows[order], np.flatnonzero(np.diff(pieces[order])) + 1):
            stem, upper = piece[own[piece]], piece[free[piece]]
            if len(stem) and len(upper):
                labels[upper] = labels[stem[cKDTree(self._plan[stem]).query(self._plan[upper])[1]]]
        return labels

    @property
    def _side(self) -> float:
        """Side of a cell, in units."""
        return _CELL * self._storey_height

    @property
    def _storey_height(self) -> float:
        assert self.storey.ceiling is not None, "only what is below a ceiling is cut"
        return self.storey.ceiling - self.storey.floor

    @property
    def _ends(self) -> tuple[float, float]:
        """Heights between which only the room has matter."""
        low, high = (self.storey.floor + share * self._storey_height for share in _BELOW_CEILING)
        return low, high

    @cached_property
    def _heights(self) -> Float64Array:
        return self.scene.means.astype(np.float64) @ self.up

    @cached_property
    def _plan(self) -> Float64Array:
        return self.scene.means.astype(np.float64) @ up_frame(self.up)[:2].T

    @cached_property
    def _is_at_cut(self) -> BoolArray:
        """Which Gaussians lie right below the cut, (N,)."""
        return (self._heights < self.cut) & (self._heights > self.cut - _AT_CUT * self._storey_height)

    @cached_property
    def _is_of_room(self) -> BoolArray:
        """Which Gaussians lie in columns with matter just below the ceiling, (N,)."""
        x, y = np.floor((self._plan - self._plan.min(axis=0)) / self._side).astype(np.int64).T
        columns, (low, high) = (x << 32) | y, self._ends
        return np.isin(columns, columns[(self._heights > low) & (self._heights < high)])
