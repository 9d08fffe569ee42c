"""How well a scene goes on where its object was: pictures against pictures of the scene without the object.

What counts are the pixels that the object covered, its mask grown by a few pixels, since its colours and its fit reach
beyond the mask. Pixels of other objects' masks are left out: what stands before the object belongs to another question.
"""

from __future__ import annotations

import cv2
import numpy as np

from gaussian_trimmer.evaluation.ground_truth import TestView
from gaussian_trimmer.evaluation.metrics import THRESHOLD, psnr, similarity_map
from gaussian_trimmer.evaluation.scoring import HIGHEST_PSNR
from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.views.view import grown

IGNORED = 0.1
"""Coverage by another object above which a pixel does not count."""
INPAINT_RADIUS = 3.0
"""Pixels from which each pixel is painted over."""


def covered(view: TestView, grow: int) -> BoolArray:
    """Return the pixels that the object covers, and those around them, (H, W)."""
    return grown(view.alone.coverage > THRESHOLD, grow)


def likeness(picture: FloatArray, view: TestView, counted: BoolArray) -> tuple[float, float] | None:
    """Return PSNR in dB, at most 100, and SSIM of a picture (H, W, 3) with a view's image; None if no pixel counts."""
    if not counted.any():
        return None
    assert view.image is not None, "views without the object have their picture"
    clipped = np.clip(picture, 0, 1)
    error = psnr(clipped[counted], view.image[counted])
    return min(error, HIGHEST_PSNR), float(similarity_map(clipped, view.image)[counted].mean())


def inpaint(photograph: FloatArray, region: BoolArray) -> FloatArray:
    """Return the photograph (H, W, 3) with a region (H, W) painted over from its surroundings alone.

    It is OpenCV's inpainting after "An Image Inpainting Technique Based on the Fast Marching Method" (Telea, 2004).
    """
    picture = np.round(photograph * 255).astype(np.uint8)
    filled = cv2.inpaint(picture, region.astype(np.uint8), INPAINT_RADIUS, cv2.INPAINT_TELEA)
    return np.asarray(filled / np.float32(255))
