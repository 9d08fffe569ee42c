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

import numpy as np

from gaussian_trimmer.gaussians import SH_C0, Float64Array, FloatArray, Gaussians, IntArray, sigmoid
from gaussian_trimmer.selection_files.splat_rows import SplatRows

UNMATCHED = -1
_PLACE, _EXTENT = 0.5, 1 / 2000
_SIZE = np.log(1.3)
_COLOUR = 0.08
_CANDIDATES = 24
_ROUNDS = 24
_PARENT_REACH = 2.0
_ROWS_PER_CHUNK = 1 << 15
_ENDS = (0.01, 0.99)


def match_nearest(rows: SplatRows, wanted: IntArray, gaussians: Gaussians, free: IntArray) -> IntArray:
    """Scene row of some rows of a file, (W,), -1 for none; each free scene row is used once at most.

    Args:
        wanted: numbers of the file's rows that are to be matched, (W,).
        free: scene rows that may be used, (F,).
    """
    from gaussian_trimmer.geometry.kd_tree import nearest  # Loads Numba, which reading most files does without.

    found = np.full(len(wanted), UNMATCHED, np.int64)
    places, features = _features_of_rows(rows, wanted)
    if features is None or not len(wanted) or not len(free):
        return found
    scene = gaussians.select(free)
    theirs = _features(scene)
    reach = np.maximum(_PLACE * np.exp(scene.log_scales.max(axis=1)), _EXTENT * _extent(gaussians.means))
    pairs, costs = [], []
    k = min(_CANDIDATES, len(free))
    for start in range(0, len(wanted), _ROWS_PER_CHUNK):
        part = slice(start, start + _ROWS_PER_CHUNK)
        squared, beside = nearest(scene.means, places[part], k)
        apart = np.sqrt(squared) / reach[beside]
        different = np.abs(features[part][:, None] - theirs[beside]).max(axis=2)
        cost = np.maximum(apart, different)
        row, place = np.nonzero(cost <= 1)
        pairs.append(np.column_stack([row + start, beside[row, place]]))
        # Of partners within the tolerance the one that is nearest in everything counts.
        costs.append(apart[row, place] ** 2 + different[row, place] ** 2)
    partners, cost = np.concatenate(pairs), np.concatenate(costs)
    for mine, other in _assigned(partners, cost, len(free)):
        found[mine] = free[other]
    return found


def match_children(rows: SplatRows, wanted: IntArray, gaussians: Gaussians) -> IntArray:
    """Scene row of the Gaussian of which each of some rows of a file may be a part, (W,), -1 for none."""
    from gaussian_trimmer.geometry.kd_tree import nearest  # Loads Numba, which reading most files does without.

    found = np.full(len(wanted), UNMATCHED, np.int64)
    places, features = _features_of_rows(rows, wanted)
    if features is None or not len(wanted):
        return found
    theirs, largest = _features(gaussians), np.exp(gaussians.log_scales.max(axis=1))
    k = min(_CANDIDATES, len(gaussians))
    for start in range(0, len(wanted), _ROWS_PER_CHUNK):
        part = slice(start, start + _ROWS_PER_CHUNK)
        squared, beside = nearest(gaussians.means, places[part], k)
        apart = np.sqrt(squared) / (_PARENT_REACH * largest[beside])
        different = features[part][:, None] - theirs[beside]
        colour = np.abs(different[..., 3:6]).max(axis=2)
        larger = different[..., :3].max(axis=2)
        cost = np.where((apart <= 1) & (colour <= 1) & (larger <= 1), apart + colour, np.inf)
        best = cost.argmin(axis=1)
        at = np.arange(len(best))
        found[part] = np.where(np.isfinite(cost[at, best]), beside[at, best], UNMATCHED)
    return found


def _assigned(pairs: IntArray, costs: Float64Array, n: int) -> list[tuple[IntArray, IntArray]]:
    """Pairs (P, 2) of which each number, on either side, occurs once: the cheapest first, as far as rounds allow."""
    order = np.lexsort((pairs[:, 1], pairs[:, 0], costs))
    pairs = pairs[order]
    chosen = []
    for _ in range(_ROUNDS):
        if not len(pairs):
            break
        _, first = np.unique(pairs[:, 0], return_index=True)
        best = pairs[np.sort(first)]  # the cheapest of each row, in order of cost
        _, first = np.unique(best[:, 1], return_index=True)
        taken = best[first]
        chosen.append((taken[:, 0], taken[:, 1]))
        pairs = pairs[~np.isin(pairs[:, 0], taken[:, 0]) & ~np.isin(pairs[:, 1], taken[:, 1])]
    return chosen


def _features(gaussians: Gaussians) -> FloatArray:
    """Sorted sizes, colour and opacity, each in units of its tolerance, (N, 7)."""
    return _scaled(gaussians.log_scales, gaussians.sh_dc, gaussians.opacity_logits)


def _features_of_rows(rows: SplatRows, wanted: IntArray) -> tuple[FloatArray, FloatArray | None]:
    """Places (W, 3) and features (W, 7) of some rows; no features where the file lacks an attribute."""
    columns = rows.attributes
    places = np.column_stack([np.asarray(columns[axis][wanted], np.float32) for axis in "xyz"])
    names = [*(f"scale_{i}" for i in range(3)), *(f"f_dc_{i}" for i in range(3)), "opacity"]
    if any(name not in columns for name in names):
        return places, None
    table = np.column_stack([np.asarray(columns[name][wanted], np.float32) for name in names])
    table = np.nan_to_num(table, nan=1e6, posinf=1e6, neginf=-1e6)
    places = np.nan_to_num(places, nan=1e15, posinf=1e15, neginf=-1e15)
    return places, _scaled(table[:, :3], table[:, 3:6], table[:, 6])


def _scaled(log_scales: FloatArray, sh_dc: FloatArray, logits: FloatArray) -> FloatArray:
    sizes = np.sort(np.clip(log_scales, -30, 30), axis=1) / _SIZE
    colours = np.clip(0.5 + SH_C0 * sh_dc, 0, 1) / _COLOUR
    opacities = sigmoid(np.asarray(logits, np.float32))[:, None] / _COLOUR
    return np.asarray(np.concatenate([sizes, colours, opacities], axis=1), np.float32)


def _extent(means: FloatArray) -> float:
    low, high = np.quantile(means, _ENDS, axis=0)
    return float(np.linalg.norm(high - low))
