"""Segmenters: the contract, and the table of those that exist."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any, Protocol, cast

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.views import View


class Segmenter(Protocol):
    """Finds the object in every view, starting from where the coarse object is."""

    name: str

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        """One mask (H, W) a view, True on the object. Views are ordered by yaw, as the frames of a video."""
        ...


# Name -> module and class; the class takes its configuration, if any, as its only argument.
SEGMENTERS = {
    "silhouette": ("gaussian_trimmer.segmentation.segmenters.silhouette", "SilhouetteSegmenter"),
    "grabcut": ("gaussian_trimmer.segmentation.segmenters.grabcut", "GrabCutSegmenter"),
    "sam2": ("gaussian_trimmer.segmentation.segmenters.sam2_video", "Sam2Segmenter"),
    "mask-files": ("gaussian_trimmer.segmentation.segmenters.mask_files", "MaskFilesSegmenter"),
}


def get_segmenter(name: str, *config: Any) -> Segmenter:
    """The segmenter of that name, made with its configuration.

    Raises:
        InputError: no segmenter has that name, or what it needs is not installed.
    """
    if name not in SEGMENTERS:
        raise InputError(f"Unknown segmenter '{name}'; available: {', '.join(SEGMENTERS)}.")
    module, attribute = SEGMENTERS[name]
    return cast(Segmenter, getattr(import_module(module), attribute)(*config))
