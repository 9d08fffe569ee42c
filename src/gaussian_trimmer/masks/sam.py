"""Virtual view segmentation with any model of the SAM family as ONNX files, without PyTorch.

Each view is encoded once, which takes nearly all of the time, and prompted with what is known of the object. What the
encoder made of a view is kept, so that further prompts in it cost little.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.masks.fusion import fuse_with_silhouettes
from gaussian_trimmer.masks.prompts import Prompt, expected_logits, middle_points
from gaussian_trimmer.masks.sam_onnx import Candidates, Embedding, OnnxSam
from gaussian_trimmer.rendering import blend_values, blend_weights
from gaussian_trimmer.settings import Range, check_settings
from gaussian_trimmer.views.view import HALF, View, bounding_box, box_slices, mask_overlap

_KEPT_BYTES = 1 << 30
"""Memory for embeddings that are kept: those of some sixty views."""
_POINTS_WITHOUT_SILHOUETTE = 3
"""Points where a decoder takes no silhouette, if none are asked for."""
_MIN_INSIDE_SHARE, _MAX_OUTSIDE_SHARE = 0.8, 0.1
"""Expected share of the picture from which on a point is inside, and up to which it is outside."""
_FOLLOWED = 0.5
"""Intersection over union with what is expected, from which on a mask is followed to further views."""
_SEEN = 30.0
"""Blend weight, in pixels of views of 512 x 512, at which earlier masks tell as much of a Gaussian as the labels:
what lies at their outlines, or shines through the object, has less."""
_NOTHING = 1e-6
_MODEL_ADVICE = (
    "give --set sam.model=FOLDER, with the encoder and the decoder of a SAM, MobileSAM or SAM 2 as .onnx files; "
    "docs/sam.md says where they come from"
)


@dataclass(frozen=True)
class SamConfig:
    """Which model segments the views, and how it is prompted."""

    model: str = ""
    """Folder with the encoder and the decoder of a SAM, MobileSAM or SAM 2 as ONNX files."""
    prompt: Literal["expected", "box", "follow"] = "expected"
    """`expected`: box and silhouette as the corrected labels expect them; `box`: the selected object's bounding
    box, eq. 6 of the paper, in each view; `follow`: that box in the first view, and in each further one what the
    masks before it say of the Gaussians that both show, as the paper follows the object from view to view."""
    points: Annotated[int, Range(0, 16)] = 0
    """With `expected`, number of points inside the silhouette, and as many outside of it."""
    choice: Literal["agreement", "score"] = "agreement"
    """Which of the model's masks is taken: that which agrees best with the corrected labels, or that which the model
    scores highest."""
    fusion: bool = True
    """Follow the masks only where they are sure of themselves and agree from view to view, and the silhouettes of the
    labels elsewhere."""
    provider: Literal["auto", "cuda", "coreml", "directml", "cpu"] = "auto"
    """What runs the model; auto is the first of these that the installed ONNX Runtime has."""


def paper_sam(config: SamConfig | None = None) -> SamConfig:
    """Return settings with the paper's choices: eq. 6 in the first view, then followed, and the masks as they come."""
    return replace(config or SamConfig(), prompt="follow", choice="score", fusion=False)


class SamSegmenter:
    """Fulfils the `Segmenter` contract with a model of the SAM family. It is loaded when the segmenter is made.

    Raises:
        InputError: no model is named, ONNX Runtime is missing, or the model cannot be loaded.
    """

    name = "sam"

    def __init__(self, config: SamConfig | None = None) -> None:
        self.config = config or SamConfig()
        check_settings(self.config, self.name)
        if not self.config.model:
            raise InputError(f"The segmenter sam has no model: {_MODEL_ADVICE}.")
        self.model = OnnxSam(Path(self.config.model), self.config.provider)
        self._embeddings: OrderedDict[bytes, Embedding] = OrderedDict()
        self._report: Callable[[str], None] = lambda part: None
        self._note = ""

    def describe(self) -> str:
        """Return one line for reports: model, what runs it, and how it is prompted."""
        how = f"prompted by {self.config.prompt}, masks chosen by {self.config.choice}"
        fused = ", fused with the labels" if self.config.fusion else ""
        return f"sam with {self.config.model} ({self.model.family}) on {self.model.provider}, {how}{fused}{self._note}"

    def report_to(self, report: Callable[[str], None]) -> None:
        """Call `report` with "1 of 5" and so on when a view begins."""
        self._report = report

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        """Return one mask (H, W) for each view; empty where the object is not expected.

        Raises:
            InputError: the model cannot be run.
        """
        return [logits > 0 for logits in self._logits(views)]

    def segment_together(self, views: Sequence[View], gaussians: Gaussians) -> list[BoolArray]:
        """Return the same, fused with the silhouettes of the labels if the settings say so.

        Args:
            views: V views.
            gaussians: what they show.

        Raises:
            InputError: the model cannot be run.
        """
        logits = self._logits(views, gaussians if self.config.prompt == "follow" else None)
        if not self.config.fusion:
            return [logit > 0 for logit in logits]
        silhouettes = [view.silhouette for view in views]
        masks, aside = fuse_with_silhouettes(views, silhouettes, logits, gaussians)
        self._note = f"; {aside} of {len(views)} masks set aside, since they show something else" if aside else ""
        return masks

    def propose(self, rgb: FloatArray, prompt: Prompt) -> Candidates:
        """Return the model's masks for a prompt in a picture (H, W, 3) in [0, 1], which is encoded once.

        Raises:
            InputError: the model cannot be run.
        """
        return self.model.decode(self._embedding(rgb), prompt)

    def forget(self) -> None:
        """Drop the embeddings that are kept, so that every picture is encoded anew, as in the first trim."""
        self._embeddings.clear()

    def _chosen(self, found: Candidates, expected: FloatArray) -> FloatArray:
        """Choose the one of the model's masks for a prompt that the settings ask for, as logits (H, W)."""
        if self.config.choice == "score":
            return np.asarray(found.logits[int(np.argmax(found.scores))])
        fits = [agreement(logits > 0, expected) for logits in found.logits]
        return np.asarray(found.logits[int(np.argmax(fits))])

    def _logits(self, views: Sequence[View], followed: Gaussians | None = None) -> list[FloatArray]:
        """Return the chosen mask of each view as logits, (H, W).

        Where masks are followed, one that is accepted gives each Gaussian the weight that it has inside and outside of
        it. A further view is prompted with the shares that follow, and by the labels where it shows what no earlier
        view has shown.
        """
        weights, logits = np.zeros((len(followed or ()), 2), np.float32), []
        for number, view in enumerate(views):
            self._report(f"{number + 1} of {len(views)}")
            expected, prompt, known = view.object_prior, self._prompt(view), weights.any()
            if followed and known:
                expected = _carried(view, weights, followed)
                prompt = prompt_of(expected, self._points())
            if prompt is None:
                logits.append(np.full(view.alpha.shape, -1, np.float32))
                continue
            logits.append(self._chosen(self.propose(view.rgb, prompt), expected))
            mask = logits[-1] > 0
            if followed and mask.any() and (not known or mask_overlap(mask, expected > HALF) >= _FOLLOWED):
                weights += blend_weights(followed, view.camera, mask.astype(np.uint8), 2)
        return logits

    def _prompt(self, view: View) -> Prompt | None:
        if self.config.prompt == "expected":
            return prompt_of(view.object_prior, self._points())
        return Prompt(view.box) if (view.object_alpha > HALF).any() else None

    def _points(self) -> int:
        return self.config.points or (0 if self.model.takes_mask else _POINTS_WITHOUT_SILHOUETTE)

    def _embedding(self, rgb: FloatArray) -> Embedding:
        picture = np.ascontiguousarray(rgb, np.float32)
        key = hashlib.sha256(repr(picture.shape).encode() + picture.tobytes()).digest()
        if key in self._embeddings:
            self._embeddings.move_to_end(key)
            return self._embeddings[key]
        embedding = self._embeddings[key] = self.model.encode(picture)
        while len(self._embeddings) > 1 and sum(e.n_bytes for e in self._embeddings.values()) > _KEPT_BYTES:
            self._embeddings.popitem(last=False)
        return embedding


def _carried(view: View, weights: FloatArray, gaussians: Gaussians) -> FloatArray:
    """Return the share of a picture that earlier masks, or labels where they show nothing, give the object, (H, W).

    Args:
        view: the view.
        weights: what each Gaussian contributed outside and inside of these masks, (N, 2).
        gaussians: what the views show, N Gaussians.
    """
    total = weights.sum(axis=1) * np.float32(512**2 / view.alpha.size / _SEEN)
    member = weights[:, 1] / np.maximum(weights.sum(axis=1), _NOTHING)
    known = (total / (total + 1)).astype(np.float32)
    shown = blend_values(gaussians, view.camera, np.column_stack([member * known, 1 - known]))
    return np.asarray(shown[..., 0] + shown[..., 1] * view.object_prior / np.maximum(view.alpha, _NOTHING))


def prompt_of(expected: FloatArray, points: int = 0) -> Prompt | None:
    """Return what is expected in a view as a prompt: box, silhouette and points; None if nothing is expected.

    Args:
        expected: share of the picture that the object is expected to contribute, (H, W).
        points: how many points inside, and how many outside within the box.
    """
    silhouette = expected > HALF
    if not silhouette.any():
        return None
    box = bounding_box(silhouette)
    near = np.zeros(silhouette.shape, np.bool_)
    near[box_slices(box)] = True
    inner = middle_points(expected > _MIN_INSIDE_SHARE, points)
    outer = middle_points(near & (expected < _MAX_OUTSIDE_SHARE), points)
    inside = np.arange(len(inner) + len(outer)) < len(inner)
    return Prompt(box, np.concatenate([inner, outer]), inside, expected_logits(expected))


def agreement(mask: BoolArray, share: FloatArray) -> float:
    """Return the intersection over union of a mask (H, W) and the expected share of the object, (H, W)."""
    expected = np.clip(share, 0, 1)
    common = float(expected[mask].sum())
    return common / max(float(np.count_nonzero(mask)) + float(expected.sum()) - common, 1e-9)
