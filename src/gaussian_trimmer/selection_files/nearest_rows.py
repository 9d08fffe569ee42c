"""Which scene row a Gaussian of another file is, where its numbers were rounded, normalised, moved a little or split.

Editors and compressed formats change the last digits, and a trim's own objects have children of split Gaussians. So
the nearest Gaussian is taken, in place, size, colour and opacity together, within tolerances:

- place: half the scene Gaussian's largest standard deviation, or a two-thousandth of the scene's extent if that is more
- size: a factor of 1.3 in each of the sorted standard deviations
- colour and opacity: 0.08 of their range from 0 to 1

What has no partner there may be a child: it lies within two standard deviations of its parent, is no larger than it,
and has its colour within 0.08.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gaussian_trimmer.gaussians import SH_C0, Float64Array, FloatArray, Gaussians, IntArray, sigmoid
from gaussian_trimmer.geometry.neighbours import nearest
from gaussian_trimmer.selection_files.splat_rows import Columns, SplatRows, gaussian_columns

UNMATCHED = -1
_PLACE, _EXTENT = 0.5, 1 / 2000
_SIZE = np.log(1.3)
_COLOUR = 0.08
_CANDIDATES = 24
_ROUNDS = 24
_PARENT_REACH = 2.0
_ROWS_PER_CHUNK = 1 << 15
_ENDS = (0.01, 0.99)
_FEATURES = (*(f"scale_{i}" for i in range(3)), *(f"f_dc_{i}" for i in range(3)), "opacity")


def match_nearest(rows: SplatRows, wanted: IntArray, gaussians: Gaussians, free: IntArray) -> IntArray:
    """Scene row of some rows of a file, (W,), -1 for none; each free scene row is used once at most.

    Args:
        rows: the file's rows.
        wanted: numbers of the file's rows that are to be matched, (W,).
        gaussians: the scene.
        free: scene rows that may be used, (F,).
    """
    found = np.full(len(wanted), UNMATCHED, np.int64)
    scene = gaussians.select(free)
    reach = np.maximum(_PLACE * np.exp(scene.log_scales.max(axis=1)), _EXTENT * _extent(gaussians.means))
    pairs, costs = [np.zeros((0, 2), np.int64)], [np.zeros(0)]
    for part, beside, distances, differences in _neighbours(rows, wanted, scene):
        apart, different = distances / reach[beside], np.abs(differences).max(axis=2)
        row, place = np.nonzero(np.maximum(apart, different) <= 1)
        pairs.append(np.column_stack([row + part.start, beside[row, place]]))
        # Of partners within the tolerance the one that is nearest in everything counts.
        costs.append(apart[row, place] ** 2 + different[row, place] ** 2)
    for mine, other in _assigned(np.concatenate(pairs), np.concatenate(costs)):
        found[mine] = free[other]
    return found


def match_children(rows: SplatRows, wanted: IntArray, gaussians: Gaussians, free: IntArray) -> IntArray:
    """Scene row of the Gaussian of which each of some rows of a file may be a part, (W,), -1 for none.

    Args as those of `match_nearest`, but a Gaussian may have several parts, so none is taken.
    """
    found = np.full(len(wanted), UNMATCHED, np.int64)
    largest = np.exp(gaussians.log_scales.max(axis=1))
    for part, beside, distances, differences in _neighbours(rows, wanted, gaussians):
        apart = distances / (_PARENT_REACH * largest[beside])
        colour, larger = np.abs(differences[..., 3:6]).max(axis=2), differences[..., :3].max(axis=2)
        cost = np.where((apart <= 1) & (colour <= 1) & (larger <= 1), apart + colour, np.inf)
        best = cost.argmin(axis=1)[:, None]
        fits = np.isfinite(np.take_along_axis(cost, best, axis=1))
        found[part] = np.where(fits, np.take_along_axis(beside, best, axis=1), UNMATCHED)[:, 0]
    return found


def _neighbours(
    rows: SplatRows, wanted: IntArray, scene: Gaussians
) -> Iterator[tuple[slice, IntArray, Float64Array, FloatArray]]:
    """Of a part of the wanted rows at a time, (C,): the nearest rows of the scene, (C, K), their distances, (C, K), and
    by how much sizes, colours and opacity exceed theirs, in tolerances, (C, K, 7).

    Nothing where the file lacks an attribute.
    """
    if not len(wanted) or not len(scene) or any(name not in rows.attributes for name in _FEATURES):
        return
    mine, theirs = _features(rows.attributes, wanted), _features(gaussian_columns(scene), slice(None))
    places = np.column_stack([np.asarray(rows.attributes[axis][wanted], np.float32) for axis in "xyz"])
    places = np.nan_to_num(places, nan=1e15, posinf=1e15, neginf=-1e15)
    for start in range(0, len(wanted), _ROWS_PER_CHUNK):
        part = slice(start, start + _ROWS_PER_CHUNK)
        squared, beside = nearest(scene.means, places[part], min(_CANDIDATES, len(scene)))
        yield part, beside.astype(np.int64), np.sqrt(squared), mine[part][:, None] - theirs[beside]


def _features(columns: Columns, rows: IntArray | slice) -> FloatArray:
    """Sorted sizes, colour and opacity of some rows, each in units of its tolerance, (R, 7)."""
    table = np.column_stack([np.asarray(columns[name][rows], np.float32) for name in _FEATURES])
    table = np.nan_to_num(table, nan=1e6, posinf=1e6, neginf=-1e6)
    sizes = np.sort(np.clip(table[:, :3], -30, 30), axis=1) / _SIZE
    colours = np.clip(0.5 + SH_C0 * table[:, 3:6], 0, 1) / _COLOUR
    opacities = sigmoid(table[:, 6])[:, None] / _COLOUR
    return np.asarray(np.concatenate([sizes, colours, opacities], axis=1), np.float32)


def _assigned(pairs: IntArray, costs: Float64Array) -> list[tuple[IntArray, IntArray]]:
    """Pairs (P, 2) of which each number, on either side, occurs once: the cheapest first, as far as rounds allow."""
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0], costs))]
    chosen = []
    for _ in range(_ROUNDS):
        _, first = np.unique(pairs[:, 0], return_index=True)
        best = pairs[np.sort(first)]  # the cheapest of each row, in order of cost
        _, first = np.unique(best[:, 1], return_index=True)
        taken = best[first]
        chosen.append((taken[:, 0], taken[:, 1]))
        pairs = pairs[~np.isin(pairs[:, 0], taken[:, 0]) & ~np.isin(pairs[:, 1], taken[:, 1])]
    return chosen


def _extent(means: FloatArray) -> float:
    low, high = np.quantile(means, _ENDS, axis=0)
    return float(np.linalg.norm(high - low))
