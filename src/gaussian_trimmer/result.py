"""What a trim gives: the object, the scene without it, and how they came about."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.planning.up_vector import UpVector
from gaussian_trimmer.views import TrimmedView

KEPT, PRUNED, RECOVERED, SPLIT_INSIDE, SPLIT_OUTSIDE = range(5)
"""Labels of output rows: unchanged side, taken from the object, added to it, and the two parts of a split Gaussian."""


@dataclass(frozen=True, eq=False)
class TrimResult:
    """The object, the scene without it, and how they came about."""

    scene: Gaussians
    object: Gaussians
    """The trimmed object."""
    outside_parts: Gaussians
    """Outer parts of split Gaussians."""
    source_index: IntArray
    """Scene row of every row of the object, then of every row of the background."""
    label: NDArray[np.uint8]
    """KEPT, PRUNED, RECOVERED, SPLIT_INSIDE or SPLIT_OUTSIDE, for the same rows."""
    up: UpVector
    bounds: Bounds
    views: tuple[TrimmedView, ...]
    floaters: int
    """Selected Gaussians too far from the object's bounds to belong to it."""
    refused: str
    """Why the coarse selection was returned unchanged; empty if it was trimmed."""
    seconds: dict[str, float]
    """Time taken by each stage."""
    renderer: str
    segmenter: str

    @cached_property
    def background(self) -> Gaussians:
        """The scene without the object: every other Gaussian, then the outer parts of split ones."""
        return concatenate([self.scene.select(self.background_rows), self.outside_parts])

    @property
    def background_rows(self) -> IntArray:
        """Scene rows of the Gaussians that are whole in the background."""
        return self.source_index[len(self.object) : len(self.source_index) - len(self.outside_parts)]

    def count(self, label: int) -> int:
        """Number of output rows with a label."""
        return int(np.count_nonzero(self.label == label))
