"""What a trim returns: objects, the scene without them, and how they were obtained."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, LabelArray, concatenate, mask_of_rows
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.up_vector import UpVector
from gaussian_trimmer.views.view import TrimmedView

T = TypeVar("T")
THE_OBJECT = "object"
"""Name of the object of a trim of one."""
_LISTED = 3
"""Number of objects that are named in a result's line."""


class RowLabel(IntEnum):
    """What happened to the Gaussian in a row of an object or of the background.

    The names in lower case are those of `labels.npz`.
    """

    KEPT = 0
    """It is on the side that the selection put it on."""
    REMOVED = 1
    """It was selected and is now in the background."""
    ADDED = 2
    """It was not selected and is now in the object."""
    SPLIT_INSIDE = 3
    """It is the part of a split Gaussian that lies in the object."""
    SPLIT_OUTSIDE = 4
    """It is the part of a split Gaussian that lies in the background."""
    FILLED = 5
    """It is new, and continues what the object stood on or leaned against; its scene row is -1."""
    RELIT = 6
    """It is in the background without the object's shadow, brighter than in the scene."""


class Once(Generic[T]):
    """What is made when it is first asked for, by whichever thread, and kept."""

    def __init__(self, make: Callable[[], T]) -> None:
        self._make: Callable[[], T] | None = make
        self._making = threading.Lock()

    def __call__(self) -> T:
        """Return it."""
        with self._making:
            if self._make is not None:
                self._made = self._make()
                self._make = None  # lets go of what it was made from
            return self._made

    def __reduce__(self) -> tuple[Any, ...]:
        return _made, (self(),)


def _made(value: T) -> Once[T]:
    return Once(lambda: value)


@dataclass(frozen=True, eq=False, kw_only=True)
class TrimmedObject:
    """An object of M Gaussians, and how it was obtained."""

    id: int
    name: str
    """What it was called; its id as text if it had no name."""
    gaussians: Gaussians
    """Whole Gaussians in the order of the scene, then the inner parts of split ones, (M,)."""
    source_index: IntArray
    """Scene row of each, (M,)."""
    label: NDArray[np.uint8]
    """What happened to each, a `RowLabel`, (M,)."""
    selected_rows: IntArray
    """Scene rows that were selected, ascending."""
    up: UpVector
    bounds: Bounds
    """Bounds of the selected object, which the views frame."""
    views: tuple[TrimmedView, ...]
    """The views that the trimmer looked from; none if the inputs were found wrong before. Those of several objects are
    kept without pictures and masks."""
    refused: str | None
    """Why it is as it was selected; None if it was trimmed."""
    warnings: tuple[str, ...]
    """What may be wrong with it although it was trimmed, a sentence each."""
    floaters: int
    """Number of selected Gaussians that lie too far from the object to belong to it."""
    lost: int
    """Number of Gaussians that it claimed and another object got."""
    fitted: IntArray
    """Its rows, ascending, that are not as in the scene because they were fitted to its outline."""
    not_fitted: str | None
    """Why the outline was not fitted although it was asked for; None if it was, or was not to be."""
    seconds: dict[str, float]
    """Time taken by each stage that looks at this object alone."""

    def __repr__(self) -> str:
        counts = f"{len(self.gaussians):,} Gaussians, {len(self.selected_rows):,} selected"
        return f"<TrimmedObject {self.name!r}: {counts}, {'refused' if self.refused else 'trimmed'}>"

    @property
    def title(self) -> str:
        """What to call it in pages and pictures."""
        return title_of(self.name)


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneWithoutObjects:
    """What is left of the N Gaussians of a scene, and what is new where objects were; B rows in all."""

    scene: Gaussians
    """The N Gaussians."""
    appended: Gaussians
    """What the scene has not: outer parts of split Gaussians, relit ones, filled ones."""
    source: IntArray
    """Scene row of each: whole Gaussians in the order of the scene, then what is appended; -1 for filled ones, (B,)."""
    label: NDArray[np.uint8]
    """What happened to each, a `RowLabel`, (B,)."""
    discarded: IntArray
    """Scene rows, ascending, that nothing has: what only the objects hid, and what new Gaussians took the place of."""
    warnings: Mapping[int, tuple[str, ...]]
    """What may be wrong where an object was, a sentence each, by its id."""
    not_filled: Mapping[int, str]
    """Why nothing continues where an object was although that was asked for, by its id; none where something does."""

    @property
    def rows(self) -> IntArray:
        """Scene rows, ascending, of the Gaussians that are as they were."""
        return self.source[: len(self.source) - len(self.appended)]

    @cached_property
    def gaussians(self) -> Gaussians:
        """All of it, (B,)."""
        return concatenate([self.scene.select(self.rows), self.appended])


@dataclass(frozen=True, eq=False, kw_only=True)
class TrimResult:
    """Objects and the scene without them: every Gaussian of the scene is in one of them, split, or discarded.

    One object is `objects[0]`.
    """

    scene: Gaussians
    """The N Gaussians that were given."""
    objects: tuple[TrimmedObject, ...]
    made_later: Once[SceneWithoutObjects]
    """The scene without the objects: to make it takes about as long as the objects took."""
    share: FloatArray
    """How much of each Gaussian of the scene is an object's by the corrected labels, from 0 to 1, (N,): that of the
    object in `labels`, and in the background the largest of any. It is 1 for what was selected of an object that is
    left as it was, and 0 too far from every object. What splits, masks and views decide afterwards is not in it."""
    contested: int
    """Number of Gaussians that several objects claimed."""
    config: TrimConfig
    """The settings."""
    cameras: tuple[Camera, ...]
    """The training cameras, if known."""
    seconds: dict[str, float]
    """Time taken by each stage; of several objects, by each object and by the stages that they share. That of
    "remove" is added when the background is made."""

    def __repr__(self) -> str:
        parts = ", ".join(f"{part.title} of {len(part.gaussians):,}" for part in self.objects[:_LISTED])
        more = f" and {len(self.objects) - _LISTED} more" if len(self.objects) > _LISTED else ""
        return f"<TrimResult: {parts}{more}, of {len(self.scene):,} Gaussians>"

    @property
    def nothing_trimmed(self) -> bool:
        """Whether every object is as it was selected, so that a scene without them would be a guess."""
        return all(part.refused for part in self.objects)

    @property
    def rest(self) -> SceneWithoutObjects:
        """The scene without the objects, and what is new in it; made when it is first asked for."""
        return self.made_later()

    @property
    def background(self) -> Gaussians:
        """The scene without the objects, (B,)."""
        return self.rest.gaussians

    @property
    def background_source(self) -> IntArray:
        """Scene row of each Gaussian of the background, -1 for new ones, (B,)."""
        return self.rest.source

    @property
    def background_label(self) -> NDArray[np.uint8]:
        """What happened to each Gaussian of the background, a `RowLabel`, (B,)."""
        return self.rest.label

    @property
    def discarded(self) -> IntArray:
        """Scene rows, ascending, that neither an object nor the background has."""
        return self.rest.discarded

    @property
    def labels(self) -> LabelArray:
        """Id of the object that has each Gaussian of the scene, whole or in part, and 0 for none, (N,)."""
        labels = np.zeros(len(self.scene), np.int32)
        for part in self.objects:
            labels[part.source_index] = part.id
        return labels

    @property
    def object(self) -> Gaussians:
        """The object's Gaussians, where there is one object."""
        return self._only.gaussians

    @property
    def object_mask(self) -> BoolArray:
        """Which Gaussians of the scene the object has, whole or in part, (N,), where there is one object."""
        return mask_of_rows(self._only.source_index, len(self.scene))

    @property
    def selection(self) -> BoolArray:
        """Which Gaussians of the scene were selected, (N,), where there is one object."""
        return mask_of_rows(self._only.selected_rows, len(self.scene))

    @property
    def _only(self) -> TrimmedObject:
        if len(self.objects) != 1:
            raise InputError(f"The result has {len(self.objects)} objects; look at each of result.objects.")
        return self.objects[0]

    def count(self, label: RowLabel | int) -> int:
        """Return the number of rows of objects and background with a label."""
        labels = [*(part.label for part in self.objects), self.background_label]
        return int(np.count_nonzero(np.concatenate(labels) == label))


def title_of(name: str) -> str:
    """Return what to call an object: its name, or the number that stands for one.

    >>> title_of("mug"), title_of("3")
    ('mug', 'object 3')
    """
    return f"object {name}" if name.isdigit() else name
