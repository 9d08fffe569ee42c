"""Distances between pixels of a mask (H, W) and its edge."""

from __future__ import annotations

import cv2
import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array


def distance_to_outside(mask: BoolArray, beyond: bool = True) -> Float64Array:
    """Return the distance of every pixel to the nearest one outside a mask (H, W) in pixels, (H, W); zero outside.

    OpenCV's last bits depend on the processor and, with one thread, on the call; the squares are whole numbers, and
    the same always.

    Args:
        mask: the pixels inside.
        beyond: whether the mask goes on beyond the picture; otherwise the picture's frame is outside.

    >>> distance_to_outside(np.ones((3, 5), bool), beyond=False)[1].tolist()
    [1.0, 2.0, 2.0, 2.0, 1.0]
    """
    framed = mask if beyond else np.pad(mask, 1)
    distance = cv2.distanceTransform(framed.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    exact = np.sqrt(np.rint(np.square(distance, dtype=np.float64)))
    return exact if beyond else exact[1:-1, 1:-1]
