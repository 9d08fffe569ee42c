"""Hidden Gaussians that cross the support plane, where the object and what it stands on touch.

Where no camera looks, training leaves large Gaussians, and below an object some reach from under the table up into it.
Such a Gaussian is wrong on either side if it stays whole: in the object it hangs down below the foot, and in the
background it rises from the table like a ghost. The scene does not show it, so it can be cut at the support plane
without a trace.
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
from gaussian_trimmer.geometry.support_plane import SupportPlane
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.settings import Range, Share
from gaussian_trimmer.views import TrimmedView

_SCALE = 0.5
"""Resolution of the renderings that are made here, relative to that of the views."""
_CROSSING = 2.5
"""Number of standard deviations within which a Gaussian reaches the plane."""
_RISING = 2.0
"""Number of standard deviations by which a Gaussian must rise above the plane's layer, not to be a part of it."""


@dataclass(frozen=True)
class SupportPlaneSplitConfig:
    """Which hidden Gaussians are split where they cross the support plane below the object."""

    enabled: bool = False
    """Split them, provided that Gaussians may join the object (`evidence.recover`); if off, they stay whole in the
    background."""
    min_area: Share = 4e-4
    """Smallest blend weight inside the masks when the background is rendered without the object, as a share of the
    views' pixels."""
    max_seen: Annotated[float, Range(0, 100)] = 0.1
    """Largest blend weight in the whole scene, relative to that in the background alone."""
    min_inside: Share = 0.9
    """Smallest share of the blend weight in the background alone that lies inside the masks."""
    max_halo: Annotated[float, Range(0, 100)] = 0.1
    """Largest blend weight of the upper part outside the masks when the object is rendered in isolation, relative to
    the blend weight inside the masks in the background alone."""


def split_at_support_plane(
    gaussians: Gaussians,
    keep: BoolArray,
    seen: FloatArray,
    plane: SupportPlane,
    bounds: Bounds,
    views: Sequence[TrimmedView],
    renderer: Renderer,
    config: SupportPlaneSplitConfig,
) -> tuple[IntArray, Gaussians, Gaussians]:
    """Split Gaussians of the background that show only when the object is gone, and then rise in its place.

    Args:
        gaussians: the object and the Gaussians around it.
        keep: which of them belong to the object so far, (N,).
        seen: blend weight in the views of the whole scene, (N,).
        plane: the plane that the object stands on.
        bounds: the object's bounds; their third axis is up.
        views: accepted views.
        renderer: renders background and object in isolation, at half the resolution.
        config: thresholds.

    Returns:
        Rows of the split Gaussians (S,), and their parts above and below the plane. Gaussians whose upper parts would
        show outside the masks when the object is rendered in isolation are not split.
    """
    outside = np.flatnonzero(~keep)
    background = gaussians.select(outside)
    heights, spreads = _heights(background, plane, bounds)
    crossing = (np.abs(heights) < _CROSSING * spreads) & (heights + _RISING * spreads > plane.thickness)
    small = [_smaller(view) for view in views]
    if crossing.any():
        ghost = _weights(background, small, renderer)
        crossing &= ghost[:, 1] >= config.min_area * sum(view.mask.size for view in views)
        crossing &= seen[outside] <= config.max_seen * ghost[:, 1]
        crossing &= ghost[:, 1] >= config.min_inside * ghost.sum(axis=1)
    rows = outside[crossing]
    normals = np.tile(bounds.axes[2], (len(rows), 1))
    upper, lower = split_plane(gaussians.select(rows), normals, heights[crossing] / spreads[crossing])
    if len(rows) == 0:
        return rows, upper, lower
    halo = _weights(concatenate([gaussians.select(keep), upper]), small, renderer)[-len(rows) :, 0]
    clean = halo <= config.max_halo * ghost[crossing, 1]
    return rows[clean], upper.select(clean), lower.select(clean)


def _heights(gaussians: Gaussians, plane: SupportPlane, bounds: Bounds) -> tuple[Float64Array, Float64Array]:
    """Height of the centres above the plane and standard deviation along up, in object radii, (N,) each.

    The standard deviation is zero where the Gaussian is too far from the plane to reach it.
    """
    up = bounds.axes[2]
    heights = (gaussians.means - bounds.centre) @ up / bounds.radius - plane.height
    near = np.flatnonzero(np.abs(heights) < _CROSSING * np.exp(gaussians.log_scales.max(axis=1)) / bounds.radius)
    spreads = np.zeros_like(heights)
    spreads[near] = np.sqrt(np.einsum("i,nij,j->n", up, gaussians.select(near).covariances(), up)) / bounds.radius
    return heights, spreads


def _smaller(view: TrimmedView) -> tuple[Camera, NDArray[np.uint8]]:
    """Camera and mask of a view at reduced resolution."""
    camera = view.view.camera.resized(_SCALE)
    labels = cv2.resize(view.mask.astype(np.uint8), (camera.width, camera.height), interpolation=cv2.INTER_NEAREST)
    return camera, np.asarray(labels, np.uint8)


def _weights(gaussians: Gaussians, views: Sequence[tuple[Camera, NDArray[np.uint8]]], renderer: Renderer) -> FloatArray:
    """Blend weight outside and inside the masks over all views, in pixels of the full resolution, (N, 2)."""
    total = np.zeros((len(gaussians), 2), np.float32)
    for camera, labels in views:
        total += renderer.blend_weights(gaussians, camera, labels, 2)
    return total / np.float32(_SCALE**2)
