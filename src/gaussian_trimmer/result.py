"""What a trim returns: the object, the scene without it, and how they were obtained."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.lazy_import import load
from gaussian_trimmer.planning.up_vector import UpVector
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.views import TrimmedView


class RowLabel(IntEnum):
    """What happened to the Gaussian in a row of the object or of the background.

    The names in lower case are those of `labels.npz`.
    """

    KEPT = 0
    """It is on the side that the selection put it on."""
    REMOVED = 1
    """It was selected and is now in the background."""
    RECOVERED = 2
    """It was not selected and is now in the object."""
    SPLIT_INSIDE = 3
    """It is the part of a split Gaussian that lies in the object."""
    SPLIT_OUTSIDE = 4
    """It is the part of a split Gaussian that lies in the background."""
    FILLED = 5
    """It is new, and continues what the object stood on or leaned against; its scene row is -1."""
    RELIT = 6
    """It is in the background without the object's shadow, brighter than in the scene."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Division:
    """A scene divided into an object of M Gaussians and a background."""

    object: Gaussians
    """The trimmed object: whole Gaussians in the order of the scene, then the inner parts of split ones."""
    outside_parts: Gaussians
    """Outer parts of split Gaussians."""
    source_index: IntArray
    """Scene row of each row of the object, then of each row of the background; -1 where none is."""
    label: NDArray[np.uint8]
    """What happened to each of these rows, a `RowLabel`."""
    dropped: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """Scene rows, ascending, that neither has: what only the object hid, and what new Gaussians took the place of."""
    relit: Gaussians | None = None
    """Gaussians of the background on which the object's shadow lay, without it."""
    filled: Gaussians | None = None
    """New Gaussians of the background, which continue what the object stood on or leaned against."""
    not_filled: str | None = None
    """Why nothing continues there although it was asked for; None if something does, or was not to."""
    fitted: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """Rows of the object, ascending, that are not as in the scene because they were fitted to the object's outline."""
    not_fitted: str | None = None
    """Why the outline was not fitted although it was asked for; None if it was, or was not to be."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TrimResult(Division):
    """The object, the scene without it, and how they were obtained."""

    scene: Gaussians
    """The Gaussians that were given."""
    up: UpVector
    bounds: Bounds
    """Bounds of the selected object, which the views frame."""
    views: tuple[TrimmedView, ...]
    """The views that the trimmer looked from; none if the inputs were found wrong before."""
    floaters: int
    """Number of selected Gaussians that lie too far from the object to belong to it."""
    refused: str | None = None
    """Why the selection was returned unchanged; None if it was trimmed."""
    seconds: dict[str, float]
    """Time taken by each stage."""
    renderer: str
    """Name of the renderer."""
    segmenter: str
    """Name of the segmenter."""
    segmenter_description: str
    """What the segmenter says of itself for the report: its name, or more."""
    selection: BoolArray
    """The selection that was trimmed, (N,)."""
    config: TrimConfig
    """The settings that it was trimmed with."""
    used_renderer: Renderer
    """The renderer itself, which draws the pictures that are saved."""
    cameras: tuple[Camera, ...] = ()
    """The training cameras, if known."""
    warnings: tuple[str, ...] = ()
    """What may be wrong with the inputs although the object was trimmed, a sentence each."""

    @property
    def object_mask(self) -> BoolArray:
        """Which Gaussians of the scene the object has, whole or in part, (N,)."""
        return _mask(self.source_index[: len(self.object)], len(self.scene))

    @cached_property
    def background(self) -> Gaussians:
        """The scene without the object: the other Gaussians as they were, then what `appended` has."""
        return concatenate([self.scene.select(self.background_rows), self.appended])

    @property
    def appended(self) -> Gaussians:
        """What the background has that the scene has not: outer parts of split Gaussians, relit ones, filled ones."""
        return concatenate([self.outside_parts, *(part for part in (self.relit, self.filled) if part is not None)])

    @property
    def background_rows(self) -> IntArray:
        """Scene rows of the Gaussians that are in the background as they were."""
        return self.source_index[len(self.object) : len(self.source_index) - len(self.appended)]

    def count(self, label: RowLabel | int) -> int:
        """Number of rows of object and background with a label."""
        return int(np.count_nonzero(self.label == label))

    @property
    def report(self) -> dict[str, Any]:
        """What `report.json` holds: settings, cameras, up vector, views accepted or rejected and why, counts, times."""
        report: dict[str, Any] = _output("report").describe(self)
        return report

    def save(self, folder: str | Path, **options: Any) -> Path:
        """Write what the command line writes, and return the folder; see `gaussian_trimmer.save` for the options."""
        return Path(_output("saving").save(self, folder, **options))

    def export_viewer(self, path: str | Path, part: str = "object", *, overwrite: bool = False) -> None:
        """Write a page that draws the object in any browser; see `gaussian_trimmer.export_viewer`."""
        _output("html.viewer").export_viewer(self, path, part, overwrite=overwrite)

    def slim(self) -> SlimResult:
        """What was decided, without the scene, the object's Gaussians and the renderings."""
        n_object = len(self.object)
        object_labels, rest = self.label[:n_object], slice(n_object, None)
        removed = self.source_index[rest][self.label[rest] == RowLabel.REMOVED]
        return SlimResult(
            len(self.scene),
            self.source_index[:n_object].astype(np.int32),
            object_labels.copy(),
            removed.astype(np.int32),
            tuple((view.mask.shape, np.packbits(view.mask)) for view in self.views),
            self.report,
        )


@dataclass(frozen=True, eq=False)
class SlimResult:
    """What a trim decided, without Gaussians and pictures: small enough to be kept by the thousand, or sent elsewhere.

    Whole Gaussians of the object are `scene.select(slim.object_mask)`; the parts of split ones are not kept.
    """

    scene_size: int
    """Number of Gaussians of the scene, N."""
    object_rows: NDArray[np.int32]
    """Scene row of each row of the object, (M,)."""
    object_label: NDArray[np.uint8]
    """What happened to each of these rows, a `RowLabel`, (M,)."""
    removed_rows: NDArray[np.int32]
    """Scene rows that were selected and are now in the background."""
    packed_masks: tuple[tuple[tuple[int, ...], NDArray[np.uint8]], ...]
    """Shape and bits of the mask of each view; see `masks`."""
    report: dict[str, Any]
    """See `TrimResult.report`."""

    @property
    def object_mask(self) -> BoolArray:
        """Which Gaussians of the scene the object has, whole or in part, (N,)."""
        return _mask(self.object_rows, self.scene_size)

    @property
    def masks(self) -> list[BoolArray]:
        """The segmenter's mask of each view, (H, W)."""
        return [
            np.unpackbits(bits, count=int(np.prod(shape))).view(np.bool_).reshape(shape)
            for shape, bits in self.packed_masks
        ]

    @property
    def refused(self) -> str | None:
        """Why the selection was returned unchanged; None if it was trimmed."""
        return self.report["refused"] or None


def _mask(rows: NDArray[Any], n: int) -> BoolArray:
    mask = np.zeros(n, np.bool_)
    mask[rows] = True
    return mask


def _output(module: str) -> Any:
    """A module of `output`, which writes results: loaded when it is needed, since it works on what stands here."""
    return load(f"gaussian_trimmer.output.{module}")
