"""What is cut off with the ceiling: tall things end below it and get their upper part back; walls go on up to it.

Rooms are looked at from above without what is above a height. Bookcases, lamps and plants go on there, and so do walls.
Where matter lies just below the ceiling, a column of the plan belongs to the room itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from gaussian_trimmer.cameras import up_frame
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians, IntArray
from gaussian_trimmer.geometry.components import connected_voxels
from gaussian_trimmer.geometry.storey import Storey
from gaussian_trimmer.views.view import HALF

_CELL = 1 / 40
"""Side of a cell of the plan, relative to the height of the storey: about as thick as a wall."""
_BELOW_CEILING = 0.85, 0.95
"""Heights, relative to that of the storey, between which walls have matter and things do not."""
_AT_CUT = 0.1
"""Depth of what lies right below the cut, relative to the height of the storey."""


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
