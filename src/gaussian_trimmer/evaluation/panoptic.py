"""How well the objects that were found in a scene are those of ground-truth masks.

Objects are compared in all views together: the intersection of two of them is the number of pixels that both have, over
all views. A true object is found if one that was found has an IoU of 80 with it; two of IoU 50 belong to each other in
the panoptic quality of Kirillov et al., "Panoptic Segmentation" (CVPR 2019).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.views import HALF

FOUND_IOU, _MATCHING_IOU = 0.8, 0.5
_SPLIT_SHARE, _MERGED_SHARE = 0.2, 0.5
"""Share of a true object that each of its pieces has, where it is split; and that one found object has of each of
several true ones, where these are merged."""
_OBJECTS_PER_PASS = 16


@dataclass(frozen=True, eq=False)
class PanopticScores:
    """What became of T true objects, by P that were found."""

    ious: Float64Array
    """Intersection over union of each true object with each that was found, 0 to 1, (T, P)."""
    covered: Float64Array
    """Share of each true object that each one has, (T, P)."""

    @property
    def best(self) -> Float64Array:
        """IoU of each true object with the one that has most in common with it, (T,)."""
        return np.asarray(self.ious.max(axis=1, initial=0.0))

    @property
    def found(self) -> BoolArray:
        """Which true objects were found, (T,)."""
        return self.best >= FOUND_IOU

    @property
    def missed(self) -> BoolArray:
        """Which true objects belong to none that was found, (T,)."""
        return self.best < _MATCHING_IOU

    @property
    def false(self) -> BoolArray:
        """Which of those that were found belong to no true object, (P,)."""
        return np.asarray(self.ious.max(axis=0, initial=0.0) < _MATCHING_IOU)

    @property
    def split(self) -> BoolArray:
        """Which true objects lie in several pieces, (T,)."""
        return np.asarray((self.covered > _SPLIT_SHARE).sum(axis=1) > 1)

    @property
    def merged(self) -> BoolArray:
        """Which of those that were found hold several true objects, (P,)."""
        return np.asarray((self.covered > _MERGED_SHARE).sum(axis=0) > 1)

    @property
    def quality(self) -> float:
        """The panoptic quality, 0 to 1."""
        pairs = self.ious[self.ious > _MATCHING_IOU]
        errors = sum(self.ious.shape) - 2 * len(pairs)
        return float(pairs.sum() / max(len(pairs) + errors / 2, 1e-12))


def panoptic_scores(intersections: IntArray) -> PanopticScores:
    """Scores from the pixels that true and found objects have in common.

    Args:
        intersections: number of pixels, (T + 1, P + 1); the first row and column are those of no object.
    """
    true, found = intersections.sum(axis=1)[1:], intersections.sum(axis=0)[1:]
    common = intersections[1:, 1:].astype(np.float64)
    unions = true[:, None] + found[None] - common
    return PanopticScores(common / np.maximum(unions, 1), common / np.maximum(true[:, None], 1))


def count_common_pixels(
    scene: Gaussians,
    objects: Sequence[BoolArray],
    views: Iterable[tuple[Camera, Sequence[FloatArray]]],
    renderer: Renderer,
) -> IntArray:
    """Number of pixels that true and found objects have in common over all views, as `panoptic_scores` takes them.

    A pixel belongs to the object that most of it shows, if that is more than half of it.

    Args:
        scene: all N Gaussians.
        objects: those that were found, (N,) each.
        views: cameras, with the coverage (H, W) of each true object, 0 to 1.
        renderer: draws the views.
    """
    total: IntArray | None = None
    for camera, coverages in views:
        parts = [
            np.stack(objects[start : start + _OBJECTS_PER_PASS], axis=1).astype(np.float32)
            for start in range(0, len(objects), _OBJECTS_PER_PASS)
        ]
        shares = [renderer.blend_values(scene, camera, part) for part in parts]
        found = _labels(np.concatenate(shares, axis=2)) if shares else np.zeros((camera.height, camera.width), np.int64)
        size = len(coverages) + 1, len(objects) + 1
        pairs = _labels(np.stack(coverages, axis=2)) * size[1] + found
        cells = np.bincount(pairs.ravel(), minlength=size[0] * size[1])
        total = cells.reshape(size) if total is None else total + cells.reshape(size)
    assert total is not None, "there is a view"
    return total


def _labels(shares: NDArray[np.floating]) -> IntArray:
    """Number, from 1, of the object that has most of each pixel, and more than half, (H, W), by shares (H, W, P)."""
    return np.where(shares.max(axis=2) > HALF, shares.argmax(axis=2) + 1, 0)


def counts_of(scores: PanopticScores) -> Mapping[str, float | int]:
    """The scores as a table has them, percent where they are shares."""
    return {
        "true objects": len(scores.best),
        "found": int(scores.found.sum()),
        "missed": int(scores.missed.sum()),
        "false": int(scores.false.sum()),
        "split": int(scores.split.sum()),
        "merged": int(scores.merged.sum()),
        "mean IoU (%)": 100 * float(scores.best.mean()) if len(scores.best) else 0.0,
        "panoptic quality (%)": 100 * scores.quality,
    }
