"""Hidden Gaussians that cross the surface on which the object stands.

Where no camera looks, training leaves large Gaussians, and under an object some reach from below the table up into it.
Whole, such a one is wrong on either side: in the object it hangs down below the foot, in the background it stands up
from the table like a ghost. The scene does not show it, so it can be cut at the surface without a trace.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.decomposition.split_rules import split_plane
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.support_plane import Support
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.settings import Range, Share

_SCALE = 0.5
_CROSSING = 2.5
"""Standard deviations within which a Gaussian reaches the surface."""
_RISING = 2.0
"""Standard deviations by which a Gaussian must rise above the surface's layer, to be more than a part of it."""


@dataclass(frozen=True)
class ContactConfig:
    """Which hidden Gaussians are cut where they cross the supporting surface."""

    enabled: bool = False
    """Cut them, if Gaussians may join the object at all; off, they stay whole in the background."""
    least_area: Share = 4e-4
    """Smallest blend weight in place of the object when the background is alone, as a share of the views' pixels."""
    largest_seen: Annotated[float, Range(0, 100)] = 0.1
    """Largest blend weight in the whole scene, as a share of that in the background alone."""
    least_inside: Share = 0.9
    """Smallest share of the blend weight in the background alone that lies within the masks."""
    largest_halo: Annotated[float, Range(0, 100)] = 0.1
    """Largest blend weight of the upper part beside the masks, when the object is alone, as a share of the same."""


def cut_sunken(
    gaussians: Gaussians,
    keep: BoolArray,
    seen: FloatArray,
    support: Support,
    bounds: Bounds,
    cameras: Sequence[Camera],
    masks: Sequence[BoolArray],
    renderer: Renderer,
    config: ContactConfig,
) -> tuple[IntArray, Gaussians, Gaussians]:
    """Gaussians of the background that only show when the object is gone and rise from the surface in its place.

    Args:
        gaussians: the object and its neighbours.
        keep: which of them are the object so far, (N,).
        seen: blend weight in the views of the whole scene, (N,).
        support: the surface that the object stands on.
        bounds: the object's bounds; their third axis is up.
        cameras: accepted views.
        masks: their masks, (H, W) each.
        renderer: renders background and object alone, at half the resolution.
        config: thresholds.

    Returns:
        Their rows (S,), and their parts above and below the surface. Those whose upper parts would show beside the
        object, when that is alone, are not among them.
    """
    beside = np.flatnonzero(~keep)
    background = gaussians.select(beside)
    heights, spreads = _heights(background, support, bounds)
    sunken = (np.abs(heights) < _CROSSING * spreads) & (heights + _RISING * spreads > support.thickness)
    views = [_smaller(camera, mask) for camera, mask in zip(cameras, masks, strict=True)]
    if sunken.any():
        ghost = _weights(background, views, renderer)
        sunken &= ghost[:, 1] >= config.least_area * sum(mask.size for mask in masks)
        sunken &= seen[beside] <= config.largest_seen * ghost[:, 1]
        sunken &= ghost[:, 1] >= config.least_inside * ghost.sum(axis=1)
    rows = beside[sunken]
    normals = np.tile(bounds.axes[2], (len(rows), 1))
    upper, lower = split_plane(gaussians.select(rows), normals, heights[sunken] / spreads[sunken])
    if len(rows) == 0:
        return rows, upper, lower
    halo = _weights(concatenate([gaussians.select(keep), upper]), views, renderer)[-len(rows) :, 0]
    clean = halo <= config.largest_halo * ghost[sunken, 1]
    return rows[clean], upper.select(clean), lower.select(clean)


def _heights(gaussians: Gaussians, support: Support, bounds: Bounds) -> tuple[Float64Array, Float64Array]:
    """Height of the centres above the surface and standard deviation upwards, in object radii, (N,) each.

    The standard deviation is zero where the Gaussian is too far from the surface to reach it.
    """
    up = bounds.axes[2]
    heights = (gaussians.means - bounds.centre) @ up / bounds.radius - support.height
    near = np.flatnonzero(np.abs(heights) < _CROSSING * np.exp(gaussians.log_scales.max(axis=1)) / bounds.radius)
    spreads = np.zeros_like(heights)
    spreads[near] = np.sqrt(np.einsum("i,nij,j->n", up, gaussians.select(near).covariances(), up)) / bounds.radius
    return heights, spreads


def _smaller(camera: Camera, mask: BoolArray) -> tuple[Camera, NDArray[np.uint8]]:
    """A view and its mask at a part of the resolution."""
    small = camera.resized(_SCALE)
    labels = cv2.resize(mask.astype(np.uint8), (small.width, small.height), interpolation=cv2.INTER_NEAREST)
    return small, np.asarray(labels, np.uint8)


def _weights(gaussians: Gaussians, views: Sequence[tuple[Camera, NDArray[np.uint8]]], renderer: Renderer) -> FloatArray:
    """Blend weight outside and inside the masks over all views, in pixels of the full resolution, (N, 2)."""
    total = np.zeros((len(gaussians), 2), np.float32)
    for camera, labels in views:
        total += renderer.blend_weights(gaussians, camera, labels, 2)
    return total / np.float32(_SCALE**2)
