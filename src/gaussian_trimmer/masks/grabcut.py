"""OpenCV's GrabCut, started from the silhouettes of the corrected labels: what the paper's preset uses without SAM."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.views.view import View, ViewMasks, bounding_box, box_slices

_ITERATIONS = 3
"""Alternations between fitting the colour models and cutting the graph."""
_INNER, _OUTER = 0.03, 0.05
"""Depth inside the silhouette from which on pixels are certainly object, and distance outside of it from which on they
are certainly background, relative to its size."""
_WINDOW_MARGIN, _WINDOW_MARGIN_PIXELS = 0.1, 5
"""Margin of the window that is segmented, relative to the silhouette's size, and what is added to it in pixels."""


def grabcut_masks(views: Sequence[View]) -> ViewMasks:
    """Return each view's camera with a mask (H, W): colour models of object and background, and a cut between them.

    "GrabCut: Interactive Foreground Extraction using Iterated Graph Cuts" (Rother et al., SIGGRAPH 2004).
    """
    return [(view.camera, _segment(view)) for view in views]


def _segment(view: View) -> BoolArray:
    mask, silhouette = np.zeros(view.alpha.shape, np.bool_), view.silhouette.astype(np.uint8)
    if not silhouette.any():
        return mask
    size = float(np.sqrt(silhouette.sum()))
    near = np.asarray(cv2.dilate(silhouette, _disk(_OUTER * size)), np.uint8)
    trimap = np.full(silhouette.shape, cv2.GC_BGD, np.uint8)
    trimap[near > 0] = cv2.GC_PR_BGD
    trimap[silhouette > 0] = cv2.GC_PR_FGD
    trimap[np.asarray(cv2.erode(silhouette, _disk(_INNER * size))) > 0] = cv2.GC_FGD
    window = box_slices(bounding_box(near > 0, int(_WINDOW_MARGIN * size) + _WINDOW_MARGIN_PIXELS))
    mask[window] = _grab_cut(view.rgb[window], trimap[window])
    return mask


def _grab_cut(rgb: FloatArray, trimap: NDArray[np.uint8]) -> BoolArray:
    """Return OpenCV's GrabCut on a picture (H, W, 3) in [0, 1], as a mask (H, W); the same for the same input."""
    labels = np.array(trimap, order="C")
    if not np.isin(labels, (cv2.GC_BGD, cv2.GC_PR_BGD)).any():
        return np.ones(labels.shape, np.bool_)
    picture = np.ascontiguousarray((np.clip(rgb[..., ::-1], 0, 1) * 255).astype(np.uint8))
    cv2.setRNGSeed(0)  # Its colour clustering draws random seeds; the same input shall give the same mask.
    models, unused = (np.zeros((1, 65)), np.zeros((1, 65))), (0, 0, 1, 1)  # The rectangle counts without a mask only.
    cv2.grabCut(picture, labels, unused, *models, _ITERATIONS, cv2.GC_INIT_WITH_MASK)
    return np.asarray((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD))


def _disk(radius: float) -> NDArray[np.uint8]:
    r = max(1, round(radius))
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * r + 1, 2 * r + 1)), np.uint8)
