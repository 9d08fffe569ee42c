"""OpenCV's GrabCut, started from where the object is expected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.settings import Range, Share, check_settings
from gaussian_trimmer.views import View


@dataclass(frozen=True)
class GrabCutConfig:
    """How GrabCut is started."""

    iterations: Annotated[int, Range(1, 100)] = 3
    """Alternations of colour models and graph cut."""
    inner: Share = 0.03
    """Depth inside the expected silhouette at which pixels are sure object, relative to its size."""
    outer: Share = 0.05
    """Distance outside of it at which pixels are sure background, relative to its size."""


class GrabCutSegmenter:
    """Segments every view by itself: colour models of object and background, and a graph cut between them.

    "GrabCut: Interactive Foreground Extraction using Iterated Graph Cuts" (Rother et al., SIGGRAPH 2004).
    """

    name = "grabcut"

    def __init__(self, config: GrabCutConfig | None = None) -> None:
        self.config = config or GrabCutConfig()
        check_settings(self.config, self.name)

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        """One mask (H, W) a view; empty where the object is not expected at all."""
        return [self._segment_one(view) for view in views]

    def _segment_one(self, view: View) -> BoolArray:
        mask = np.zeros(view.alpha.shape, np.bool_)
        expected = (view.expected > 0.5).astype(np.uint8)
        if not expected.any():
            return mask
        size = float(np.sqrt(expected.sum()))
        trimap, near = self._trimap(expected, size)
        rows, columns = _window(near, int(0.1 * size) + 5)
        picture = (np.clip(view.rgb[rows, columns, ::-1], 0, 1) * 255).astype(np.uint8)
        cut = np.ascontiguousarray(trimap[rows, columns])
        if not np.any((cut == cv2.GC_BGD) | (cut == cv2.GC_PR_BGD)):
            mask[rows, columns] = True
            return mask
        cv2.setRNGSeed(0)  # Its colour clustering draws random seeds; the same input shall give the same mask.
        models = np.zeros((1, 65)), np.zeros((1, 65))
        unused = (0, 0, 1, 1)  # The rectangle counts only where no mask is given.
        cv2.grabCut(np.ascontiguousarray(picture), cut, unused, *models, self.config.iterations, cv2.GC_INIT_WITH_MASK)
        mask[rows, columns] = (cut == cv2.GC_FGD) | (cut == cv2.GC_PR_FGD)
        return mask

    def _trimap(self, expected: NDArray[np.uint8], size: float) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """GrabCut's four labels by distance from the expected contour, and all that may be object."""
        sure = np.asarray(cv2.erode(expected, _disk(self.config.inner * size)), np.uint8)
        near = np.asarray(cv2.dilate(expected, _disk(self.config.outer * size)), np.uint8)
        trimap = np.full(expected.shape, cv2.GC_BGD, np.uint8)
        trimap[near > 0] = cv2.GC_PR_BGD
        trimap[expected > 0] = cv2.GC_PR_FGD
        trimap[sure > 0] = cv2.GC_FGD
        return trimap, near


def _disk(radius: float) -> NDArray[np.uint8]:
    r = max(1, round(radius))
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * r + 1, 2 * r + 1)), np.uint8)


def _window(mask: NDArray[np.uint8], margin: int) -> tuple[slice, slice]:
    """Rows and columns of the mask's bounding box and a margin, within the image."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return (
        slice(max(0, int(rows[0]) - margin), int(rows[-1]) + 1 + margin),
        slice(max(0, int(columns[0]) - margin), int(columns[-1]) + 1 + margin),
    )
