"""Which label each Gaussian gets from the blend weights that it has under the labels of pixels.

The optimal assignment of "FlashSplat: 2D to 3D Gaussian Splatting Segmentation Solved Optimally" (Shen et al.,
ECCV 2024), section 3.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import IntArray

_ROWS_PER_CHUNK = 1 << 16


def assign_labels(weights: NDArray[Any], gamma: float = 0.0) -> IntArray:
    """Return label of the largest weight in each row of (N, L), after rows are scaled to unit length, as (N,).

    Args:
        weights: blend weight of each Gaussian, summed over the pixels of each label; label 0 is the background.
        gamma: background bias, added to the scaled weight of label 0: positive values select less, negative ones more.

    Ties go to the lower label. Gaussians without any weight, which no view saw, are background whatever gamma is.

    >>> assign_labels(np.array([[3.0, 4.0], [4.0, 3.0], [0.0, 0.0]])).tolist()
    [1, 0, 0]
    >>> assign_labels(np.array([[3.0, 4.0], [4.0, 3.0], [0.0, 0.0]]), gamma=-0.3).tolist()
    [1, 1, 0]
    """
    labels = np.zeros(len(weights), np.int64)
    for start in range(0, len(labels), _ROWS_PER_CHUNK):
        rows = slice(start, start + _ROWS_PER_CHUNK)
        scaled = np.array(weights[rows], np.float64)
        lengths = np.linalg.norm(scaled, axis=1)
        seen = lengths > 0
        scaled[seen] /= lengths[seen, None]
        scaled[:, 0] += gamma
        labels[rows] = np.where(seen, scaled.argmax(axis=1), 0)
    return labels
