"""How well an object matches ground truth in one view: the metrics, and the rules under which they are taken.

The field's codes differ in the threshold that makes a mask of an opacity, and in whether the object is rendered alone
or behind what hides it in the scene. `Judge` holds both, with the renderer, and says so in words for every table.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation import metrics
from gaussian_trimmer.evaluation.ground_truth import TestView
from gaussian_trimmer.gaussians import FloatArray, Gaussians, concatenate
from gaussian_trimmer.rendering import Renderer

Occlusion = Literal["alone", "in-scene"]
Scores = dict[str, float]
"""Metric -> percentage, or dB for `psnr` and `fidelity`; a metric that cannot be had is missing."""

METRICS: Mapping[str, str] = {
    "iou": "IoU",
    "accuracy": "accuracy",
    "boundary_iou": "boundary IoU",
    "soft_iou": "soft IoU",
    "psnr": "extraction PSNR",
    "fidelity": "fidelity",
    "clip_clear": "CLIP-IQA clear boundary",
    "clip_smooth": "CLIP-IQA smooth boundary",
    "clip_complete": "CLIP-IQA complete object",
}
"""Name of a metric in files -> its name in tables. `psnr` and `fidelity` are in dB, the others in percent."""
HIGHEST_PSNR = 100.0
"""dB; pictures that agree everywhere would have an infinite one, and no mean."""


@dataclass(frozen=True, eq=False)
class Cut:
    """A scene cut in two."""

    object: Gaussians
    background: Gaussians | None
    """The scene without the object; None if it is not known."""


@dataclass(frozen=True, eq=False)
class Shown:
    """An object as one view shows it."""

    rgb: FloatArray
    """The object alone over black, not clipped above one, (H, W, 3)."""
    alpha: FloatArray
    """Its silhouette under the judge's rule, in [0, 1], (H, W)."""


class Looks(Protocol):
    """Judges how an object looks."""

    def describe(self) -> str:
        """How, for tables."""
        ...

    def score(self, shown: Shown, threshold: float) -> Scores:
        """Scores of an object that is rendered alone."""
        ...


@dataclass(frozen=True)
class Judge:
    """The rules of a comparison with ground truth."""

    renderer: Renderer
    threshold: float = metrics.THRESHOLD
    """Opacity above which a rendered pixel belongs to the object."""
    occlusion: Occlusion = "alone"
    """`alone`: the object's accumulated opacity with nothing before it; `in-scene`: its share of the composite."""
    looks: Looks | None = None
    """Also judges the looks of the object, where it is rendered alone."""

    def describe(self) -> str:
        """The rules in words, for tables."""
        rules = {
            "alone": "object rendered alone (no occlusion)",
            "in-scene": "object's share of the whole scene (occlusion counts)",
        }
        rule = f"mask: alpha > {self.threshold:g}, ground truth > 0.5; {rules[self.occlusion]}"
        looks = [self.looks.describe()] if self.looks is not None and self.occlusion == "alone" else []
        return "; ".join([rule, f"renderer: {self.renderer.name}", *looks])

    def show(self, cut: Cut, camera: Camera) -> Shown:
        """Render the object under the rules.

        Raises:
            InputError: occlusion counts, and the scene without the object is not known.
        """
        alone = _rendered(cut.object, camera, self.renderer)
        if self.occlusion == "alone":
            return alone
        if cut.background is None:
            raise InputError(
                "The scene without this object is not known, so what hides the object is not either; measure it with "
                "--occlusion alone."
            )
        together = concatenate([cut.object, cut.background])
        member = np.zeros((len(together), 1), np.float32)
        member[: len(cut.object)] = 1
        return Shown(alone.rgb, self.renderer.blend_values(together, camera, member)[..., 0])

    def score(self, shown: Shown, view: TestView) -> Scores:
        """The metrics of one view, without fidelity; without `psnr` too if the view has no picture."""
        alpha, truth, valid = shown.alpha, view.coverage, view.valid
        scores = {
            "iou": 100 * metrics.foreground_iou(alpha, truth, valid, self.threshold),
            "accuracy": 100 * metrics.pixel_accuracy(alpha, truth, valid, self.threshold),
            "boundary_iou": 100 * metrics.boundary_iou(alpha, truth, valid, threshold=self.threshold),
            "soft_iou": 100 * metrics.soft_iou(alpha, truth, valid),
        }
        if view.image is not None:
            psnr = metrics.extraction_psnr(shown.rgb, view.image, truth, valid=view.picture_valid)
            scores["psnr"] = min(psnr, HIGHEST_PSNR)
        if self.looks is not None and self.occlusion == "alone":
            scores |= self.looks.score(shown, self.threshold)
        return scores

    def fidelity(self, cut: Cut, camera: Camera, untouched: FloatArray) -> Scores:
        """PSNR of object and background together against the untouched scene's picture (H, W, 3), capped at 100 dB.

        Nothing if the background is not known.
        """
        if cut.background is None:
            return {}
        together = _rendered(concatenate([cut.object, cut.background]), camera, self.renderer)
        psnr = metrics.psnr(np.clip(together.rgb, 0, 1), np.clip(untouched, 0, 1))
        return {"fidelity": min(psnr, HIGHEST_PSNR)}


def mean_scores(scores: Iterable[Scores]) -> Scores:
    """The mean of each metric over those that have it; nothing for none.

    >>> mean_scores([{"iou": 90.0, "psnr": 30.0}, {"iou": 80.0}])
    {'iou': 85.0, 'psnr': 30.0}
    """
    scores = list(scores)
    found = {name: [score[name] for score in scores if name in score] for name in METRICS}
    return {name: float(np.mean(values)) for name, values in found.items() if values}


def _rendered(gaussians: Gaussians, camera: Camera, renderer: Renderer) -> Shown:
    if not len(gaussians):
        blank = np.zeros((camera.height, camera.width, 3), np.float32)
        return Shown(blank, blank[..., 0])
    rendering = renderer.render(gaussians, camera)
    return Shown(rendering.rgb, rendering.alpha)
