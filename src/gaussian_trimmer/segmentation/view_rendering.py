"""The pictures that are segmented: two renders a view, the object with its neighbours and the object alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.rendering import Renderer, Rendering
from gaussian_trimmer.views import Box, View

_REFERENCE_PIXELS = 5 * 512 * 512


def visible_weight(weights: Sequence[FloatArray], cameras: Sequence[Camera]) -> FloatArray:
    """Blend weight of each Gaussian over all views, in pixels of five views of 512 x 512, (N,).

    Args:
        weights: that of each view, in its own pixels, (N,) each.
        cameras: the views.
    """
    pixels = sum(camera.height * camera.width for camera in cameras)
    return np.asarray(np.sum(weights, axis=0) * np.float32(_REFERENCE_PIXELS / pixels))


def complete_views(
    pictures: Sequence[Rendering], local: Gaussians, coarse: BoolArray, probability: FloatArray,
    cameras: Sequence[Camera], renderer: Renderer,
) -> list[View]:  # fmt: skip
    """What the segmenter gets to see from each camera.

    Args:
        pictures: what the cameras see.
        local: the coarse object and its neighbours, (N,).
        coarse: which of them are the coarse object, (N,).
        probability: their corrected labels, (N,).
        cameras: the views.
        renderer: draws them.
    """
    isolated = local.select(coarse)
    shares = np.stack([coarse.astype(np.float32), probability], axis=1)
    views = []
    for camera, picture in zip(cameras, pictures, strict=True):
        shown = renderer.blend_values(local, camera, shares)
        object_alpha = renderer.blend_values(isolated, camera, np.ones((len(isolated), 1), np.float32))[..., 0]
        visible, object_prior = np.ascontiguousarray(shown[..., 0]), np.ascontiguousarray(shown[..., 1])
        views.append(View(camera, picture, object_alpha, visible, object_prior, bounding_box(object_alpha > 0.5)))
    return views


def bounding_box(mask: BoolArray) -> Box:
    """Bounding box of a mask (H, W), the prompt of eq. 6; the whole image if the mask is empty."""
    if not mask.any():
        return 0, 0, mask.shape[1], mask.shape[0]
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
