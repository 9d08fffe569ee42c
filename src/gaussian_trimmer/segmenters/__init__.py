"""Segmenters: the contract, and the table of those that exist."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray

Box = tuple[int, int, int, int]
"""Pixel box (x0, y0, x1, y1); x1 and y1 are exclusive."""


@dataclass(frozen=True, eq=False)
class View:
    """What a segmenter gets to see of one camera."""

    camera: Camera
    rgb: FloatArray
    """The picture to segment, in [0, 1]: object and neighbours over a plain background, (H, W, 3)."""
    depth: FloatArray
    """Depth of the picture in scene units, zero where nothing is seen, (H, W)."""
    alpha: FloatArray
    """Alpha of the picture, (H, W)."""
    object_alpha: FloatArray
    """Alpha of the coarse object rendered alone, (H, W)."""
    object_visible: FloatArray
    """Share of the picture that coarse object Gaussians contribute, sum of their blend weights, (H, W)."""
    box: Box
    """Bounding box of the coarse object rendered alone: the prompt of eq. 6."""


class Segmenter(Protocol):
    """Finds the object in every view, starting from where the coarse object is."""

    name: str

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        """One mask (H, W) a view, True on the object. Views are ordered by yaw, as the frames of a video."""
        ...
