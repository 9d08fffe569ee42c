"""What is found alike in several tiles is an object; of several that overlap, the one that most tiles agree on.

A tile shows a thing among other neighbours, from other sides and at another size than the tile beside it. What comes
out the same each time stands by itself; what a border cut, or what only one tile joined to its neighbour, does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_matrix

from gaussian_trimmer.finding.judging import DOUBTFUL, Verdict
from gaussian_trimmer.gaussians import Float64Array, IntArray

_ALIKE = 0.6
"""IoU of their Gaussians from which on two candidates are alike."""
_MIN_ALIKE, _MIN_ALIKE_AT_ALL = 3, 2
"""Number of candidates that are alike from which on an object is sure, and named at all."""
_MIN_FREE = 0.7
"""Share of a candidate that no better one has taken, at least."""
_MIN_GAUSSIANS = 50
"""Objects of fewer Gaussians are not sure."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """What one look at one tile takes for an object, or several agree on."""

    rows: IntArray
    """Its Gaussians in the scene, (C,), ascending."""
    verdict: Verdict
    centre: Float64Array
    """Middle of its box in the scene, (3,)."""
    size: Float64Array
    """Size of the box along two horizontal axes and up, (3,)."""
    reaches_cut: bool
    """Its upper end was cut off with the ceiling."""

    @property
    def confidence(self) -> float:
        """How sure it is, 0 to 1."""
        return self.verdict.confidence


def agree(candidates: Sequence[Candidate], size: int) -> list[Candidate]:
    """Choose objects that do not overlap among the candidates of all tiles, most agreed on first.

    Each is a candidate with those of its rows that no better one has, and the verdict that the agreement leaves.

    Args:
        candidates: from all tiles, each whole within its tile.
        size: number of Gaussians of the scene, N.
    """
    if not candidates:
        return []
    alike = _alike(candidates, size)
    counts = np.asarray(alike.sum(axis=1)).ravel()
    lengths = np.array([len(candidate.rows) for candidate in candidates])
    confidence = np.array([candidate.confidence for candidate in candidates])
    taken, found = np.zeros(size, np.bool_), []
    for place in np.lexsort((-lengths, -counts)).tolist():
        if counts[place] < _MIN_ALIKE_AT_ALL:
            break
        candidate = candidates[place]
        free = ~taken[candidate.rows]
        if free.mean() < _MIN_FREE:
            continue
        rows = candidate.rows[free]
        taken[rows] = True
        best = float(confidence[alike[place].indices].max())
        found.append(_agreed(candidate, rows, int(counts[place]), best))
    return found


def _agreed(candidate: Candidate, rows: IntArray, count: int, confidence: float) -> Candidate:
    """Doubt what few tiles agree on, what is cut off, and what is too small to tell."""
    doubts = []
    if count < _MIN_ALIKE:
        doubts.append("found alike in few tiles")
    if candidate.reaches_cut:
        doubts.append("reaches up to where the ceiling was cut off")
    if len(rows) < _MIN_GAUSSIANS:
        doubts.append("small")
    confidence = min(confidence, DOUBTFUL) if doubts else confidence
    why = ", ".join([candidate.verdict.why, *doubts])
    verdict = replace(candidate.verdict, confidence=confidence, why=why)
    return replace(candidate, rows=rows, verdict=verdict)


def _alike(candidates: Sequence[Candidate], size: int) -> csr_matrix:
    """Tell which candidates are alike, (C, C)."""
    lengths = np.array([len(candidate.rows) for candidate in candidates])
    ends = np.concatenate([[0], np.cumsum(lengths)])
    indices = np.concatenate([candidate.rows for candidate in candidates])
    members = csr_matrix((np.ones(len(indices), np.int32), indices, ends), shape=(len(candidates), size))
    common = (members @ members.T).tocoo()
    union = lengths[common.row] + lengths[common.col] - common.data
    kept = common.data >= _ALIKE * union
    shape = (len(candidates), len(candidates))
    return csr_matrix((np.ones(kept.sum(), np.int32), (common.row[kept], common.col[kept])), shape=shape)
