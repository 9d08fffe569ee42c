"""Segmenters: the contract, and the table of those that exist."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol, cast

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.rendering import Rendering

Box = tuple[int, int, int, int]
"""Pixel box (x0, y0, x1, y1); x1 and y1 are exclusive."""


@dataclass(frozen=True, eq=False)
class View:
    """What a segmenter gets to see of one camera."""

    camera: Camera
    picture: Rendering
    """Object and neighbours over black."""
    object_alpha: FloatArray
    """Alpha of the coarse object rendered alone, (H, W)."""
    object_visible: FloatArray
    """Share of the picture that coarse object Gaussians contribute, sum of their blend weights, (H, W)."""
    expected: FloatArray
    """Share of the picture that the object is expected to contribute, from the corrected labels, (H, W)."""
    box: Box
    """Bounding box of the coarse object rendered alone: the prompt of eq. 6."""

    @property
    def rgb(self) -> FloatArray:
        """The picture to segment, object and neighbours over black; colours are not clipped above one, (H, W, 3)."""
        return self.picture.rgb

    @property
    def depth(self) -> FloatArray:
        """Depth of the picture in scene units, zero where nothing is seen, (H, W)."""
        return self.picture.depth

    @property
    def alpha(self) -> FloatArray:
        """Alpha of the picture, (H, W)."""
        return self.picture.alpha


class Segmenter(Protocol):
    """Finds the object in every view, starting from where the coarse object is."""

    name: str

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        """One mask (H, W) a view, True on the object. Views are ordered by yaw, as the frames of a video."""
        ...


# Name -> module and class; the class takes its configuration, if any, as its only argument.
SEGMENTERS = {
    "label-field": ("gaussian_trimmer.segmenters.label_field", "LabelFieldSegmenter"),
    "grabcut": ("gaussian_trimmer.segmenters.grabcut", "GrabCutSegmenter"),
    "sam2": ("gaussian_trimmer.segmenters.sam2", "Sam2Segmenter"),
    "mask-files": ("gaussian_trimmer.segmenters.mask_files", "MaskFilesSegmenter"),
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
