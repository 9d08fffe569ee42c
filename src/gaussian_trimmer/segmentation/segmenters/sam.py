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
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.segmentation.fusion import fuse_with_silhouettes
from gaussian_trimmer.segmentation.segmenters.prompts import Prompt, expected_logits, middle_points
from gaussian_trimmer.segmentation.segmenters.sam_onnx import Candidates, Embedding, OnnxSam
from gaussian_trimmer.segmentation.segmenters.silhouette import SilhouetteSegmenter
from gaussian_trimmer.settings import Range, check_settings
from gaussian_trimmer.views import HALF, View, bounding_box, box_slices

_KEPT_BYTES = 1 << 30
"""Memory for embeddings that are kept: those of some sixty views."""
_POINTS_WITHOUT_SILHOUETTE = 3
"""Points where a decoder takes no silhouette, if none are asked for."""
_MIN_INSIDE_SHARE, _MAX_OUTSIDE_SHARE = 0.8, 0.1
"""Expected share of the picture from which on a point is inside, and up to which it is outside."""
_MODEL_ADVICE = (
    "pass --sam.model FOLDER with the encoder and the decoder of a SAM, MobileSAM or SAM 2 as .onnx files; "
    "docs/sam.md says where they come from"
)


@dataclass(frozen=True)
class SamConfig:
    """Which model segments the views, and how it is prompted."""

    model: str = ""
    """Folder with the encoder and the decoder of a SAM, MobileSAM or SAM 2 as ONNX files."""
    prompt: Literal["expected", "box"] = "expected"
    """`expected`: box and silhouette as the corrected labels expect them; `box`: the bounding box of the coarse object
    alone, eq. 6 of the paper."""
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
    """The paper's choices among these settings: eq. 6, and the masks as they come."""
    return replace(config or SamConfig(), prompt="box", choice="score", fusion=False)


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
        """One line for reports: model, what runs it, and how it is prompted."""
        how = f"prompted by {self.config.prompt}, masks chosen by {self.config.choice}"
        fused = ", fused with the labels" if self.config.fusion else ""
        return f"sam with {self.config.model} ({self.model.family}) on {self.model.provider}, {how}{fused}{self._note}"

    def report_to(self, report: Callable[[str], None]) -> None:
        """Call `report` with "1 of 5" and so on when a view begins."""
        self._report = report

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        """One mask (H, W) for each view; empty where the object is not expected.

        Raises:
            InputError: the model cannot be run.
        """
        return [logits > 0 for logits in self._logits(views)]

    def segment_together(self, views: Sequence[View], gaussians: Gaussians, renderer: Renderer) -> list[BoolArray]:
        """The same, fused with the silhouettes of the labels if the settings say so.

        Args:
            views: V views.
            gaussians: what they show.
            renderer: tells what each Gaussian contributes to the views.

        Raises:
            InputError: the model cannot be run.
        """
        logits = self._logits(views)
        if not self.config.fusion:
            return [logit > 0 for logit in logits]
        silhouettes = SilhouetteSegmenter().segment(views)
        masks, aside = fuse_with_silhouettes(views, silhouettes, logits, gaussians, renderer)
        self._note = f"; {aside} of {len(views)} masks set aside, since they show something else" if aside else ""
        return masks

    def propose(self, rgb: FloatArray, prompt: Prompt) -> Candidates:
        """The model's masks for a prompt in a picture (H, W, 3) in [0, 1], which is encoded once.

        Raises:
            InputError: the model cannot be run.
        """
        return self.model.decode(self._embedding(rgb), prompt)

    def forget(self) -> None:
        """Drop the embeddings that are kept, so that every picture is encoded anew, as in the first trim."""
        self._embeddings.clear()

    def _logits(self, views: Sequence[View]) -> list[FloatArray]:
        """The chosen mask of each view as logits, (H, W)."""
        logits = []
        for number, view in enumerate(views):
            self._report(f"{number + 1} of {len(views)}")
            logits.append(self._logits_of(view))
        return logits

    def _logits_of(self, view: View) -> FloatArray:
        prompt = self._prompt(view)
        if prompt is None:
            return np.full(view.alpha.shape, -1, np.float32)
        found = self.propose(view.rgb, prompt)
        if self.config.choice == "score":
            return np.asarray(found.logits[int(np.argmax(found.scores))])
        fits = [agreement(logits > 0, view.object_prior) for logits in found.logits]
        return np.asarray(found.logits[int(np.argmax(fits))])

    def _prompt(self, view: View) -> Prompt | None:
        if self.config.prompt == "box":
            return Prompt(view.box) if (view.object_alpha > HALF).any() else None
        return prompt_of(view, self.config.points or (0 if self.model.takes_mask else _POINTS_WITHOUT_SILHOUETTE))

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


def prompt_of(view: View, points: int = 0) -> Prompt | None:
    """What the corrected labels expect in a view: box, silhouette and points; None if they expect nothing.

    Args:
        view: the view.
        points: how many points inside, and how many outside within the box.
    """
    silhouette = view.silhouette
    if not silhouette.any():
        return None
    box = bounding_box(silhouette)
    near = np.zeros(silhouette.shape, np.bool_)
    near[box_slices(box)] = True
    inner = middle_points(view.object_prior > _MIN_INSIDE_SHARE, points)
    outer = middle_points(near & (view.object_prior < _MAX_OUTSIDE_SHARE), points)
    inside = np.arange(len(inner) + len(outer)) < len(inner)
    return Prompt(box, np.concatenate([inner, outer]), inside, expected_logits(view.object_prior))


def agreement(mask: BoolArray, share: FloatArray) -> float:
    """Intersection over union of a mask (H, W) and the share of the picture that is expected to be object, (H, W)."""
    expected = np.clip(share, 0, 1)
    common = float(expected[mask].sum())
    return common / max(float(np.count_nonzero(mask)) + float(expected.sum()) - common, 1e-9)
