"""OpenCV's GrabCut, started from the silhouette of the corrected labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.settings import Range, Share, check_settings
from gaussian_trimmer.views.view import View, bounding_box, box_slices

_WINDOW_MARGIN, _WINDOW_MARGIN_PIXELS = 0.1, 5
"""Margin of the window that is segmented, relative to the silhouette's size, and what is added to it in pixels."""


@dataclass(frozen=True)
class GrabCutConfig:
    """How GrabCut is started."""

    iterations: Annotated[int, Range(1, 100)] = 3
    """Alternations between fitting the colour models and cutting the graph."""
    inner: Share = 0.03
    """Depth inside the silhouette from which on pixels are certainly object, relative to the silhouette's size."""
    outer: Share = 0.05
    """Distance outside the silhouette from which on pixels are certainly background, relative to its size."""


class GrabCutSegmenter:
    """Segments every view for itself: colour models of object and background, and a graph cut between them.

    "GrabCut: Interactive Foreground Extraction using Iterated Graph Cuts" (Rother et al., SIGGRAPH 2004).
    """

    name = "grabcut"

    def __init__(self, config: GrabCutConfig | None = None) -> None:
        self.config = config or GrabCutConfig()
        check_settings(self.config, self.name)

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        """Return one mask (H, W) for each view; empty where the silhouette is empty."""
        return [self._segment_one(view) for view in views]

    def _segment_one(self, view: View) -> BoolArray:
        mask = np.zeros(view.alpha.shape, np.bool_)
        silhouette = view.silhouette.astype(np.uint8)
        if not silhouette.any():
            return mask
        size = float(np.sqrt(silhouette.sum()))
        trimap, near = self._trimap(silhouette, size)
        window = box_slices(bounding_box(near, int(_WINDOW_MARGIN * size) + _WINDOW_MARGIN_PIXELS))
        mask[window] = grab_cut(view.rgb[window], trimap[window], self.config.iterations)
        return mask

    def _trimap(self, silhouette: NDArray[np.uint8], size: float) -> tuple[NDArray[np.uint8], BoolArray]:
        """Return GrabCut's four labels by distance from the silhouette's contour, and which pixels may be object."""
        sure = np.asarray(cv2.erode(silhouette, _disk(self.config.inner * size)), np.uint8)
        near = np.asarray(cv2.dilate(silhouette, _disk(self.config.outer * size)), np.uint8)
        trimap = np.full(silhouette.shape, cv2.GC_BGD, np.uint8)
        trimap[near > 0] = cv2.GC_PR_BGD
        trimap[silhouette > 0] = cv2.GC_PR_FGD
        trimap[sure > 0] = cv2.GC_FGD
        return trimap, near > 0


def grab_cut(rgb: FloatArray, trimap: NDArray[np.uint8], iterations: int) -> BoolArray:
    """Return OpenCV's GrabCut on a picture (H, W, 3) in [0, 1], as a mask (H, W); the same for the same input.

    Args:
        rgb: the picture; values outside [0, 1] are clipped.
        trimap: OpenCV's labels GC_BGD, GC_PR_BGD, GC_PR_FGD and GC_FGD, (H, W). Without any background, all is object.
        iterations: alternations between fitting the colour models and cutting the graph.
    """
    labels = np.array(trimap, order="C")
    if not np.isin(labels, (cv2.GC_BGD, cv2.GC_PR_BGD)).any():
        return np.ones(labels.shape, np.bool_)
    picture = np.ascontiguousarray((np.clip(rgb[..., ::-1], 0, 1) * 255).astype(np.uint8))
    cv2.setRNGSeed(0)  # Its colour clustering draws random seeds; the same input shall give the same mask.
    models, unused = (np.zeros((1, 65)), np.zeros((1, 65))), (0, 0, 1, 1)  # The rectangle counts without a mask only.
    cv2.grabCut(picture, labels, unused, *models, iterations, cv2.GC_INIT_WITH_MASK)
    return np.asarray((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD))


def _disk(radius: float) -> NDArray[np.uint8]:
    r = max(1, round(radius))
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * r + 1, 2 * r + 1)), np.uint8)
