"""One picture's object around a click or in a box, by colour, and the Gaussians that show it.

For things that stand on nothing: a flower in a bush, a picture on a wall. Colours are told apart by "GrabCut:
Interactive Foreground Extraction using Iterated Graph Cuts" (Rother et al., SIGGRAPH 2004), as OpenCV has it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.rendering import Renderer, Rendering
from gaussian_trimmer.views import Box

_WINDOWS = (0.05, 0.075, 0.11, 0.17, 0.25, 0.35)
"""Half sizes of the windows around a click, relative to the picture's longer side."""
_ITERATIONS = 4
_CORE = 0.12
"""Radius of what is sure around a click, relative to the window's half size."""
_ALIKE, _UNLIKE = 20.0, 45.0
"""Distances in Lab (lightness halved) below which a colour is the clicked one, and above which it is another."""
_NEARLY_BEST = 0.8
"""Of outlines nearly as sharp as the sharpest, the largest counts: things have sharp edges inside them too."""
_BOX_CORE = 0.3
"""Sides of what is sure in the middle of a box, relative to the box."""
_MIN_WEIGHT = 0.05


@dataclass(frozen=True, eq=False)
class _Cut:
    mask: BoolArray
    sharpness: float
    """Colour gradient along the outline, less where the window cuts the mask off."""


def cut_out_around_click(rgb: FloatArray, x: int, y: int) -> BoolArray:
    """Mask of what is around a pixel of a picture in [0, 1], (H, W): the window with the sharpest outline decides."""
    lab = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2Lab), np.float32)
    longer = max(rgb.shape[:2])
    cuts = [_cut_window(rgb, lab, x, y, half * longer) for half in _WINDOWS]
    sharpest = max(cut.sharpness for cut in cuts)
    return max((cut.mask for cut in cuts if cut.sharpness >= _NEARLY_BEST * sharpest), key=np.count_nonzero)


def cut_out_box(rgb: FloatArray, box: Box) -> BoolArray:
    """Mask of what fills the middle of a box in a picture in [0, 1], (H, W)."""
    x0, y0, x1, y1 = box
    labels = np.full(rgb.shape[:2], cv2.GC_BGD, np.uint8)
    labels[y0:y1, x0:x1] = cv2.GC_PR_FGD
    x, y = (x0 + x1) // 2, (y0 + y1) // 2
    width, height = int(_BOX_CORE / 2 * (x1 - x0)), int(_BOX_CORE / 2 * (y1 - y0))
    labels[y - height : y + height + 1, x - width : x + width + 1] = cv2.GC_FGD
    return _grab_cut(rgb, labels)


def lift_visible(
    gaussians: Gaussians, camera: Camera, picture: Rendering, mask: BoolArray, renderer: Renderer
) -> BoolArray:
    """Gaussians that one view's mask (H, W) shows, (N,).

    They contribute more inside the mask than outside it, and lie no farther from the surface that is seen than the
    mask is wide: what shines through from far behind is left out.
    """
    outside, inside = renderer.blend_weights(gaussians, camera, mask.astype(np.uint8), 2).T
    chosen = np.asarray((inside > outside) & (inside > _MIN_WEIGHT))
    if not chosen.any():
        return chosen
    seen = float(np.median(picture.depth[mask & (picture.alpha > 0.5)])) if mask.any() else 0.0
    reach = np.sqrt(np.count_nonzero(mask) / np.pi) * seen / camera.K[0, 0]
    rows = np.flatnonzero(chosen)
    pixels, depths = camera.project(gaussians.means[rows].astype(np.float64))
    x, y = np.clip(np.nan_to_num(pixels), 0, (camera.width - 1, camera.height - 1)).astype(np.int64).T
    chosen[rows] = np.abs(depths - picture.depth[y, x]) < reach
    return chosen


def _cut_window(rgb: FloatArray, lab: FloatArray, x: int, y: int, half: float) -> _Cut:
    """What GrabCut makes of a window around a pixel, and how sharp its outline is."""
    rows, columns = np.indices(rgb.shape[:2])
    distance = np.hypot(columns - x, rows - y)
    border_distance = half - np.maximum(np.abs(columns - x), np.abs(rows - y))
    core, window = distance < max(2.0, _CORE * half), border_distance > 0
    difference = np.linalg.norm((lab - np.median(lab[core], axis=0)) * [0.5, 1, 1], axis=-1)
    likely = (difference < _ALIKE) | ((distance < 0.5 * half) & (difference < _UNLIKE))
    labels = np.where(window, np.where(likely, cv2.GC_PR_FGD, cv2.GC_PR_BGD), cv2.GC_BGD).astype(np.uint8)
    labels[core] = cv2.GC_FGD
    mask = _component(_grab_cut(rgb, labels), x, y)
    outline = mask & (cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0)
    cut_off = np.mean(border_distance[outline] < 3) if outline.any() else 1.0
    sharpness = float(_gradient(lab)[outline].mean()) if outline.any() else 0.0
    return _Cut(mask, sharpness * max(0.0, 1 - 3 * float(cut_off)))


def _grab_cut(rgb: FloatArray, labels: NDArray[np.uint8]) -> BoolArray:
    if not np.isin(labels, (cv2.GC_BGD, cv2.GC_PR_BGD)).any():
        return np.ones(labels.shape, np.bool_)
    picture = np.ascontiguousarray((np.clip(rgb[..., ::-1], 0, 1) * 255).astype(np.uint8))
    cv2.setRNGSeed(0)  # Its colour clustering draws random seeds; the same input shall give the same mask.
    models, unused = (np.zeros((1, 65)), np.zeros((1, 65))), (0, 0, 1, 1)
    cv2.grabCut(picture, labels, unused, *models, _ITERATIONS, cv2.GC_INIT_WITH_MASK)
    return np.asarray((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD))


def _component(mask: BoolArray, x: int, y: int) -> BoolArray:
    """The connected part of a mask that holds a pixel."""
    _, components = cv2.connectedComponents(mask.astype(np.uint8))
    return np.asarray(mask & (components == components[y, x]))


def _gradient(lab: FloatArray) -> FloatArray:
    """Length of the colour gradient in Lab units a pixel, (H, W)."""
    slopes = [cv2.Sobel(lab, cv2.CV_32F, *order) / 4 for order in ((1, 0), (0, 1))]
    return np.asarray(np.sqrt(sum(np.square(slope).sum(axis=-1) for slope in slopes)), np.float32)
