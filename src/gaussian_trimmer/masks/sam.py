"""Masks that are drawn in the views a trim would look from: by a model of the SAM family, or as the paper does.

The model is prompted with what is known of the object in each view. It is SAM 2 as Hugging Face publishes it, which
follows the object as through a video, or any SAM, MobileSAM or SAM 2 as ONNX files, without PyTorch. Without a model
the paper's preset uses OpenCV's GrabCut, started from the silhouettes of the corrected labels.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.masks.fusion import fuse_with_silhouettes
from gaussian_trimmer.masks.sam2_video import Sam2Video
from gaussian_trimmer.masks.sam_onnx import MASK_LOGITS, OnnxSam, Prompt
from gaussian_trimmer.rendering import blend_values, blend_weights
from gaussian_trimmer.trimming.clock import Progress
from gaussian_trimmer.trimming.trim import views_to_segment
from gaussian_trimmer.views.view import HALF, View, ViewMasks, bounding_box, box_slices, mask_overlap

SamModel = OnnxSam | Sam2Video
_FOLLOWED = 0.5
"""Intersection over union with what is expected, from which on a mask is followed to further views."""
_SEEN = 30.0
"""Blend weight, in pixels of views of 512 x 512, at which earlier masks tell as much of a Gaussian as the labels:
what lies at their outlines, or shines through the object, has less."""
_NOTHING = 1e-6
_GRABCUT_ITERATIONS = 3
"""Alternations between fitting the colour models and cutting the graph."""
_INNER, _OUTER = 0.03, 0.05
"""Depth inside the silhouette from which on pixels are certainly object, and distance outside of it from which on they
are certainly background, relative to its size."""
_WINDOW_MARGIN, _WINDOW_MARGIN_PIXELS = 0.1, 5
"""Margin of the window that is segmented, relative to the silhouette's size, and what is added to it in pixels."""


def draw_masks(
    scene: Gaussians,
    selection: Any,
    *,
    sam: SamModel | Path | None = None,
    paper: bool = False,
    progress: Progress = lambda stage: None,
    **given: Any,
) -> ViewMasks | None:
    """Draw the masks of an object that a trim is to use; None if it takes the silhouettes of its own labels.

    Args:
        scene: all N Gaussians.
        selection: the object, roughly, as `trim` takes it.
        sam: a model of the SAM family, or its folder, which draws them.
        paper: whether masks are drawn as in the paper: by the model, followed from the first view, or else by GrabCut.
        progress: called with "segment 2 of 5" when a view begins, if a model draws the masks.
        given: config, cameras, views, view_cameras, up and excluded, as the trim gets them.

    Raises:
        InputError: as for `trim`, or the model cannot be loaded or run.
    """
    if sam is None and not paper:
        return None
    model = load_sam(sam) if isinstance(sam, Path) else sam
    views, shown = views_to_segment(scene, selection, **given)
    if not views:  # the trim says what is wrong with the selection
        return None
    return grabcut_masks(views) if model is None else sam_masks(model, views, shown, paper=paper, progress=progress)


def load_sam(folder: Path) -> SamModel:
    """Load a model: the config.json and model.safetensors of SAM 2, or an encoder and a decoder as ONNX files.

    Raises:
        InputError: the folder does not hold a model, what runs it is not installed, or it cannot be loaded.
    """
    return Sam2Video(folder) if (folder / "config.json").is_file() else OnnxSam(folder)


def sam_masks(
    model: SamModel,
    views: Sequence[View],
    shown: Gaussians,
    *,
    paper: bool = False,
    progress: Progress = lambda stage: None,
) -> ViewMasks:
    """Return each view's camera with a mask of the object, (H, W).

    Args:
        model: what draws them.
        views: V views in order of yaw.
        shown: what they show, N Gaussians.
        paper: take the masks as they come, the object's box in the first view being the prompt (eq. 6), and the object
            followed from there. By default an ONNX model is prompted by the corrected labels in every view, and masks
            are followed only where they are sure of themselves and agree from view to view.
        progress: called with "segment 2 of 5" when an ONNX model begins a view.

    Raises:
        InputError: the model cannot be run.
    """
    if isinstance(model, Sam2Video):
        logits = model.follow(views)
    else:
        logits = _followed(model, views, shown, progress) if paper else _expected(model, views, progress)
    masks = [logit > 0 for logit in logits] if paper else fuse_with_silhouettes(views, logits, shown)
    return [(view.camera, mask) for view, mask in zip(views, masks, strict=True)]


def _expected(model: OnnxSam, views: Sequence[View], progress: Progress) -> list[FloatArray]:
    """Return the mask that agrees best with the labels, which are the prompt, as logits (H, W) of each view."""
    logits = []
    for number, view in enumerate(views):
        progress(f"segment {number + 1} of {len(views)}")
        prompt, found = prompt_of(view.object_prior), np.full((1, *view.alpha.shape), -1, np.float32)
        if prompt is not None:
            found = model.propose(view.rgb, prompt)
        logits.append(_most_like(found, view.object_prior))
    return logits


def _most_like(found: FloatArray, expected: FloatArray) -> FloatArray:
    """Return which of the masks that a model proposes, logits (K, H, W), agrees best with what is expected, (H, W).

    The model's own scores prefer parts of an object to all of it, such as a bottle without its label.
    """
    return max(found, key=lambda logits: agreement(logits > 0, expected))


def _followed(model: OnnxSam, views: Sequence[View], shown: Gaussians, progress: Progress) -> list[FloatArray]:
    """Return the masks that agree best with what is expected, followed from the first view, as logits (H, W) of each.

    At first that is what the labels say. One that is accepted gives each Gaussian the weight that it has inside and
    outside of it. A further view is prompted with the shares that follow, and by the labels where it shows what no
    earlier view has shown.
    """
    weights, logits = np.zeros((len(shown), 2), np.float32), list[FloatArray]()
    for number, view in enumerate(views):
        progress(f"segment {number + 1} of {len(views)}")
        known, expected = weights.any(), view.object_prior
        if known:
            expected = _carried(view, weights, shown)
        prompt = prompt_of(expected) if known else Prompt(view.box) if (view.object_alpha > HALF).any() else None
        if prompt is None:
            logits.append(np.full(view.alpha.shape, -1, np.float32))
            continue
        logits.append(_most_like(model.propose(view.rgb, prompt), expected))
        mask = logits[-1] > 0
        if mask.any() and (not known or mask_overlap(mask, expected > HALF) >= _FOLLOWED):
            weights += blend_weights(shown, view.camera, mask.astype(np.uint8), 2)
    return logits


def _carried(view: View, weights: FloatArray, shown: Gaussians) -> FloatArray:
    """Return the share of a picture that earlier masks, or labels where they show nothing, give the object, (H, W).

    Args:
        view: the view.
        weights: what each Gaussian contributed outside and inside of these masks, (N, 2).
        shown: what the views show, N Gaussians.
    """
    total = weights.sum(axis=1) * np.float32(512**2 / view.alpha.size / _SEEN)
    member = weights[:, 1] / np.maximum(weights.sum(axis=1), _NOTHING)
    known = (total / (total + 1)).astype(np.float32)
    blended = blend_values(shown, view.camera, np.column_stack([member * known, 1 - known]))
    return np.asarray(blended[..., 0] + blended[..., 1] * view.object_prior / np.maximum(view.alpha, _NOTHING))


def prompt_of(expected: FloatArray) -> Prompt | None:
    """Return the share of the picture that the object is expected to contribute (H, W) as a prompt; None if nothing."""
    silhouette, (scale, offset) = expected > HALF, MASK_LOGITS
    if not silhouette.any():
        return None
    logits = np.clip(expected, 0, 1) * np.float32(scale) + np.float32(offset)
    return Prompt(bounding_box(silhouette), np.asarray(logits))


def agreement(mask: BoolArray, share: FloatArray) -> float:
    """Return the intersection over union of a mask (H, W) and the expected share of the object, (H, W)."""
    expected = np.clip(share, 0, 1)
    common = float(expected[mask].sum())
    return common / max(float(np.count_nonzero(mask)) + float(expected.sum()) - common, 1e-9)


def grabcut_masks(views: Sequence[View]) -> ViewMasks:
    """Return each view's camera with a mask (H, W): colour models of object and background, and a cut between them.

    "GrabCut: Interactive Foreground Extraction using Iterated Graph Cuts" (Rother et al., SIGGRAPH 2004).
    """
    return [(view.camera, _segment(view)) for view in views]


def _segment(view: View) -> BoolArray:
    mask, silhouette = np.zeros(view.alpha.shape, np.bool_), view.silhouette.astype(np.uint8)
    if not silhouette.any():
        return mask
    size = float(np.sqrt(silhouette.sum()))
    near = np.asarray(cv2.dilate(silhouette, _disk(_OUTER * size)), np.uint8)
    trimap = np.full(silhouette.shape, cv2.GC_BGD, np.uint8)
    trimap[near > 0] = cv2.GC_PR_BGD
    trimap[silhouette > 0] = cv2.GC_PR_FGD
    trimap[np.asarray(cv2.erode(silhouette, _disk(_INNER * size))) > 0] = cv2.GC_FGD
    window = box_slices(bounding_box(near > 0, int(_WINDOW_MARGIN * size) + _WINDOW_MARGIN_PIXELS))
    mask[window] = _grab_cut(view.rgb[window], trimap[window])
    return mask


def _grab_cut(rgb: FloatArray, trimap: NDArray[np.uint8]) -> BoolArray:
    """Return OpenCV's GrabCut on a picture (H, W, 3) in [0, 1], as a mask (H, W); the same for the same input."""
    labels = np.array(trimap, order="C")
    if not np.isin(labels, (cv2.GC_BGD, cv2.GC_PR_BGD)).any():
        return np.ones(labels.shape, np.bool_)
    picture = np.ascontiguousarray((np.clip(rgb[..., ::-1], 0, 1) * 255).astype(np.uint8))
    cv2.setRNGSeed(0)  # Its colour clustering draws random seeds; the same input shall give the same mask.
    models, unused = (np.zeros((1, 65)), np.zeros((1, 65))), (0, 0, 1, 1)  # The rectangle counts without a mask only.
    cv2.grabCut(picture, labels, unused, *models, _GRABCUT_ITERATIONS, cv2.GC_INIT_WITH_MASK)
    return np.asarray((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD))


def _disk(radius: float) -> NDArray[np.uint8]:
    r = max(1, round(radius))
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * r + 1, 2 * r + 1)), np.uint8)
