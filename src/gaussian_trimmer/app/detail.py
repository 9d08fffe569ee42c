"""Which Gaussians of a large scene are shown: all that are near, and fewer of what is far. N Gaussians."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, IntArray

_BESIDE_PICTURE = 0.05
"""How much what lies outside the picture counts; it is there when the view turns, until it is refined."""
_PICTURE_MARGIN = 0.1
"""What counts as the picture, beyond its edges, relative to its size."""
_NEAREST = 0.05
"""Distance below which all counts the same, relative to the median distance."""
_ROUNDS = 40


def thinned(means: FloatArray, visible: BoolArray, most: int, eye: Camera | None = None) -> tuple[IntArray, FloatArray]:
    """Rows of at most about `most` of the visible Gaussians, and by how much the variance of each grows, (M,) each.

    Each is drawn by its importance: at random, but the same every time, so that little changes as the eye moves.
    Surfaces stay closed where areas grow as numbers shrink.

    Args:
        means: centres, (N, 3).
        visible: which may be shown, (N,).
        most: number of Gaussians that there is room for.
        eye: what is in its picture and near counts more; None: all count the same.
    """
    rows = np.flatnonzero(visible)
    if len(rows) <= most:
        return rows, np.ones(len(rows), np.float32)
    weights = np.ones(len(rows)) if eye is None else _importance(means[rows].astype(np.float64), eye)
    chances = _chances(weights, most)
    drawn = np.random.default_rng(0).random(len(visible))[rows] < chances
    return rows[drawn], (1 / chances[drawn]).astype(np.float32)


def _importance(points: Float64Array, eye: Camera) -> Float64Array:
    """How much points (M, 3) count: as their area in the picture, (M,)."""
    distances = np.linalg.norm(points - eye.centre, axis=1)
    weights = 1 / np.maximum(distances, _NEAREST * max(float(np.median(distances)), 1e-9)) ** 2
    pixels, depths = eye.project(points)
    size = np.array([eye.width, eye.height])
    with np.errstate(invalid="ignore"):  # NaN behind the camera, which no comparison lets through
        within = ((pixels > -_PICTURE_MARGIN * size) & (pixels < (1 + _PICTURE_MARGIN) * size)).all(axis=1)
    return np.asarray(weights * np.where(within & (depths > 0), 1.0, _BESIDE_PICTURE))


def _chances(weights: Float64Array, most: int) -> Float64Array:
    """Chances at most 1, otherwise in proportion to weights, whose sum is about `most`, (M,)."""
    low, high = 0.0, most / float(weights.min())
    for _ in range(_ROUNDS):
        middle = (low + high) / 2
        low, high = (middle, high) if np.minimum(1, middle * weights).sum() < most else (low, middle)
    return np.asarray(np.minimum(1, low * weights))
