"""Metrics of a trimmed object and its scene: silhouettes against ground-truth masks, pictures against photographs, and
CLIP-IQA, which says how an object looks.

Silhouettes are accumulated opacities or masks in [0, 1] of shape (H, W), boolean ones included. Where a metric needs a
hard mask, a pixel belongs to `alpha` above the `threshold`, and to `gt` above 0.5. `valid` (H, W) marks the pixels that
count; without it all do. Images hold values in [0, 1].
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError, clip_name, first_line
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.rendering import blend_values
from gaussian_trimmer.views.view import HALF, bounding_box, box_slices

Silhouette = NDArray[np.floating[Any]] | BoolArray
Image = NDArray[np.floating[Any]]

THRESHOLD = 0.5
"""Opacity above which a pixel belongs to the object."""
BOUNDARY_DILATION = 0.02
"""Width of the boundary band as a share of the image diagonal, as published with Boundary IoU."""
_SSIM_WINDOW, _SSIM_SIGMA = (11, 11), 1.5
_SSIM_C1, _SSIM_C2 = 0.01**2, 0.03**2
HIGHEST_PSNR = 100.0
"""dB; equal pictures would have an infinite PSNR, and no mean."""
INPAINT_RADIUS = 3.0
"""Pixels from which each pixel of a photograph is painted over."""
_OBJECTS_PER_PASS = 16
PAIRS = {
    "clip_clear": ("clear boundary", "unclear boundary"),
    "clip_smooth": ("smooth boundary", "noisy boundary"),
    "clip_complete": ("complete object", "mutilated object"),
}
"""Metric -> the prompt that is wished for, and its opposite."""
_CLIP_MEAN, _CLIP_STD = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)
"""Mean and deviation of the colours that CLIP models are trained on."""


def foreground_iou(
    alpha: Silhouette, gt: Silhouette, valid: BoolArray | None = None, threshold: float = THRESHOLD
) -> float:
    """Intersection over union of the thresholded silhouettes; 1 if both are empty.

    >>> foreground_iou(np.array([[0.9, 0.6, 0.5]]), np.array([[1.0, 0.0, 0.0]]))
    0.5
    """
    predicted, truth, counted = _masks(alpha, gt, valid, threshold)
    return _iou(predicted & counted, truth & counted)


def pixel_accuracy(
    alpha: Silhouette, gt: Silhouette, valid: BoolArray | None = None, threshold: float = THRESHOLD
) -> float:
    """Share of pixels, of object and surroundings alike, on the right side; 1 if no pixel counts.

    >>> pixel_accuracy(np.array([[0.9, 0.6, 0.5, 0.0]]), np.array([[1.0, 0.0, 0.0, 0.0]]))
    0.75
    """
    predicted, truth, counted = _masks(alpha, gt, valid, threshold)
    return _ratio(np.sum((predicted == truth) & counted), np.sum(counted))


def boundary_iou(
    alpha: Silhouette, gt: Silhouette, valid: BoolArray | None = None, threshold: float = THRESHOLD
) -> float:
    """Intersection over union of the parts of both masks that lie near their own contours; 1 if both are empty.

    The band reaches 2 % of the image diagonal, and at least one pixel, into the mask. The image's edge is a contour; an
    edge between the mask and pixels that do not count is not, since it belongs to the occluder.

    Eq. 2 of "Boundary IoU: Improving Object-Centric Image Segmentation Evaluation" (Cheng et al., CVPR 2021).
    """
    predicted, truth, counted = _masks(alpha, gt, valid, threshold)
    width = max(1, round(BOUNDARY_DILATION * float(np.hypot(*predicted.shape))))
    return _iou(_boundary_band(predicted, counted, width), _boundary_band(truth, counted, width))


def soft_iou(alpha: Silhouette, gt: Silhouette, valid: BoolArray | None = None) -> float:
    """Sum of the smaller over sum of the larger of the two opacities, without a threshold; 1 if both are zero.

    >>> soft_iou(np.array([[1.0, 0.25]]), np.array([[0.5, 0.75]]))
    0.42857142857142855
    """
    counted = _counted(alpha, gt, valid)
    predicted, truth = np.asarray(alpha, np.float64)[counted], np.asarray(gt, np.float64)[counted]
    return _ratio(np.minimum(predicted, truth).sum(), np.maximum(predicted, truth).sum())


def extraction_psnr(
    rgb: Image, gt_image: Image, gt_mask: Silhouette, margin: int = 20, valid: BoolArray | None = None
) -> float:
    """PSNR in dB of the object rendered over black (H, W, 3) against the photograph (H, W, 3) times the soft mask.

    Only the mask's bounding box counts, widened by `margin` pixels on each side and clipped to the image; the whole
    image if the mask is empty. The rendering is clipped to [0, 1]. Infinite where the two agree everywhere.
    """
    counted = _counted(rgb[..., 0], gt_mask, valid)
    target = np.asarray(gt_image, np.float64) * np.asarray(gt_mask, np.float64)[..., None]
    box = box_slices(bounding_box(np.asarray(gt_mask > THRESHOLD), margin))
    inside = counted[box]
    return psnr(np.clip(rgb, 0.0, 1.0)[box][inside], target[box][inside])


def psnr(a: Image, b: Image) -> float:
    """Peak signal-to-noise ratio in dB of two arrays of equal shape with peak 1; infinite if they are equal or empty.

    >>> round(psnr(np.array([0.0, 0.1]), np.array([0.1, 0.0])), 6)
    20.0
    """
    if a.shape != b.shape:
        raise ValueError(f"The images have shapes {a.shape} and {b.shape}; equal shapes are needed.")
    squared: Float64Array = (np.asarray(a, np.float64) - np.asarray(b, np.float64)) ** 2
    if not squared.any():
        return float("inf")
    return float(-10.0 * np.log10(squared.mean()))


def similarity_map(a: Image, b: Image) -> Float64Array:
    """Structural similarity of two images (H, W, 3) with peak 1 around each pixel, the mean of their channels, (H, W).

    Means, variances and covariance are taken in a Gaussian window of 11 pixels and a standard deviation of 1.5; beyond
    the edge the image is mirrored.

    Eq. 13 of "Image Quality Assessment: From Error Visibility to Structural Similarity" (Wang et al., 2004).
    """
    if a.shape != b.shape:
        raise ValueError(f"The images have shapes {a.shape} and {b.shape}; equal shapes are needed.")

    def local(image: Float64Array) -> Float64Array:
        return np.asarray(cv2.GaussianBlur(image, _SSIM_WINDOW, _SSIM_SIGMA, borderType=cv2.BORDER_REFLECT_101))

    x, y = np.asarray(a, np.float64), np.asarray(b, np.float64)
    mean_x, mean_y = local(x), local(y)
    variances = local(x * x) - mean_x**2 + local(y * y) - mean_y**2
    covariance = local(x * y) - mean_x * mean_y
    means = (2 * mean_x * mean_y + _SSIM_C1) / (mean_x**2 + mean_y**2 + _SSIM_C1)
    return np.asarray((means * (2 * covariance + _SSIM_C2) / (variances + _SSIM_C2)).mean(axis=-1))


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
    error = min(psnr(clipped[counted], image[counted]), HIGHEST_PSNR)
    return error, float(similarity_map(clipped, image)[counted].mean())


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


def _masks(
    alpha: Silhouette, gt: Silhouette, valid: BoolArray | None, threshold: float
) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Both silhouettes as hard masks, and the pixels that count."""
    counted = _counted(alpha, gt, valid)
    return np.asarray(alpha > threshold), np.asarray(gt > THRESHOLD), counted


def _counted(alpha: Silhouette, gt: Silhouette, valid: BoolArray | None) -> BoolArray:
    """The pixels that count, all if `valid` is not given; ValueError if the sizes differ."""
    counted = np.ones(alpha.shape, np.bool_) if valid is None else np.asarray(valid, np.bool_)
    if not alpha.shape == gt.shape == counted.shape or alpha.ndim != 2:
        shapes = f"{alpha.shape}, {gt.shape} and {counted.shape}"
        raise ValueError(f"Silhouette, ground truth and valid pixels have shapes {shapes}; one (H, W) is needed.")
    return counted


def _boundary_band(mask: BoolArray, counted: BoolArray, width: int) -> BoolArray:
    """Counted pixels of the mask at most `width` pixels, along rows, columns or diagonals, from its outside."""
    # Unknown pixels are taken as inside, so that erosion starts only at true contours.
    padded = np.pad((mask | ~counted).astype(np.uint8), 1)
    interior = cv2.erode(padded, np.ones((3, 3), np.uint8), iterations=width)[1:-1, 1:-1]
    return np.asarray(mask & counted & (interior == 0))


def _iou(a: BoolArray, b: BoolArray) -> float:
    return _ratio(np.sum(a & b), np.sum(a | b))


def _ratio(part: np.number[Any], whole: np.number[Any]) -> float:
    """The quotient, or 1 where there is nothing to compare."""
    return float(part / whole) if whole > 0 else 1.0


class ClipScorer:
    """Scores pictures of objects with one CLIP model, which is loaded once.

    The score of a picture is the probability that CLIP gives to the first prompt of a pair. The whole view is shown,
    with the object alone over black, and prompts have the form of the official code's "Good photo."; that code shows
    pictures of any size to a CLIP of convolutions (RN50), which Transformers does not have, so here they are stretched
    to the model's square. The model runs without its image processor, which would need torchvision.

    After "Exploring CLIP for Assessing the Look and Feel of Images" (Wang et al., AAAI 2023).

    Raises:
        InputError: PyTorch or Transformers is missing, or the model cannot be loaded.
    """

    def __init__(self, model: str) -> None:
        try:
            self._torch, transformers = import_module("torch"), import_module("transformers")
        except ImportError as error:
            needs = f"CLIP-IQA needs PyTorch and Transformers ({error}); in the program's clone: pip install '.[eval]'."
            raise InputError(needs) from error
        local = Path(model).is_dir()
        try:
            # Weights are read from safetensors alone: other files could hold code.
            self._model = transformers.CLIPModel.from_pretrained(model, use_safetensors=True, local_files_only=local)
            tokenizer = transformers.CLIPTokenizer.from_pretrained(model, local_files_only=local)
        except (OSError, ValueError, RuntimeError, KeyError) as error:
            raise InputError(
                f"Cannot load the CLIP model '{model}' ({first_line(error)}); give a folder with model.safetensors and "
                "the tokenizer's files, or a name on the Hugging Face hub."
            ) from error
        self._model.eval()
        self.name = clip_name(Path(model).name if local else model)
        """Name of the model, for tables."""
        self._side = int(self._model.config.vision_config.image_size)
        prompts = [f"{prompt.capitalize()}." for pair in PAIRS.values() for prompt in pair]
        self._prompts = tokenizer(prompts, padding=True, return_tensors="pt")

    def describe(self) -> str:
        """Return what the scores were made with, for tables."""
        return f"CLIP-IQA by {self.name}: whole view over black and prompts as published"

    def score(self, rgb: FloatArray, alpha: FloatArray, threshold: float) -> dict[str, float]:
        """Return the three scores of an object in percent; nothing if it is not in the picture.

        Args:
            rgb: the object over black, (H, W, 3).
            alpha: its opacity, (H, W).
            threshold: opacity above which a pixel belongs to it.
        """
        if not (alpha > threshold).any():
            return {}
        return dict(zip(PAIRS, (100 * self._probabilities(np.clip(rgb, 0, 1))).tolist(), strict=True))

    def _probabilities(self, picture: FloatArray) -> FloatArray:
        """Return the probability of the first prompt of each pair, (3,)."""
        torch, side = self._torch, self._side
        interpolation = cv2.INTER_AREA if picture.shape[0] > side else cv2.INTER_CUBIC
        resized = np.asarray(cv2.resize(picture, (side, side), interpolation=interpolation))
        pixels = (resized - np.array(_CLIP_MEAN, np.float32)) / np.array(_CLIP_STD, np.float32)
        with torch.inference_mode():
            logits = self._model(
                pixel_values=torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1)[None])), **self._prompts
            ).logits_per_image
            pairs = logits.float().reshape(len(PAIRS), 2).softmax(dim=-1)[:, 0]
        return np.asarray(pairs.numpy(), np.float32)
