"""A view: what one camera sees of an object, and the mask that was drawn in it."""

from __future__ import annotations

from dataclasses import dataclass

from gaussian_trimmer.cameras import Camera
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
    object_prior: FloatArray
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


@dataclass(frozen=True, eq=False)
class TrimmedView:
    """A virtual view and what was made of it."""

    view: View
    mask: BoolArray
    """The segmenter's mask, (H, W)."""
    rejected: str
    """Why the mask was not believed; empty if it was."""
