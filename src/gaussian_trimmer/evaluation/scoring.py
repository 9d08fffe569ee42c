"""How well an object matches ground truth in one view, by both rules of occlusion.

Published codes differ in whether the object is rendered alone or counts only where nothing hides it in its scene.
Both are measured: `alone` compares the object's own opacity with the mask, `in scene` its share of the whole scene's
rendering, with everything else before it. They differ as well in the threshold that makes a mask of an opacity.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.evaluation import metrics
from gaussian_trimmer.evaluation.clip_iqa import ClipScorer
from gaussian_trimmer.evaluation.ground_truth import TestView, Truth
from gaussian_trimmer.gaussians import FloatArray, Gaussians, concatenate
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.rendering import blend_values, render

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
    "clip_clear_crops": "CLIP over crops, clear boundary",
    "clip_smooth_crops": "CLIP over crops, smooth boundary",
    "clip_complete_crops": "CLIP over crops, complete object",
}
"""Name of a metric in files -> its name in tables, in their order. All are in percent but `psnr` and `fidelity`, dB."""
RULES: Mapping[str, str] = {"alone": "", "in scene": "_in_scene"}
"""Rule of occlusion -> what the names of its metrics end with."""
ACC25 = ("acc25", "acc25_in_scene")
"""Share of masks with an IoU above a quarter, which says something of many masks together."""
_ACC25_IOU = 25.0
HIGHEST_PSNR = 100.0
"""dB; equal pictures would have an infinite PSNR, and no mean."""


@dataclass(frozen=True, eq=False)
class Cut:
    """A scene cut in two."""

    object: Gaussians
    background: Gaussians | None
    """The scene without the object; None if it is not known."""


@dataclass(frozen=True, eq=False)
class ObjectRender:
    """An object as one view shows it, alone and in its scene."""

    rgb: FloatArray
    """The object alone over black, not clipped above one, (H, W, 3)."""
    alpha: FloatArray
    """Opacity of the object alone, in [0, 1], (H, W)."""
    share: FloatArray | None = None
    """The object's share of the whole scene's rendering, in [0, 1], (H, W); None if the background is not known."""

    def at(self, shape: Sequence[int]) -> ObjectRender:
        """Resample to another height and width, by the nearest pixel."""
        share = None if self.share is None else nearest(self.share, shape)
        return ObjectRender(nearest(self.rgb, shape), nearest(self.alpha, shape), share)


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
        return f"{mask}; {occlusion}; {self.tools()}"

    def tools(self) -> str:
        """Return what renders and judges, for tables."""
        return self.looks.describe() if self.looks else ""

    def show(self, cut: Cut, camera: Camera) -> ObjectRender:
        """Render the object alone and in its scene."""
        alone = _rendered(cut.object, camera)
        if cut.background is None:
            return alone
        whole = concatenate([cut.object, cut.background])
        member = np.zeros((len(whole), 1), np.float32)
        member[: len(cut.object)] = 1
        return ObjectRender(alone.rgb, alone.alpha, blend_values(whole, camera, member)[..., 0])

    def score_views(self, cut: Cut, views: Sequence[TestView]) -> list[Scores]:
        """Return the metrics of each view, see `score`."""
        shown = parallel_map(lambda view: self.show(cut, view.camera), views)
        return [self.score(picture, view) for picture, view in zip(shown, views, strict=True)]

    def score(self, shown: ObjectRender, view: TestView) -> Scores:
        """Return the metrics of one view, without `fidelity`; without `psnr` too if the view has no picture."""
        shown = shown.at(view.alone.coverage.shape)
        scores = self._silhouette_scores(shown.alpha, view.alone)
        scores["soft_iou"] = 100 * metrics.soft_iou(shown.alpha, view.alone.coverage, view.alone.counted)
        if shown.share is not None:
            in_scene = self._silhouette_scores(shown.share, view.in_scene)
            scores |= {name + RULES["in scene"]: value for name, value in in_scene.items()}
        if view.image is not None:
            psnr = metrics.extraction_psnr(shown.rgb, view.image, view.alone.coverage, valid=view.picture_counted)
            scores["psnr"] = min(psnr, HIGHEST_PSNR)
        if self.looks is not None:
            scores |= self.looks.score(shown.rgb, shown.alpha, self.threshold)
        return scores

    def score_mask(self, mask: FloatArray, truth: Truth) -> Scores:
        """Return the metrics of a mask that somebody else rendered, in [0, 1]: the same by both rules of occlusion."""
        scores = self._silhouette_scores(nearest(mask, truth.coverage.shape), truth)
        return scores | {name + RULES["in scene"]: value for name, value in scores.items()}

    def fidelity(self, cut: Cut, camera: Camera, untouched: FloatArray) -> Scores:
        """Return the PSNR of object and background together against the untouched scene's picture (H, W, 3).

        It is at most 100 dB; nothing if the background is not known.
        """
        if cut.background is None:
            return {}
        together = _rendered(concatenate([cut.object, cut.background]), camera)
        psnr = metrics.psnr(np.clip(together.rgb, 0, 1), np.clip(untouched, 0, 1))
        return {"fidelity": min(psnr, HIGHEST_PSNR)}

    def _silhouette_scores(self, silhouette: FloatArray, truth: Truth) -> Scores:
        compared = silhouette, truth.coverage, truth.counted
        iou = 100 * metrics.foreground_iou(*compared, self.threshold)
        return {
            "iou": iou,
            "accuracy": 100 * metrics.pixel_accuracy(*compared, self.threshold),
            "boundary_iou": 100 * metrics.boundary_iou(*compared, self.threshold),
            "acc25": 100.0 * (iou > _ACC25_IOU),
        }


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


def _rendered(gaussians: Gaussians, camera: Camera) -> ObjectRender:
    if not len(gaussians):
        blank = np.zeros((camera.height, camera.width, 3), np.float32)
        return ObjectRender(blank, blank[..., 0])
    rendering = render(gaussians, camera)
    return ObjectRender(rendering.rgb, rendering.alpha)
