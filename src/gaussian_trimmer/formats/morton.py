"""Rows in the order of a space-filling curve, so that neighbours in the file are neighbours in space."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.formats.packing import to_levels
from gaussian_trimmer.gaussians import FloatArray, IntArray

_BITS_OF_AN_AXIS = 21


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
