"""The default segmenter: the silhouette of the corrected labels, as far as the picture supports it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.segmentation.segmenters import MaskSource
from gaussian_trimmer.segmentation.supported_changes import supported_silhouette
from gaussian_trimmer.views import View


@dataclass(frozen=True)
class SilhouetteConfig:
    """Which silhouette is taken."""

    check_edges: bool = True
    """Where the corrected labels move the silhouette of the selection, follow them only if the picture's edges support
    the new place better than the old one; off: follow them everywhere."""


class SilhouetteSegmenter:
    """Takes the object's silhouette from the labels that were corrected in 3D; it needs no download and no time."""

    name = "silhouette"
    mask_source: MaskSource = "labels"
    thread_safe = True

    def __init__(self, config: SilhouetteConfig | None = None) -> None:
        self.config = config or SilhouetteConfig()

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        """One mask (H, W) for each view: the pixels of which the object contributes more than half."""
        return [supported_silhouette(view) if self.config.check_edges else view.silhouette for view in views]
