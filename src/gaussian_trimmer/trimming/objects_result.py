"""What a trim of several objects returns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.result import RowLabel
from gaussian_trimmer.views import TrimmedView


def title_of(name: str) -> str:
    """What to call an object: its name, or the number that stands for one.

    >>> title_of("mug"), title_of("3")
    ('mug', 'object 3')
    """
    return f"object {name}" if name.isdigit() else name


@dataclass(frozen=True, eq=False)
class TrimmedObject:
    """One of several objects."""

    id: int
    name: str
    """What it was called; its id as text if it had no name."""
    gaussians: Gaussians
    """Whole Gaussians in the order of the scene, then the inner parts of split ones, (M,)."""
    source_index: IntArray
    """Scene row of each, (M,)."""
    label: NDArray[np.uint8]
    """What happened to each, a `RowLabel`, (M,)."""
    fitted: IntArray
    """Which of these rows were fitted to the object's outline, ascending."""
    selection: BoolArray
    """The selection, (N,)."""
    bounds: Bounds
    """Bounds of the selected object."""
    view: TrimmedView | None
    """A view of it, an accepted one if there is one; None if the selection was refused before any was planned."""
    refused: str | None
    """Why it was left as it was; None if it was trimmed."""
    given_up: int
    """Number of Gaussians that it claimed and another object got."""
    report: dict[str, Any]
    """The report of its own trim."""

    @property
    def title(self) -> str:
        """What to call it in pages and pictures."""
        return title_of(self.name)


@dataclass(frozen=True, eq=False)
class ObjectsResult:
    """Several objects and the scene without them, complementary: every Gaussian is in one of them, or split."""

    scene: Gaussians
    """The Gaussians that were given."""
    objects: tuple[TrimmedObject, ...]
    background_rows: IntArray
    """Scene rows of the Gaussians that are whole in the background, ascending."""
    outside_parts: Gaussians
    """Outer parts of split Gaussians."""
    outside_source: IntArray
    """Scene row of each of these."""
    contested: int
    """Number of Gaussians that several objects claimed."""
    dropped: IntArray
    """Scene rows, ascending, of what only the objects hid, and of what new Gaussians took the place of: no part has
    them."""
    relit: Gaussians
    """Gaussians of the background on which shadows of the objects lay, without these."""
    relit_rows: IntArray
    """Scene row of each of these."""
    filled: Gaussians
    """New Gaussians of the background, which continue what the objects stood on or leaned against."""
    not_filled: tuple[str, ...]
    """Which objects left a hole, and why nothing was made up there, a sentence each."""
    seconds: dict[str, float]
    """Time taken by each object, by its id, by sharing out, and by cleaning the background."""
    used_renderer: Renderer
    """What draws the pictures that are saved."""

    @cached_property
    def background(self) -> Gaussians:
        """The scene without all objects: the other Gaussians as they were, then what `appended` has."""
        return concatenate([self.scene.select(self.background_rows), self.appended])

    @property
    def appended(self) -> Gaussians:
        """What the background has that the scene has not: outer parts of split Gaussians, relit ones, filled ones."""
        return concatenate([self.outside_parts, self.relit, self.filled])

    @property
    def labels(self) -> NDArray[np.int64]:
        """Id of the object that has each Gaussian of the scene, whole or in part, and 0 for the background, (N,)."""
        labels = np.zeros(len(self.scene), np.int64)
        for part in self.objects:
            labels[part.source_index] = part.id
        return labels

    @property
    def source_index(self) -> IntArray:
        """Scene row of each row of the objects, in order, and then of the background; -1 for filled ones."""
        new = np.full(len(self.filled), -1, np.int64)
        rows = [part.source_index for part in self.objects]
        return np.concatenate([*rows, self.background_rows, self.outside_source, self.relit_rows, new])

    @property
    def fitted(self) -> IntArray:
        """Which of these rows were fitted to the outline of their object, ascending."""
        starts = np.cumsum([0, *(len(part.gaussians) for part in self.objects)])
        return np.concatenate([start + part.fitted for start, part in zip(starts, self.objects, strict=False)])

    @property
    def label(self) -> NDArray[np.uint8]:
        """What happened to each of these rows, a `RowLabel`."""
        selected = np.any([part.selection for part in self.objects], axis=0)[self.background_rows]
        labels = [part.label for part in self.objects]
        labels.append(np.where(selected, RowLabel.REMOVED, RowLabel.KEPT))
        labels.append(np.full(len(self.outside_source), RowLabel.SPLIT_OUTSIDE))
        labels += [np.full(len(self.relit), RowLabel.RELIT), np.full(len(self.filled), RowLabel.FILLED)]
        return np.concatenate(labels).astype(np.uint8)
