"""Numbers in few bits: levels, colours, rotations, codebooks and orders that the compressed formats have in common."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import SH_C0, BoolArray, Float64Array, FloatArray, Gaussians, IntArray, logit
from gaussian_trimmer.geometry.limits import LARGEST_LOG_SCALE

ByteArray = NDArray[np.uint8]
SMALLEST_SCALE = 1e-12
"""Scales of formats that store them linearly are read as no smaller than this, so that their logarithm is finite."""
_THINNESS = np.float32(np.log(1000.0))
CUT_TO_DEGREE_3 = "spherical harmonics are of degree 4; what is above degree 3 is left out"
ZERO_LOG_SCALE = -87.0
"""Log scales below this are those of zero: their exponential is no normal float32."""
_LLOYD_STEPS = 20
_FREE_COUNT, _BYTES_PER_GAUSSIAN = 1 << 16, 4
_CODEBOOK_SIZE = 256
"""Values in a codebook, so that an index is a byte."""
_BITS_OF_AN_AXIS = 21


def to_levels(values: NDArray[Any], low: Any, high: Any, bits: int) -> NDArray[np.uint32]:
    """The nearest of the 2^bits levels that divide [low, high] evenly, the ends included; values outside are clipped.

    >>> to_levels(np.array([-1.0, 0.2, 9.0]), 0.0, 1.0, 8).tolist()
    [0, 51, 255]
    """
    top = (1 << bits) - 1
    span = np.subtract(high, low, dtype=np.float64)
    shares = np.divide(values - np.float64(low), np.where(span > 0, span, 1.0))
    levels: NDArray[np.uint32] = np.rint(np.clip(shares, 0.0, 1.0) * top).astype(np.uint32)
    return levels


def from_levels(levels: NDArray[Any], low: Any, high: Any, bits: int) -> Float64Array:
    """Return the values of levels; the first and the last level give `low` and `high` exactly."""
    share = levels / np.float64((1 << bits) - 1)
    return np.asarray(low * (1.0 - share) + high * share)


def colours_of(sh_dc: FloatArray) -> FloatArray:
    """Colours, 0 to 1 where they are displayable, of degree-0 coefficients; without a view-dependent part."""
    return np.asarray(0.5 + SH_C0 * sh_dc, np.float32)


def sh_dc_of(colours: NDArray[Any]) -> FloatArray:
    """Return degree-0 coefficients of colours."""
    return np.asarray((colours - 0.5) / SH_C0, np.float32)


def opacity_bytes(gaussians: Gaussians) -> ByteArray:
    """Return opacities in 1/255, (N,)."""
    return to_levels(gaussians.opacities, 0.0, 1.0, 8).astype(np.uint8)


def opacity_logits_of(opacities: ByteArray) -> FloatArray:
    """Return logits of opacities in 1/255; 0 and 255, whose logits would be infinite, give -16.1 and +16.1."""
    return logit(opacities / 255.0).astype(np.float32)


def log_scales_of(scales: FloatArray, path: object) -> FloatArray:
    """Return logarithms of linear scales, none below that of `SMALLEST_SCALE`.

    Raises:
        InputError: a scale is negative.
    """
    negative = (scales < 0).any(axis=1)
    if negative.any():
        raise InputError(f"'{path}' is damaged: it holds a negative scale in row {int(np.argmax(negative))}.")
    return np.log(np.maximum(scales, np.float32(SMALLEST_SCALE)), dtype=np.float32)


def thicken_discs(log_scales: FloatArray) -> FloatArray:
    """Return the log scales (N, 3) of the discs of 2D Gaussian Splatting (N, 2): a thousandth of the smaller as normal.

    >>> thicken_discs(np.log(np.float32([[2, 1]]))).astype(float).round(2).tolist()
    [[0.69, 0.0, -6.91]]
    """
    return np.column_stack([log_scales, log_scales.min(axis=1) - _THINNESS])


def with_finite_limits(gaussians: Gaussians) -> Gaussians:
    """The Gaussians with infinite opacity logits and scales of zero as `opacity_logits_of` and `log_scales_of` give."""
    logits, log_scales = gaussians.opacity_logits, gaussians.log_scales
    if np.isinf(logits).any():
        gaussians = gaussians.replace(opacity_logits=finite_opacity_logits(logits))
    if (log_scales < ZERO_LOG_SCALE).any():
        gaussians = gaussians.replace(log_scales=finite_log_scales(log_scales))
    return gaussians


def finite_opacity_logits(logits: FloatArray) -> FloatArray:
    """Opacity logits with those of opacities 0 and 1 for infinite ones."""
    return np.where(np.isinf(logits), np.copysign(np.float32(logit(np.ones(1))[0]), logits), logits)


def finite_log_scales(log_scales: FloatArray) -> FloatArray:
    """Log scales with that of `SMALLEST_SCALE` for those of zero.

    Scales below `ZERO_LOG_SCALE` are zero in float32 too, or so near to it that nothing else can hold them.
    """
    return np.where(log_scales < ZERO_LOG_SCALE, np.float32(np.log(SMALLEST_SCALE)), log_scales)


def linear_scales(gaussians: Gaussians) -> FloatArray:
    """Scales, cut where they could not be read again, (N, 3)."""
    return np.exp(np.minimum(gaussians.log_scales, LARGEST_LOG_SCALE), dtype=np.float32)


def drop_largest(quaternions: FloatArray) -> tuple[IntArray, Float64Array]:
    """Return which component of each unit quaternion is the largest (N,), and the other three in order (N, 3).

    The sign is chosen so that the largest is positive, hence the three suffice; each lies within +-sqrt(1/2).
    """
    unit = quaternions.astype(np.float64)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    largest = np.argmax(np.abs(unit), axis=1)
    unit *= np.where(np.take_along_axis(unit, largest[:, None], axis=1) < 0, -1.0, 1.0)
    kept = np.arange(4) != largest[:, None]
    return largest, unit[kept].reshape(-1, 3)


def restore_largest(largest: NDArray[Any], others: Float64Array) -> FloatArray:
    """Return unit quaternions (N, 4) of the index of the largest component (N,) and the other three (N, 3).

    >>> restore_largest(np.array([2]), np.array([[0.0, 0.6, 0.0]])).tolist()
    [[0.0, 0.6000000238418579, 0.800000011920929, 0.0]]
    """
    quaternions = np.empty((len(others), 4))
    kept = np.arange(4) != largest[:, None]
    quaternions[kept] = others.ravel()
    quaternions[~kept] = np.sqrt(np.maximum(0.0, 1.0 - (others**2).sum(axis=1)))
    return quaternions.astype(np.float32)


def scalar_codebook(values: FloatArray) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Return a rising codebook (256,) for values of any shape, and the index of the nearest entry for each value.

    Lloyd's algorithm in one dimension on the sorted values. No more distinct values than entries are held exactly.

    >>> codebook, labels = scalar_codebook(np.float32([[1, 5], [5, 2]]))
    >>> codebook[labels].tolist()
    [[1.0, 5.0], [5.0, 2.0]]
    """
    ordered = np.sort(values, axis=None).astype(np.float64)
    distinct = ordered[np.diff(ordered, prepend=-np.inf) > 0]
    if len(distinct) <= _CODEBOOK_SIZE:
        centres = np.pad(distinct, (0, _CODEBOOK_SIZE - len(distinct)), mode="edge")
    else:
        centres = _lloyd(ordered, _CODEBOOK_SIZE)
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


def morton_order(means: FloatArray) -> IntArray:
    """Row numbers (N,) that put centres (N, 3) in Morton order; equal centres keep their order.

    >>> morton_order(np.float32([[0, 0, 0], [9, 9, 9], [1, 0, 0], [9, 9, 8]])).tolist()
    [0, 2, 3, 1]
    """
    levels = to_levels(means, means.min(axis=0), means.max(axis=0), _BITS_OF_AN_AXIS).astype(np.uint64)
    codes = np.zeros(len(means), np.uint64)
    for bit in range(_BITS_OF_AN_AXIS):
        for axis in range(3):
            codes |= (levels[:, axis] >> np.uint64(bit) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(codes, kind="stable")


def check_count(count: int, path: Path, size: int | None = None) -> None:
    """Refuse a count of Gaussians that a compressed file of this size cannot hold, before memory is taken for it.

    Centres are noise to a compressor: real files spend five bytes and more on a Gaussian. Four bytes each, beyond a
    first 65,536 that cost little, let every real file pass and bound what a crafted one can make us allocate.

    Args:
        count: what the file announces.
        path: the file.
        size: bytes that hold the Gaussians, where that is not the file's own size.

    Raises:
        InputError: the count is zero or beyond what the file's size allows.
    """
    if count <= 0:
        raise InputError(f"'{path}' holds zero Gaussians.")
    size = path.stat().st_size if size is None else size
    if count > _FREE_COUNT + size // _BYTES_PER_GAUSSIAN:
        raise InputError(f"'{path}' is damaged: it announces {count} Gaussians in a file of {size} bytes.")
