"""Metrics of a trimmed object and its scene: silhouettes against ground-truth masks, pictures against photographs.

Silhouettes are accumulated opacities or masks in [0, 1] of shape (H, W), boolean ones included. Where a metric needs a
hard mask, a pixel belongs to `alpha` above the `threshold`, and to `gt` above 0.5. `valid` (H, W) marks the pixels that
count; without it all do. Images hold values in [0, 1].
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, Float64Array
from gaussian_trimmer.views.view import bounding_box, box_slices

Silhouette = NDArray[np.floating[Any]] | BoolArray
Image = NDArray[np.floating[Any]]

THRESHOLD = 0.5
"""Opacity above which a pixel belongs to the object."""
BOUNDARY_DILATION = 0.02
"""Width of the boundary band as a share of the image diagonal, as published with Boundary IoU."""
_SSIM_WINDOW, _SSIM_SIGMA = (11, 11), 1.5
_SSIM_C1, _SSIM_C2 = 0.01**2, 0.03**2


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
