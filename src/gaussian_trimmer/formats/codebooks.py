"""Codebooks: few values, or few rows, that stand for many, each chosen where the many lie."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, IntArray

_LLOYD_STEPS = 20
_SIZE = 256
"""Values in a codebook, so that an index is a byte."""


def scalar_codebook(values: FloatArray) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Return a rising codebook (256,) for values of any shape, and the index of the nearest entry for each value.

    Lloyd's algorithm in one dimension on the sorted values. No more distinct values than entries are held exactly.

    >>> codebook, labels = scalar_codebook(np.float32([[1, 5], [5, 2]]))
    >>> codebook[labels].tolist()
    [[1.0, 5.0], [5.0, 2.0]]
    """
    ordered = np.sort(values, axis=None).astype(np.float64)
    distinct = ordered[np.diff(ordered, prepend=-np.inf) > 0]
    if len(distinct) <= _SIZE:
        centres = np.pad(distinct, (0, _SIZE - len(distinct)), mode="edge")
    else:
        centres = _lloyd(ordered, _SIZE)
    codebook = centres.astype(np.float32)
    # Left of the midpoint belongs to the lower entry, so that repeated last entries are never used.
    return codebook, np.searchsorted(_midpoints(codebook), values).astype(np.uint8)


def row_codebook(rows: FloatArray, size: int) -> tuple[FloatArray, IntArray]:
    """At most `size` rows that stand for rows (N, D), and the index of the one for each row, (N,).

    Tree-structured vector quantisation: cells are cut at their mean along their widest axis, those of the largest
    squared error first, until there are enough. Deterministic; no more distinct rows than `size` are held exactly.
    """
    if len(rows) <= size:
        return rows, np.arange(len(rows))
    labels = np.zeros(len(rows), np.int64)
    count = 1
    active = np.arange(len(rows))  # rows of cells that the last round made; all others are final
    while len(active) and count < size:
        _, cells = np.unique(labels[active], return_inverse=True)
        right, cut = _cut_cells(rows[active], cells, size - count)
        moved = right & cut[cells]
        labels[active[moved]] = (count + np.cumsum(cut) - 1)[cells[moved]]
        count += int(cut.sum())
        active = active[cut[cells]]
    means = [np.bincount(labels, column) / np.bincount(labels) for column in rows.T]
    return np.stack(means, axis=1).astype(np.float32), labels


def _cut_cells(rows: FloatArray, cells: IntArray, n_more: int) -> tuple[BoolArray, BoolArray]:
    """Which rows (A, D) lie right of their cell's cut, (A,), and which cells are to be cut, at most `n_more`, (C,)."""
    counts = np.bincount(cells)
    means = np.empty((len(counts), rows.shape[1]))
    variances = np.empty_like(means)
    for d, column in enumerate(rows.T.astype(np.float64)):
        means[:, d] = np.bincount(cells, column) / counts
        variances[:, d] = np.bincount(cells, (column - means[cells, d]) ** 2) / counts
    axes = np.argmax(variances, axis=1)
    right: BoolArray = rows[np.arange(len(rows)), axes[cells]] > means[cells, axes[cells]]
    n_right = np.bincount(cells, right)
    divisible = (n_right > 0) & (n_right < counts)
    order = np.argsort(-np.where(divisible, variances.sum(axis=1) * counts, -1.0), kind="stable")
    cut = np.zeros(len(counts), np.bool_)
    cut[order[:n_more]] = True
    return right, cut & divisible


def _lloyd(ordered: Float64Array, size: int) -> Float64Array:
    """Centres of `size` cells of sorted values, each the mean of the values nearest to it.

    A cell without values is given up for a second one at the upper end of a cell of large squared error.
    """
    sums = np.concatenate([[0.0], np.cumsum(ordered)])
    squares = np.concatenate([[0.0], np.cumsum(ordered**2)])
    centres = np.linspace(ordered[0], ordered[-1], size)
    for _ in range(_LLOYD_STEPS):
        ends = np.concatenate([[0], np.searchsorted(ordered, _midpoints(centres)), [len(ordered)]])
        counts = np.diff(ends)
        kept = np.flatnonzero(counts)
        means = np.diff(sums[ends])[kept] / counts[kept]
        errors = np.diff(squares[ends])[kept] - counts[kept] * means**2
        worst = kept[np.argsort(-errors, kind="stable")[: size - len(kept)]]
        centres = np.sort(np.concatenate([means, ordered[ends[worst + 1] - 1]]))
        centres = np.pad(centres, (0, size - len(centres)), mode="edge")
    return centres


def _midpoints(centres: NDArray[Any]) -> Float64Array:
    return np.asarray(0.5 * (centres[1:].astype(np.float64) + centres[:-1]))
