"""The object around a click or in a box of one picture, cut out by colour, and the Gaussians that show it.

This is for objects that stand on nothing: a flower in a bush, a picture on a wall. Colours are separated by GrabCut.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.rendering import Renderer, Rendering
from gaussian_trimmer.segmentation.segmenters.grabcut import grab_cut
from gaussian_trimmer.views import HALF, Box

_WINDOWS = (0.05, 0.075, 0.11, 0.17, 0.25, 0.35)
"""Half sizes of the windows around a click, relative to the picture's longer side."""
_ITERATIONS = 4
_CORE, _MIN_CORE = 0.12, 2.0
"""Radius around a click of what is certainly object, relative to the window's half size, and at least in pixels."""
_LAB_WEIGHTS = (0.5, 1.0, 1.0)
"""Weights of the channels in distances between Lab colours: lightness changes with shading."""
_ALIKE, _UNLIKE = 20.0, 45.0
"""Distances in Lab below which a colour is like the clicked one, and above which it is another."""
_NEAR = 0.5
"""Distance from a click within which colours between these two count as like it, relative to the window's half size."""
_BORDER = 3
"""Distance from the window's border, in pixels, at which an outline is the window's rather than the object's."""
_CUT_OFF_PENALTY = 3.0
"""An outline that lies on the window's border by one over this share has no sharpness at all."""
_NEARLY_BEST = 0.8
"""Of outlines nearly as sharp as the sharpest, the largest counts: objects have sharp edges inside them too."""
_BOX_CORE = 0.3
"""Sides of what is certainly object in the middle of a box, relative to the box."""
_MIN_WEIGHT = 0.05
"""Blend weight inside the mask, in pixels, above which a Gaussian counts as shown by it."""


@dataclass(frozen=True, eq=False)
class _Cut:
    mask: BoolArray
    sharpness: float
    """Mean colour gradient along the outline, lowered where the window cuts the mask off."""


def cut_out_around_click(rgb: FloatArray, x: int, y: int) -> BoolArray:
    """Mask (H, W) of the object around a pixel of a picture in [0, 1], from the window with the sharpest outline."""
    lab = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2Lab), np.float32)
    longer = max(rgb.shape[:2])
    cuts = [_cut_window(rgb, lab, x, y, half * longer) for half in _WINDOWS]
    sharpest = max(cut.sharpness for cut in cuts)
    return max((cut.mask for cut in cuts if cut.sharpness >= _NEARLY_BEST * sharpest), key=np.count_nonzero)


def cut_out_box(rgb: FloatArray, box: Box) -> BoolArray:
    """Mask (H, W) of the object that fills the middle of a box in a picture in [0, 1]."""
    x0, y0, x1, y1 = box
    labels = np.full(rgb.shape[:2], cv2.GC_BGD, np.uint8)
    labels[y0:y1, x0:x1] = cv2.GC_PR_FGD
    x, y = (x0 + x1) // 2, (y0 + y1) // 2
    width, height = int(_BOX_CORE / 2 * (x1 - x0)), int(_BOX_CORE / 2 * (y1 - y0))
    labels[y - height : y + height + 1, x - width : x + width + 1] = cv2.GC_FGD
    return grab_cut(rgb, labels, _ITERATIONS)


def lift_visible(
    gaussians: Gaussians, camera: Camera, picture: Rendering, mask: BoolArray, renderer: Renderer
) -> BoolArray:
    """Gaussians that one view's mask (H, W) shows, (N,).

    They contribute more inside the mask than outside it, and their distance from the visible surface is at most the
    radius of the mask, so that what shines through from far behind is left out.
    """
    outside, inside = renderer.blend_weights(gaussians, camera, mask.astype(np.uint8), 2).T
    chosen = np.asarray((inside > outside) & (inside > _MIN_WEIGHT))
    if not chosen.any():
        return chosen
    seen = float(np.median(picture.depth[mask & (picture.alpha > HALF)])) if mask.any() else 0.0
    reach = np.sqrt(np.count_nonzero(mask) / np.pi) * seen / camera.K[0, 0]
    rows = np.flatnonzero(chosen)
    pixels, depths = camera.project(gaussians.means[rows].astype(np.float64))
    x, y = np.clip(np.nan_to_num(pixels), 0, (camera.width - 1, camera.height - 1)).astype(np.int64).T
    chosen[rows] = np.abs(depths - picture.depth[y, x]) < reach
    return chosen


def _cut_window(rgb: FloatArray, lab: FloatArray, x: int, y: int, half: float) -> _Cut:
    """The mask that GrabCut finds in a window around a pixel, and how sharp its outline is."""
    rows, columns = np.indices(rgb.shape[:2])
    distance = np.hypot(columns - x, rows - y)
    border_distance = half - np.maximum(np.abs(columns - x), np.abs(rows - y))
    core, window = distance < max(_MIN_CORE, _CORE * half), border_distance > 0
    difference = np.linalg.norm((lab - np.median(lab[core], axis=0)) * _LAB_WEIGHTS, axis=-1)
    likely = (difference < _ALIKE) | ((distance < _NEAR * half) & (difference < _UNLIKE))
    labels = np.where(window, np.where(likely, cv2.GC_PR_FGD, cv2.GC_PR_BGD), cv2.GC_BGD).astype(np.uint8)
    labels[core] = cv2.GC_FGD
    mask = _component(grab_cut(rgb, labels, _ITERATIONS), x, y)
    outline = mask & (cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0)
    cut_off = np.mean(border_distance[outline] < _BORDER) if outline.any() else 1.0
    sharpness = float(_gradient(lab)[outline].mean()) if outline.any() else 0.0
    return _Cut(mask, sharpness * max(0.0, 1 - _CUT_OFF_PENALTY * float(cut_off)))


def _component(mask: BoolArray, x: int, y: int) -> BoolArray:
    """The connected part of a mask that holds a pixel."""
    _, components = cv2.connectedComponents(mask.astype(np.uint8))
    return np.asarray(mask & (components == components[y, x]))


def _gradient(lab: FloatArray) -> FloatArray:
    """Length of the colour gradient in Lab units a pixel, (H, W)."""
    slopes = [cv2.Sobel(lab, cv2.CV_32F, *order) / 4 for order in ((1, 0), (0, 1))]
    return np.asarray(np.sqrt(sum(np.square(slope).sum(axis=-1) for slope in slopes)), np.float32)
