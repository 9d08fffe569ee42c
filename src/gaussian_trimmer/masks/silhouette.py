"""The default segmenter: the silhouette of the corrected labels."""

from __future__ import annotations

from collections.abc import Sequence

from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.masks import MaskSource
from gaussian_trimmer.views.view import View


class SilhouetteSegmenter:
    """Takes the object's silhouette from the labels that were corrected in 3D; it needs no download and no time."""

    name = "silhouette"
    mask_source: MaskSource = "labels"
    thread_safe = True

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        """Return one mask (H, W) for each view: the pixels of which the object contributes more than half."""
        return [view.silhouette for view in views]
