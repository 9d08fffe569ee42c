"""Do no harm, in each picture: labels move a silhouette only to where the picture has an edge.

Labels are corrected by what is alike and what hangs together, and both can be wrong. The picture has evidence of its
own: the outline of an object lies on edges of colour. So the silhouettes of the selection and of the corrected labels
are compared region by region, and where they differ the new outline must lie on stronger edges than the old one, or the
labels must be certain.

The weights come from a logistic regression of whether a region's change was right, over 5,800 regions in views of 30
objects with six kinds of error, and held when each scene was left out in turn. It had edges of depth, too, which gain
nothing in whole trims and went (docs/decisions/masks-from-labels.md).
"""

from __future__ import annotations

from threading import Thread

import cv2
import numpy as np

from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.views import HALF, View, bounding_box, box_slices

_CERTAINTY_WEIGHT = 1.6
"""Weight of the certainty of the corrected labels, 0 to 0.5, relative to that of edges."""
_MIN_SUPPORT = 0.35
"""Smallest sum of both from which on a change is followed."""
_NOISE = 1.0
"""Edges that count as none, in Lab units a pixel."""
_BLUR_PIXELS = 1.0
"""Standard deviation of the blur before gradients are taken, in pixels."""
_EDGE_REACH_PIXELS = 8
"""Farthest that the edges of a pixel are found from, in pixels: by the blur, the slope and the neighbourhood."""
_NEIGHBOURHOOD = np.ones((3, 3), np.uint8)


def prepare() -> None:
    """Have OpenCV make its tables for Lab colours, which takes a tenth of a second, while other things are done."""
    Thread(target=_colour_edges, args=(np.zeros((1, 1, 3), np.float32),), daemon=True).start()


def supported_silhouette(view: View) -> BoolArray:
    """The silhouette of the selection, moved to that of the corrected labels where the picture supports it, (H, W)."""
    before, after = view.object_visible > HALF, view.silhouette
    mask = before.copy()
    if (before == after).all():
        return mask
    window = box_slices(bounding_box(before != after, _EDGE_REACH_PIXELS))
    mask[window] = _supported(view, window, before[window], after[window])
    return mask


def _supported(view: View, window: tuple[slice, slice], before: BoolArray, after: BoolArray) -> BoolArray:
    """The same within a window of the image that holds all that may change and what its edges are found from."""
    mask = before.copy()
    count, regions, boxes, _ = cv2.connectedComponentsWithStats((before != after).astype(np.uint8), connectivity=8)
    edges = _colour_edges(view.rgb[window])
    left, reached = _outline(before), _outline(after)
    old, new = left & ~reached, reached & ~left
    certainty = np.abs(view.object_prior[window] - HALF)
    for region in range(1, count):
        x, y, width, height = boxes[region, :4]
        part = box_slices((max(x - 1, 0), max(y - 1, 0), x + width + 1, y + height + 1))
        member = regions[part] == region
        near = cv2.dilate(member.astype(np.uint8), _NEIGHBOURHOOD) > 0
        support = _CERTAINTY_WEIGHT * float(certainty[part][member].mean())
        support += _gain(edges[part], near & old[part], near & new[part])
        if support > _MIN_SUPPORT:
            mask[part][member] = after[part][member]
    return mask


def _gain(edges: FloatArray, old: BoolArray, new: BoolArray) -> float:
    """How much stronger the edges (H, W) are along the new outline than along the old one: the logarithm of the ratio.

    Zero where a region touches only one of them, such as a piece of its own.
    """
    if not (old.any() and new.any()):
        return 0.0
    return float(np.log((edges[new].mean() + _NOISE) / (edges[old].mean() + _NOISE)))


def _colour_edges(rgb: FloatArray) -> FloatArray:
    """Strongest colour gradient of each pixel's neighbourhood, in Lab units a pixel, (H, W)."""
    lab = np.asarray(cv2.cvtColor(np.clip(rgb, 0, 1), cv2.COLOR_RGB2Lab), np.float32)
    smooth = cv2.GaussianBlur(lab, (0, 0), _BLUR_PIXELS)
    slopes = np.stack([cv2.Sobel(smooth, cv2.CV_32F, *order) / 8 for order in ((1, 0), (0, 1))])
    length = np.sqrt(np.square(slopes).sum(axis=(0, -1)))
    return np.asarray(cv2.dilate(length, _NEIGHBOURHOOD), np.float32)


def _outline(mask: BoolArray) -> BoolArray:
    """Pixels on either side of a mask's outline, (H, W)."""
    pixels = mask.astype(np.uint8)
    return np.asarray(cv2.dilate(pixels, _NEIGHBOURHOOD) != cv2.erode(pixels, _NEIGHBOURHOOD))
