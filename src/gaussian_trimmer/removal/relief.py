"""Continue a support with relief, such as gravel or grass, by copies of its own Gaussians.

The mean of several shifts shows boards and checks, but of what never repeats it is a blur, and flat. Only a whole piece
of gravel looks like gravel. So where the filled picture has lost the grain of a surface that looks alike everywhere,
what lies a shift away is copied, stones and all.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, concatenate
from gaussian_trimmer.removal.shift_map import (
    MAX_ROUNDS,
    RING_PIXELS,
    best_shifts,
    of_usual_colour,
    shifted,
    without_shadow,
)
from gaussian_trimmer.removal.surface_picture import PIXELS_A_RADIUS, SurfacePicture
from gaussian_trimmer.removal.views import Surface
from gaussian_trimmer.views.view import box_slices, grown

_GRAIN_PIXELS = 12.0
"""Standard deviation of the blur that parts coarse structure from grain."""
_LEAST_GRAIN = 0.02
"""Standard deviation of colours of a grain that can be seen."""
_KEPT_GRAIN = 0.5
"""Contrast of the filled hole's grain, relative to that around it, below which it is lost."""
_MAX_COARSE_SHARE = 0.55
"""Largest contrast of coarse structure, relative to that of the grain, of what looks alike everywhere."""
_LAYER_RADII = 0.3
"""Height above and below the surface up to which Gaussians may be its relief, in object radii."""
_LAYER_QUANTILES = (0.02, 0.98)
"""Of their heights around the hole: single ones do not count."""
_SINK_RADII = 0.02
"""Depth of copies below what they are of: level with it they would hide the object's foot."""

Patch = tuple[tuple[int, int], BoolArray]
"""A shift down and right, and the pixels (H, W) that are filled with what lies so much farther."""


def copy_relief(
    gaussians: Gaussians,
    seen: BoolArray,
    picture: SurfacePicture,
    surfaces: Sequence[Surface],
    hole: BoolArray,
    filled: FloatArray,
    relight: FloatArray,
) -> tuple[Gaussians, float, float] | None:
    """Return copies that fill a hole with the surface's relief, and between which heights, in object radii, it lies.

    None if the filled picture does as well.

    Args:
        gaussians: what is around the object, N.
        seen: those of them that can be copied, (N,).
        picture: the surface from above, P x P pixels.
        surfaces: all surfaces; each ends where another begins.
        hole, filled, relight: the hole, and the picture and factors that `inpaint_shift_map` returned, (P, P, ...).
    """
    (rows, columns), inside = picture.pixels_of(gaussians.means)
    height = picture.surface.heights(gaussians.means)
    layer = seen & inside & picture.known[rows, columns] & (np.abs(height) < _LAYER_RADII)
    for other in surfaces:
        layer &= np.abs(other.heights(gaussians.means)) >= np.abs(height)
    around = layer & (grown(hole, RING_PIXELS) & ~hole)[rows, columns]
    patches = patches_with_grain(picture.rgb, picture.known, hole, filled, relight) if around.any() else []
    if not patches:
        return None
    low, high = (float(edge) for edge in np.quantile(height[around], _LAYER_QUANTILES))
    layer &= (height > low) & (height < high)
    copies, size = [], len(hole)
    for shift, patch in patches:
        padded = np.pad(patch, size)
        chosen = layer & padded[rows - shift[0] + size, columns - shift[1] + size]
        taken, step = (
            gaussians.select(chosen),
            np.array([*(np.array(shift) / PIXELS_A_RADIUS), _SINK_RADII]) @ picture.surface.axes * picture.surface.unit,
        )
        copies.append(taken.replace(means=(taken.means - step).astype(np.float32)))
    return concatenate(copies), low, high


def patches_with_grain(
    rgb: FloatArray, known: BoolArray, hole: BoolArray, filled: FloatArray, relight: FloatArray
) -> list[Patch]:
    """Return patches that fill a hole, the later ones where the earlier do not reach; none if the grain is not lost.

    Args:
        rgb, known, hole: as `inpaint_shift_map` has them.
        filled, relight: what it returns.
    """
    lit, examples = without_shadow(rgb, known, hole, relight)
    around = examples & grown(hole, 2 * RING_PIXELS)
    if not (around.any() and hole.any()):
        return []
    examples &= of_usual_colour(lit, around)
    coarse, fine = _contrasts(lit, examples & around)
    if fine < _LEAST_GRAIN or coarse > _MAX_COARSE_SHARE * fine or _contrasts(filled, hole)[1] > _KEPT_GRAIN * fine:
        return []
    everywhere, left, patches = box_slices((0, 0, *hole.shape[::-1])), hole.copy(), list[Patch]()
    for _ in range(MAX_ROUNDS):
        ring = examples & grown(left, RING_PIXELS)
        shifts, differences = best_shifts(lit, examples, ring, left) if ring.any() else ([], [])
        if not shifts:
            break
        reached = [left & shifted(examples, *shift, everywhere) for shift in shifts]
        costs = [difference / (1 + part.sum()) ** 2 for difference, part in zip(differences, reached, strict=True)]
        best = int(np.argmin(costs))
        patches.append((shifts[best], reached[best]))
        left &= ~reached[best]
    return patches


def _contrasts(rgb: FloatArray, region: BoolArray) -> tuple[float, float]:
    """Return the standard deviation of the coarse and of the fine structure in a region (H, W) of a picture."""
    if not region.any():
        return 0.0, 0.0
    weight = region.astype(np.float32)[..., None]
    blurred = cv2.GaussianBlur(np.dstack([rgb * weight, weight]).astype(np.float32), (0, 0), _GRAIN_PIXELS)
    coarse = blurred[..., :3] / np.maximum(blurred[..., 3:], 1e-6)
    return float(coarse[region].std(axis=0).mean()), float((rgb - coarse)[region].std(axis=0).mean())
