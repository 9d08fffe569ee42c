"""What a trim returns: the object, the scene without it, and how they were obtained."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.planning.up_vector import UpVector
from gaussian_trimmer.views import TrimmedView


class RowLabel(IntEnum):
    """What happened to the Gaussian in a row of the object or of the background.

    The names in lower case are those of `labels.npz`.
    """

    KEPT = 0
    """It is on the side that the selection put it on."""
    PRUNED = 1
    """It was selected and is now in the background."""
    RECOVERED = 2
    """It was not selected and is now in the object."""
    SPLIT_INSIDE = 3
    """It is the part of a split Gaussian that lies in the object."""
    SPLIT_OUTSIDE = 4
    """It is the part of a split Gaussian that lies in the background."""


@dataclass(frozen=True, eq=False)
class TrimResult:
    """The object, the scene without it, and how they were obtained."""

    scene: Gaussians
    """The Gaussians that were given."""
    object: Gaussians
    """The trimmed object: whole Gaussians in the order of the scene, then the inner parts of split ones."""
    outside_parts: Gaussians
    """Outer parts of split Gaussians."""
    source_index: IntArray
    """Scene row of each row of the object, then of each row of the background."""
    label: NDArray[np.uint8]
    """What happened to each of these rows, a `RowLabel`."""
    up: UpVector
    bounds: Bounds
    """Bounds of the coarse object, which the views frame."""
    views: tuple[TrimmedView, ...]
    floaters: int
    """Number of selected Gaussians that lie too far from the object to belong to it."""
    refused: str
    """Why the coarse selection was returned unchanged; empty if it was trimmed."""
    seconds: dict[str, float]
    """Time taken by each stage."""
    renderer: str
    """Name of the renderer."""
    segmenter: str
    """Name of the segmenter."""

    @cached_property
    def background(self) -> Gaussians:
        """The scene without the object: all other Gaussians, then the outer parts of split ones."""
        return concatenate([self.scene.select(self.background_rows), self.outside_parts])

    @property
    def background_rows(self) -> IntArray:
        """Scene rows of the Gaussians that are whole in the background."""
        return self.source_index[len(self.object) : len(self.source_index) - len(self.outside_parts)]

    def count(self, label: RowLabel | int) -> int:
        """Number of rows of object and background with a label."""
        return int(np.count_nonzero(self.label == label))
