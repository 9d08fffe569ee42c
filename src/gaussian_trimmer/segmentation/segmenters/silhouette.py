"""The default segmenter: the silhouette of the corrected labels."""

from __future__ import annotations

from collections.abc import Sequence

from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.views import View


class SilhouetteSegmenter:
    """Takes the object's silhouette from the labels that were corrected in 3D; it needs no download and no time."""

    name = "silhouette"

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        """Pixels in which the object's expected share of the picture exceeds one half, a mask (H, W) a view."""
        return [view.object_prior > 0.5 for view in views]
