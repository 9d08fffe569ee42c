"""How well the objects that were found in a scene are those of ground-truth masks.

Objects are compared in all views together: the intersection of two of them is the number of pixels that both have, over
all views. A true object is found if one that was found has an IoU of 80 with it; two of IoU 50 belong to each other in
the panoptic quality of Kirillov et al., "Panoptic Segmentation" (CVPR 2019).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.rendering import blend_values
from gaussian_trimmer.views.view import HALF

FOUND_IOU, _MATCHING_IOU = 0.8, 0.5
_SPLIT_SHARE, _MERGED_SHARE = 0.2, 0.5
"""Share of a true object that each of its pieces has, where it is split; and that one found object has of each of
several true ones, where these are merged."""
_OBJECTS_PER_PASS = 16


@dataclass(frozen=True, eq=False)
class PanopticScores:
    """What became of T true objects, by P that were found."""

    common: IntArray
    """Number of pixels that true and found objects share, (T + 1, P + 1); the first row and column are of no object."""

    @cached_property
    def ious(self) -> Float64Array:
        """Intersection over union of each true object with each that was found, 0 to 1, (T, P)."""
        true, found = self.common.sum(axis=1)[1:], self.common.sum(axis=0)[1:]
        return np.asarray(self.common[1:, 1:] / np.maximum(true[:, None] + found - self.common[1:, 1:], 1))

    @cached_property
    def covered(self) -> Float64Array:
        """Share of each true object that each one has, (T, P)."""
        return np.asarray(self.common[1:, 1:] / np.maximum(self.common.sum(axis=1)[1:, None], 1))

    @property
    def best(self) -> Float64Array:
        """IoU of each true object with the one that has most in common with it, (T,)."""
        return np.asarray(self.ious.max(axis=1, initial=0.0))

    @property
    def false(self) -> BoolArray:
        """Found objects that belong to no true one, (P,)."""
        return np.asarray(self.ious.max(axis=0, initial=0.0) < _MATCHING_IOU)

    @property
    def merged(self) -> BoolArray:
        """Found objects that hold several true ones, (P,)."""
        return np.asarray((self.covered > _MERGED_SHARE).sum(axis=0) > 1)

    def states(self) -> list[str]:
        """Return what became of each true object, in words."""
        states = []
        for best, ious, covered in zip(self.best, self.ious, self.covered, strict=True):
            state = "found" if best >= FOUND_IOU else "missed" if best < _MATCHING_IOU else "poor"
            state += ", split" if (covered > _SPLIT_SHARE).sum() > 1 else ""
            match = int(ious.argmax()) if len(ious) else None
            merged = match is not None and self.merged[match] and covered[match] > HALF
            states.append(state + (", merged with others" if merged else ""))
        return states

    @property
    def quality(self) -> float:
        """The panoptic quality, 0 to 1."""
        pairs = self.ious[self.ious > _MATCHING_IOU]
        errors = sum(self.ious.shape) - 2 * len(pairs)
        return float(pairs.sum() / max(len(pairs) + errors / 2, 1e-12))

    def counts(self) -> Mapping[str, float | int]:
        """Return the scores as a table has them, percent where they are shares."""
        states = self.states()
        return {
            "true objects": len(states),
            "found": sum(state.startswith("found") for state in states),
            "missed": sum(state.startswith("missed") for state in states),
            "false": int(self.false.sum()),
            "split": sum("split" in state for state in states),
            "merged": int(self.merged.sum()),
            "mean IoU (%)": 100 * float(self.best.mean()) if states else 0.0,
            "panoptic quality (%)": 100 * self.quality,
        }


def compare_objects(
    scene: Gaussians,
    objects: Sequence[BoolArray],
    views: Iterable[tuple[Camera, Sequence[FloatArray]]],
) -> PanopticScores:
    """Compare the objects that were found with the true ones, over all views.

    A pixel belongs to the object that most of it shows, if that is more than half of it.

    Args:
        scene: all N Gaussians.
        objects: those that were found, (N,) each.
        views: cameras, with the coverage (H, W) of each true object, 0 to 1; at least one.
    """
    cells: IntArray | int = 0
    size = (1, 1)
    for camera, coverages in views:
        parts = [
            np.stack(objects[start : start + _OBJECTS_PER_PASS], axis=1).astype(np.float32)
            for start in range(0, len(objects), _OBJECTS_PER_PASS)
        ]
        shares = [blend_values(scene, camera, part) for part in parts]
        found = _labels(np.concatenate(shares, axis=2)) if shares else np.zeros((camera.height, camera.width), np.int64)
        size = len(coverages) + 1, len(objects) + 1
        pairs = _labels(np.stack(coverages, axis=2)) * size[1] + found
        cells = cells + np.bincount(pairs.ravel(), minlength=size[0] * size[1])
    return PanopticScores(np.asarray(cells).reshape(size))


def _labels(shares: NDArray[np.floating]) -> IntArray:
    """Return the number, from 1, of the object that has most of each pixel, and over half, (H, W), by shares (H, W, P).

    It is 0 where there is none.
    """
    return np.where(shares.max(axis=2) > HALF, shares.argmax(axis=2) + 1, 0)
