"""Squares of the plan, overlapped by a third, in which a large capture is looked at closely, and what they agree on.

Rooms are looked at from above without what is above a height. Bookcases, lamps and plants go on there, and get their
upper part back; so do walls, which go on up to the ceiling. Where matter lies just below the ceiling, a column of the
plan belongs to the room itself.

What is found alike in several tiles is an object; of several that overlap, the one that most tiles agree on. A tile
shows a thing among other neighbours, from other sides and at another size than the tile beside it: what comes out the
same each time stands by itself; what a border cut, or what only one tile joined to its neighbour, does not. A group of
things comes after them: a table with its chairs, of which two are sure by themselves. What stands on a thing that it
lies within, as a cushion on a sofa, is a part of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from gaussian_trimmer.cameras import up_frame
from gaussian_trimmer.finding.found import DOUBTFUL, SURE, FoundObject
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians, IntArray
from gaussian_trimmer.geometry.graphs import connected_voxels
from gaussian_trimmer.geometry.storey import Storey
from gaussian_trimmer.views.view import HALF

CELLS, STEP = 3, 2
"""Cells along the side of a tile, and from one to the next: they overlap by a third."""
_MIN_GAUSSIANS = 500
"""Tiles with fewer Gaussians are left out."""
_MARGIN = 0.03
"""Width of the border of a tile, relative to its side, in which nothing whole ends."""
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


def plan_tiles(plan: Float64Array, side: float) -> Iterator[Tile]:
    """Divide a plan into tiles, each overlapped by a third with the next.

    Args:
        plan: horizontal coordinates of N Gaussians, (N, 2).
        side: of a tile, in scene units.
    """
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


_ALIKE = 0.6
"""IoU of their Gaussians from which on two candidates are alike."""
_MIN_ALIKE, _MIN_ALIKE_AT_ALL = 3, 2
"""Number of candidates that are alike from which on an object is sure, and named at all."""
_MIN_FREE = 0.7
"""Share of a candidate that no better one has taken, at least."""
_WITHIN = 0.9
"""Share of its Gaussians from which on one candidate is within another."""
_RAISED = 0.2
"""Height of a part's foot above that of the thing that it stands on, relative to the thing's height, at least."""
_MIN_SURE = 50
"""Objects of fewer Gaussians are not sure."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """What one look at one tile takes for an object, or several agree on."""

    rows: IntArray
    """Its Gaussians in the scene, (C,), ascending."""
    thing: FoundObject
    cut_off: bool
    """Its upper end was cut off with the ceiling."""
    reaches_ceiling: bool = False
    """What was cut off goes on up to the ceiling, as a wall does."""


def choose_objects(
    candidates: Sequence[Candidate], size: int, up: Float64Array, *, parts: bool = False
) -> list[Candidate]:
    """Choose objects that do not overlap among the candidates of all tiles, most agreed on first, groups of them last.

    Each is a candidate with those of its rows that no better one has, and what the agreement leaves of its confidence.

    Args:
        candidates: from all tiles, each whole within its tile.
        size: number of Gaussians of the scene, N.
        up: the up vector, (3,).
        parts: also name what stands on a thing that it lies within; the thing is then what is left of it.
    """
    if not candidates:
        return []
    common = _common(candidates, size)
    alike = _alike(common)
    counts = np.asarray(alike.sum(axis=1)).ravel().tolist()
    confidence = np.array([candidate.thing.confidence for candidate in candidates])
    shared = [float(np.median(confidence[row.indices])) for row in alike]
    agreed = [_agreed(*one) for one in zip(candidates, (one.rows for one in candidates), counts, shared, strict=True)]
    heights = np.array([one.thing.size[2] for one in candidates])
    feet = np.array([one.thing.centre @ up for one in candidates]) - heights / 2
    sure = np.array([one.thing.sure for one in agreed])
    groups, wholes, is_part = _groups_wholes_and_parts(common, sure, feet, heights)
    taken, found = np.zeros(size, np.bool_), []
    for place in np.lexsort((-common.diagonal(), -np.array(counts), wholes & parts, groups)).tolist():
        candidate = candidates[place]
        free = ~taken[candidate.rows]
        if (is_part[place] and not parts) or counts[place] < _MIN_ALIKE_AT_ALL or free.mean() < _MIN_FREE:
            continue
        rows = candidate.rows[free]
        taken[rows] = True
        found.append(_agreed(candidate, rows, counts[place], shared[place]))
    return found


def most_agreed_on(candidates: Sequence[Candidate], size: int) -> tuple[list[Candidate], int]:
    """Order candidates by how many are alike, smaller ones first among equals; one of those that are alike is kept.

    Also return how many are alike with the first one, itself among them; zero without candidates.

    Args:
        candidates: of tiles around one place.
        size: number of Gaussians of the scene, N.
    """
    if not candidates:
        return [], 0
    alike = _alike(_common(candidates, size))
    counts = np.asarray(alike.sum(axis=1)).ravel()
    lengths = np.array([len(candidate.rows) for candidate in candidates])
    left, kept = np.ones(len(candidates), np.bool_), []
    for place in np.lexsort((lengths, -counts)).tolist():
        if left[place]:
            kept.append(candidates[place])
            left[alike[place].indices] = False
    return kept, int(counts.max())


def _agreed(candidate: Candidate, rows: IntArray, count: int, confidence: float) -> Candidate:
    """Doubt what few tiles agree on, what is cut off, and what is too small to tell."""
    doubts = []
    if count < _MIN_ALIKE:
        doubts.append("outlined alike in few tiles")
    if candidate.reaches_ceiling:
        doubts.append("reaches up to the ceiling")
    if len(rows) < _MIN_SURE:
        doubts.append("small")
    confidence = min(confidence, DOUBTFUL) if doubts else confidence
    said = tuple(dict.fromkeys([*candidate.thing.doubts, *doubts])) or ("most tiles doubt it",)
    thing = replace(candidate.thing, confidence=confidence, doubts=() if confidence >= SURE else said)
    return replace(candidate, rows=rows, thing=thing)


def _common(candidates: Sequence[Candidate], size: int) -> csr_matrix:
    """Count the Gaussians that each two candidates have in common, (C, C)."""
    ends = np.cumsum([0, *(len(candidate.rows) for candidate in candidates)])
    indices = np.concatenate([candidate.rows for candidate in candidates])
    members = csr_matrix((np.ones(len(indices), np.int32), indices, ends), shape=(len(candidates), size))
    return (members @ members.T).tocsr()


def _alike(common: csr_matrix) -> csr_matrix:
    """Tell which candidates are alike, (C, C)."""
    lengths, pairs = common.diagonal(), common.tocoo()
    kept = pairs.data >= _ALIKE * (lengths[pairs.row] + lengths[pairs.col] - pairs.data)
    return csr_matrix((np.ones(kept.sum(), np.int32), (pairs.row[kept], pairs.col[kept])), shape=common.shape)


def _groups_wholes_and_parts(
    common: csr_matrix, sure: BoolArray, feet: Float64Array, heights: Float64Array
) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Tell which candidates hold sure things that are apart, which hold things that stand on them, and which are those.

    Each is (C,).

    Args:
        common: Gaussians that each two candidates have in common, (C, C).
        sure: which of them are sure, (C,).
        feet: where they begin along the up vector, (C,).
        heights: how high they are, (C,).
    """
    lengths = common.diagonal()
    groups, wholes, parts = (np.zeros(len(sure), np.bool_) for _ in range(3))
    for place, (start, end) in enumerate(pairwise(common.indptr)):
        others = common.indices[start:end]
        within = others[sure[others] & (common.data[start:end] >= _WITHIN * lengths[others])]
        raised = feet[within] > feet[place] + _RAISED * heights[place]
        beside = within[~raised]
        shared = common[beside][:, beside].toarray()
        groups[place] = (shared < (1 - _WITHIN) * np.minimum.outer(lengths[beside], lengths[beside])).any()
        if sure[place] and not groups[place]:
            wholes[place] = raised.any()
            parts[within[raised]] = True
    return groups, wholes, parts
