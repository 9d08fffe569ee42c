"""Nearest neighbours by SciPy's k-d tree, with ties in a fixed order."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import Float64Array, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

_WIDER = 4
"""Factor by which more neighbours are asked for where the last one ties with the next."""
_CELLS_ACROSS = 32
"""Cells of the interquartile range along an axis, by which points are sorted."""


def nearest(
    points: FloatArray | Float64Array,  # (N, D)
    queries: FloatArray | Float64Array,  # (Q, D)
    k: int,
    reach: float = np.inf,
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Return squared distances (Q, k) and indices (Q, k) of the k nearest points of each query, nearest first.

    Equally near points are ordered by index. Where fewer than k points are closer than `reach`, the last columns hold
    infinity and the index -1.

    >>> points = np.float32([[0.0, 0.0], [3.0, 4.0]])
    >>> nearest(points, points[:1], 2)[0].tolist()
    [[0.0, 25.0]]
    >>> nearest(points, points[:1], 2, reach=4.0)[0].tolist()
    [[0.0, inf]]
    """
    from scipy.spatial import cKDTree  # takes longer to import than most commands that search nothing

    points, queries = np.asarray(points, np.float64), np.asarray(queries, np.float64)
    squared, indices = np.full((len(queries), k), np.inf, np.float32), np.full((len(queries), k), -1, np.int32)
    if not len(points) or not len(queries):
        return squared, indices
    numbers, order = _by_cells(points), _by_cells(queries)
    tree, queries = cKDTree(points[numbers]), queries[order]
    numbers = np.append(numbers, -1)
    distances, found = _ask(tree, numbers, queries, k + 1, reach)
    tied = np.flatnonzero((distances[:, k - 1] == distances[:, k]) & np.isfinite(distances[:, k]))
    if len(tied):  # Which of them are among the k hangs on the tree.
        wider = _ask(tree, numbers, queries[tied], _WIDER * (k + 1), reach)
        distances[tied, :k], found[tied, :k] = (values[:, :k] for values in wider)
    squared[order], indices[order] = np.square(distances[:, :k]), found[:, :k]
    return squared, indices


def _by_cells(points: Float64Array) -> IntArray:
    """Return an order in which points (N, D) are near those before them: searches find more in the cache, (N,)."""
    low, high = np.quantile(points[:: 1 + len(points) // 1000, :3], [0.25, 0.75], axis=0)
    sizes = np.maximum((high - low) / _CELLS_ACROSS, 1e-300)
    with np.errstate(over="ignore"):  # a plane has no thickness, but may have an outlier
        cells = np.floor((points[:, :3] - low) / sizes)
    return np.lexsort(np.clip(cells, -1000, 1000).astype(np.int16).T)


def _ask(
    tree: cKDTree, numbers: IntArray, queries: Float64Array, k: int, reach: float
) -> tuple[Float64Array, IntArray]:
    """Return distances (Q, k) of the nearest and their numbers (Q, k), in the order of both."""
    columns, threads = [*range(1, k + 1)], numba.get_num_threads()
    found: tuple[Any, Any] = tree.query(queries, columns, distance_upper_bound=reach, workers=threads)
    distances, indices = found[0], numbers[found[1]]
    rows = np.flatnonzero((distances[:, 1:] == distances[:, :-1]).any(axis=1))
    order = np.lexsort((indices[rows], distances[rows]))
    distances[rows] = np.take_along_axis(distances[rows], order, axis=1)
    indices[rows] = np.take_along_axis(indices[rows], order, axis=1)
    return distances, indices
