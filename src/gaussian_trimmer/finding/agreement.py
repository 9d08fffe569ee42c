"""What is found alike in several tiles is an object; of several that overlap, the one that most tiles agree on.

A group of things comes after them: a table with its chairs, of which two are sure by themselves. What stands on a thing
that it lies within, as a cushion on a sofa, is a part of it.

A tile shows a thing among other neighbours, from other sides and at another size than the tile beside it. What comes
out the same each time stands by itself; what a border cut, or what only one tile joined to its neighbour, does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_matrix

from gaussian_trimmer.finding.found import SURE, FoundObject
from gaussian_trimmer.finding.judging import DOUBTFUL
from gaussian_trimmer.gaussians import BoolArray, Float64Array, IntArray

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
_MIN_GAUSSIANS = 50
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


def most_agreed_on(candidates: Sequence[Candidate], size: int) -> list[Candidate]:
    """Order candidates by how many are alike, smaller ones first among equals; one of those that are alike is kept.

    Args:
        candidates: of tiles around one place.
        size: number of Gaussians of the scene, N.
    """
    if not candidates:
        return []
    alike = _alike(_common(candidates, size))
    counts = np.asarray(alike.sum(axis=1)).ravel()
    lengths = np.array([len(candidate.rows) for candidate in candidates])
    left, kept = np.ones(len(candidates), np.bool_), []
    for place in np.lexsort((lengths, -counts)).tolist():
        if left[place]:
            kept.append(candidates[place])
            left[alike[place].indices] = False
    return kept


def _agreed(candidate: Candidate, rows: IntArray, count: int, confidence: float) -> Candidate:
    """Doubt what few tiles agree on, what is cut off, and what is too small to tell."""
    doubts = []
    if count < _MIN_ALIKE:
        doubts.append("found alike in few tiles")
    if candidate.reaches_ceiling:
        doubts.append("reaches up to the ceiling")
    if len(rows) < _MIN_GAUSSIANS:
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
