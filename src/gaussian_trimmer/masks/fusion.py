"""Masks of a model and silhouettes of labels, fused: each is believed where it is known to be right.

A model that looks at pictures knows the edges of large Gaussians and of thin things before the sky. The corrected
labels know what is hidden and what belongs together, and their silhouettes agree from view to view. Where the two
differ in a view, the mask is followed if it is sure of itself there and the masks of the other views say the same of
the Gaussians that are shown there. Both are evidence of the masks themselves: no threshold on the labels is involved.
What is so thin that it falls between the cells of a mask's grid, a rod or a wire, is not removed because masks lack it:
they all do.

The weights are a logistic regression of which of the two was right, by the ground truth of 66 selections of 12 objects
in three scenes; they hold when each scene is left out in turn (docs/decisions.md).
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.rendering import blend_values
from gaussian_trimmer.rendering.tile_renderer import label_weights, share_inside
from gaussian_trimmer.views.view import MIN_SEEN_PIXELS, View, mask_overlap

_CONFIDENCE_WEIGHT = 0.32
"""Weight of the mask's mean logit in a region, which counts up to `_MAX_LOGIT`."""
_MAX_LOGIT = 10.0
_AGREEMENT_WEIGHT = 3.83
"""Weight of the share that the other views' masks give the region, beyond half."""
_ADDING_WEIGHT = 0.39
"""Gain of regions that the mask adds and loss of those that it removes."""
_MIN_SUPPORT = 0.84
"""Smallest sum of these from which on a mask is followed: even odds lie at 0.34."""
_TILE_PIXELS = 32
"""Side of the tiles, in pixels of a view of 512, that regions are cut into: a mask may be right at one end of a long
seam and wrong at the other."""
_REFERENCE_SIDE = 512
_MIN_WIDTH_CELLS = 3.0
"""Width, in cells of the grid that masks are drawn on, below which they do not show things."""
_MASK_GRID_CELLS = 256
"""Cells on the longer side of that grid, of all models of the SAM family."""
_MIN_OVERLAP = 0.5
"""Smallest intersection over union with the silhouette from which on a mask is taken for one of the object."""


def fuse_with_silhouettes(
    views: Sequence[View],
    logits: Sequence[FloatArray],
    gaussians: Gaussians,
) -> list[BoolArray]:
    """Return silhouettes of labels, changed where the masks of a model are better supported.

    Args:
        views: V views.
        logits: masks by the model, above zero on the object, (H, W) each.
        gaussians: what the views show, N Gaussians.

    Returns:
        masks (H, W), one for each view; those of the model that show something else are set aside.
    """
    silhouettes = [view.silhouette for view in views]
    masks = [logit > 0 for logit in logits]
    trusted = [mask_overlap(m, s) >= _MIN_OVERLAP for m, s in zip(masks, silhouettes, strict=True)]
    elsewhere = _shares_elsewhere(views, masks, trusted, gaussians)
    fused = []
    for number, silhouette in enumerate(silhouettes):
        if trusted[number]:
            follow = _supported(silhouette, logits[number], elsewhere[number])
            fused.append(np.where(follow, masks[number], silhouette))
        else:
            fused.append(silhouette.copy())
    return fused


def _supported(silhouette: BoolArray, logits: FloatArray, elsewhere: FloatArray) -> BoolArray:
    """Return pixels at which mask and silhouette differ and the mask is to be followed, (H, W)."""
    mask = logits > 0
    regions, count = _regions(silhouette, mask)
    member = regions > 0
    sizes = np.maximum(np.bincount(regions[member], minlength=count + 1), 1)

    def mean(values: FloatArray) -> Float64Array:
        return np.asarray(np.bincount(regions[member], values[member], count + 1) / sizes)

    sign = np.sign(mean(np.where(mask, 1.0, -1.0).astype(np.float32)))
    confidence = mean(np.abs(np.clip(logits, -_MAX_LOGIT, _MAX_LOGIT)))
    agreement = sign * (mean(elsewhere) - 0.5)
    support = _CONFIDENCE_WEIGHT * confidence + _AGREEMENT_WEIGHT * agreement + _ADDING_WEIGHT * sign
    return np.asarray(member & (support > _MIN_SUPPORT)[regions])


def _regions(silhouette: BoolArray, mask: BoolArray) -> tuple[NDArray[np.int32], int]:
    """Number connected regions, from 1, that a mask adds or removes within each tile, (H, W); also return how many."""
    height, width = mask.shape
    tile = max(1, round(_TILE_PIXELS * max(height, width) / _REFERENCE_SIDE))
    regions, count = np.zeros(mask.shape, np.int32), 0
    for change in (mask & ~silhouette, silhouette & ~mask & ~_thin(silhouette)):
        for y in range(0, height, tile):
            for x in range(0, width, tile):
                part = change[y : y + tile, x : x + tile]
                if not part.any():
                    continue
                found, numbered = cv2.connectedComponents(part.astype(np.uint8), connectivity=8)
                regions[y : y + tile, x : x + tile] += np.where(part, numbered + count, 0).astype(np.int32)
                count += found - 1
    return regions, count


def _thin(silhouette: BoolArray) -> BoolArray:
    """Return what of a silhouette is too thin for a mask to show, (H, W)."""
    width = max(2, round(_MIN_WIDTH_CELLS * max(silhouette.shape) / _MASK_GRID_CELLS))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width))
    opened = cv2.morphologyEx(silhouette.astype(np.uint8), cv2.MORPH_OPEN, disc) > 0
    return np.asarray(silhouette & ~opened)


def _shares_elsewhere(
    views: Sequence[View], masks: Sequence[BoolArray], trusted: Sequence[bool], gaussians: Gaussians
) -> list[FloatArray]:
    """Return the share inside the masks of the other views of the Gaussians at each pixel, (H, W) for each view.

    Half for Gaussians that the other views do not show.
    """

    of_views = label_weights(gaussians, [view.camera for view in views], masks)
    weights = [of_view * np.float32(is_trusted) for of_view, is_trusted in zip(of_views, trusted, strict=True)]
    total = np.sum(weights, axis=0)

    def shown(view: View, own: FloatArray) -> FloatArray:
        share = share_inside(total - own, MIN_SEEN_PIXELS)
        return blend_values(gaussians, view.camera, share[:, None])[..., 0]

    return list(parallel_map(shown, views, weights))
