"""How well an object matches ground truth in one view, by both rules of occlusion.

Published codes differ in whether the object is rendered alone or counts only where nothing hides it in its scene.
Both are measured: `alone` compares the object's own opacity with the mask, `in scene` its share of the whole scene's
rendering, with everything else before it. They differ as well in the threshold that makes a mask of an opacity.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.evaluation import metrics
from gaussian_trimmer.evaluation.clip_iqa import ClipScorer
from gaussian_trimmer.evaluation.ground_truth import TestView
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.rendering import blend_values, render
from gaussian_trimmer.views.view import HALF

Scores = dict[str, float]
"""Metric -> percentage, or dB for `psnr` and `fidelity`; a metric that is not known is missing."""

METRICS: Mapping[str, str] = {
    "iou": "IoU",
    "accuracy": "accuracy",
    "boundary_iou": "boundary IoU",
    "soft_iou": "soft IoU",
    "acc25": "Acc@0.25",
    "iou_in_scene": "IoU in scene",
    "accuracy_in_scene": "accuracy in scene",
    "boundary_iou_in_scene": "boundary IoU in scene",
    "acc25_in_scene": "Acc@0.25 in scene",
    "psnr": "extraction PSNR",
    "fidelity": "fidelity",
    "clip_clear": "CLIP-IQA clear boundary",
    "clip_smooth": "CLIP-IQA smooth boundary",
    "clip_complete": "CLIP-IQA complete object",
}
"""Name of a metric in files -> its name in tables, in their order. All are in percent but `psnr` and `fidelity`, dB."""
RULES: Mapping[str, str] = {"alone": "", "in scene": "_in_scene"}
"""Rule of occlusion -> what the names of its metrics end with."""
ACC25 = ("acc25", "acc25_in_scene")
"""Share of masks with an IoU above a quarter, which says something of many masks together."""
_ACC25_IOU = 25.0
HIGHEST_PSNR = 100.0
"""dB; equal pictures would have an infinite PSNR, and no mean."""


IGNORED = 0.1
"""Coverage by another object above which a pixel says nothing of the scene without the object."""
INPAINT_RADIUS = 3.0
"""Pixels from which each pixel of a photograph is painted over."""
_OBJECTS_PER_PASS = 16


@dataclass(frozen=True, eq=False)
class Cut:
    """A scene cut in two, by a trim or by any other tool."""

    object: Gaussians
    background: Gaussians | None
    """The scene without the object; None if it is not known."""
    selection: BoolArray | None = None
    """Rows of the scene that the object has, whole or in part, (N,); None if they are not known."""
    before: BoolArray | None = None
    """Rows of the scene that were selected before the trim, (N,); None if they are not known."""
    unknown: str = ""
    """Why the background or the rows are not known."""


def cut_by(scene: Gaussians, selection: BoolArray) -> Cut:
    """Return the scene cut in two by a selection (N,)."""
    return Cut(scene.select(selection), scene.select(~selection), selection)


@dataclass(frozen=True)
class Judge:
    """The rules of a comparison with ground truth."""

    threshold: float = metrics.THRESHOLD
    """Opacity above which a rendered pixel belongs to the object."""
    looks: ClipScorer | None = None
    """Also judges how the object looks."""

    def describe(self) -> str:
        """Return the rules in words, for tables."""
        mask = f"mask: alpha > {self.threshold:g}, ground truth > 0.5"
        occlusion = "object rendered alone, or in scene: its share of the whole rendering, where occlusion counts"
        return "; ".join([mask, occlusion, *([self.looks.describe()] if self.looks else [])])

    def score_views(self, cut: Cut, views: Sequence[TestView], scene: Gaussians | None = None) -> list[Scores]:
        """Return the metrics of each view, see `score`."""
        drawn = parallel_map(lambda view: draw(cut, view.camera), views)
        scores = [self.score(*shown, view) for shown, view in zip(drawn, views, strict=True)]
        if scene is not None and cut.background is not None:
            together = concatenate([cut.object, cut.background])
            for score, view in zip(scores, views, strict=True):
                pictures = (np.clip(_rendered(part, view.camera)[0], 0, 1) for part in (together, scene))
                score["fidelity"] = min(metrics.psnr(*pictures), HIGHEST_PSNR)
        return scores

    def score(self, rgb: FloatArray, alpha: FloatArray, share: FloatArray | None, view: TestView) -> Scores:
        """Return the metrics of one view of an object, without `fidelity`.

        Args:
            rgb, alpha, share: as `draw` returns them; another size is brought to the mask's by the nearest pixel.
            view: what they are compared with; without a picture there is no `psnr`.
        """
        shape = view.coverage.shape
        rgb, alpha = nearest(rgb, shape), nearest(alpha, shape)
        scores = self._silhouette_scores(alpha, view.coverage, view.counted)
        scores["soft_iou"] = 100 * metrics.soft_iou(alpha, view.coverage, view.counted)
        if share is not None:
            in_scene = self._silhouette_scores(nearest(share, shape), *view.in_scene)
            scores |= {name + RULES["in scene"]: value for name, value in in_scene.items()}
        if view.image is not None:
            psnr = metrics.extraction_psnr(rgb, view.image, view.coverage, valid=view.picture_counted)
            scores["psnr"] = min(psnr, HIGHEST_PSNR)
        if self.looks is not None:
            scores |= self.looks.score(rgb, alpha, self.threshold)
        return scores

    def _silhouette_scores(self, silhouette: FloatArray, coverage: FloatArray, counted: BoolArray) -> Scores:
        compared = silhouette, coverage, counted
        iou = 100 * metrics.foreground_iou(*compared, self.threshold)
        return {
            "iou": iou,
            "accuracy": 100 * metrics.pixel_accuracy(*compared, self.threshold),
            "boundary_iou": 100 * metrics.boundary_iou(*compared, self.threshold),
            "acc25": 100.0 * (iou > _ACC25_IOU),
        }


def draw(cut: Cut, camera: Camera) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Render an object alone and in its scene.

    Returns:
        The object over black, not clipped above one, (H, W, 3); its opacity, (H, W); and its share of the whole scene's
        rendering, (H, W), or None if the background is not known.
    """
    rgb, alpha = _rendered(cut.object, camera)
    if cut.background is None:
        return rgb, alpha, None
    member = np.arange(len(cut.object) + len(cut.background)) < len(cut.object)
    whole = concatenate([cut.object, cut.background])
    return rgb, alpha, blend_values(whole, camera, member[:, None].astype(np.float32))[..., 0]


def mean_scores(scores: Iterable[Scores]) -> Scores:
    """Return the mean of each metric over the scores that have it; nothing if there are none.

    >>> mean_scores([{"iou": 90.0, "psnr": 30.0}, {"iou": 80.0}])
    {'iou': 85.0, 'psnr': 30.0}
    """
    scores = list(scores)
    found = {name: [score[name] for score in scores if name in score] for name in METRICS}
    return {name: float(np.mean(values)) for name, values in found.items() if values}


def nearest(picture: FloatArray, shape: Sequence[int]) -> FloatArray:
    """Resample a picture (H, W, ...) to another height and width by the nearest pixel.

    >>> nearest(np.float32([[1, 2]]), (1, 4)).tolist()
    [[1.0, 1.0, 2.0, 2.0]]
    """
    if picture.shape[:2] == tuple(shape):
        return picture
    rows, columns = (((np.arange(n) + 0.5) * m / n).astype(int) for n, m in zip(shape, picture.shape, strict=False))
    return np.asarray(picture[rows][:, columns])


def shared_pixels(
    scene: Gaussians, objects: Sequence[BoolArray], views: Iterable[tuple[Camera, Sequence[FloatArray]]]
) -> IntArray:
    """Return how many pixels true and found objects share over all views, (T + 1, P + 1), each first one of no object.

    A pixel belongs to the object that most of it shows, if that is more than half of it.

    Args:
        scene: all N Gaussians.
        objects: those that were found, (N,) each.
        views: cameras, with the coverage (H, W) of each true object, 0 to 1; at least one.
    """
    counts: IntArray | int = 0
    for camera, coverages in views:
        found = np.zeros((camera.height, camera.width), np.int64)
        if objects:
            values = np.stack(objects, axis=1).astype(np.float32)
            parts = [values[:, i : i + _OBJECTS_PER_PASS] for i in range(0, len(objects), _OBJECTS_PER_PASS)]
            found = _labels(np.concatenate([blend_values(scene, camera, part) for part in parts], axis=2))
        pairs = _labels(np.stack(coverages, axis=2)) * (len(objects) + 1) + found
        size = len(coverages) + 1, len(objects) + 1
        counts = counts + np.bincount(pairs.ravel(), minlength=size[0] * size[1]).reshape(size)
    return np.asarray(counts)


def ious_of(shared: IntArray) -> FloatArray:
    """Return the intersection over union of each true object with each found one, (T, P), of pixels that they share."""
    true, found = shared.sum(axis=1)[1:], shared.sum(axis=0)[1:]
    return np.asarray(shared[1:, 1:] / np.maximum(true[:, None] + found - shared[1:, 1:], 1))


def likeness(picture: FloatArray, image: FloatArray, counted: BoolArray) -> tuple[float, float] | None:
    """Return PSNR in dB, at most 100, and SSIM of a picture with another (H, W, 3); None if no pixel counts."""
    if not counted.any():
        return None
    clipped = np.clip(picture, 0, 1)
    error = min(metrics.psnr(clipped[counted], image[counted]), HIGHEST_PSNR)
    return error, float(metrics.similarity_map(clipped, image)[counted].mean())


def inpaint(photograph: FloatArray, region: BoolArray) -> FloatArray:
    """Return the photograph (H, W, 3) with a region (H, W) painted over from its surroundings alone.

    It is OpenCV's inpainting after "An Image Inpainting Technique Based on the Fast Marching Method" (Telea, 2004).
    """
    picture = np.round(photograph * 255).astype(np.uint8)
    filled = cv2.inpaint(picture, region.astype(np.uint8), INPAINT_RADIUS, cv2.INPAINT_TELEA)
    return np.asarray(filled / np.float32(255))


def _labels(shares: NDArray[np.floating]) -> IntArray:
    """Return the number, from 1, of what has most of each pixel, by shares (H, W, P); 0 where it has at most half."""
    return np.where(shares.max(axis=2) > HALF, shares.argmax(axis=2) + 1, 0)


def _rendered(gaussians: Gaussians, camera: Camera) -> tuple[FloatArray, FloatArray]:
    if not len(gaussians):
        blank = np.zeros((camera.height, camera.width, 3), np.float32)
        return blank, blank[..., 0]
    rendering = render(gaussians, camera)
    return rendering.rgb, rendering.alpha
