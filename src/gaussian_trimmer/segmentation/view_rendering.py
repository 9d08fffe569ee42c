"""The pictures to segment: two renderings for each view, the object in its surroundings and the object in isolation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.rendering import Renderer, Rendering
from gaussian_trimmer.views import HALF, View, bounding_box

_REFERENCE_PIXELS = 5 * 512 * 512
"""Pixels of the default views: thresholds on visible weight hold for these, whatever views there are."""


def visible_weight(weights: Sequence[FloatArray], cameras: Sequence[Camera]) -> FloatArray:
    """Blend weight of each Gaussian over all views, in pixels of five views of 512 x 512, (N,).

    Args:
        weights: blend weights in each view, in pixels of that view, (N,) each.
        cameras: the cameras of the views.
    """
    pixels = sum(camera.height * camera.width for camera in cameras)
    return np.asarray(np.sum(weights, axis=0) * np.float32(_REFERENCE_PIXELS / pixels))


def complete_views(
    pictures: Sequence[Rendering], local: Gaussians, coarse: BoolArray, probability: FloatArray,
    cameras: Sequence[Camera], renderer: Renderer,
) -> list[View]:  # fmt: skip
    """What the segmenter is given for each camera.

    Args:
        pictures: what the cameras see.
        local: the coarse object and the Gaussians around it, N of them.
        coarse: which of them are the coarse object, (N,).
        probability: their corrected labels, (N,).
        cameras: the cameras of the views.
        renderer: draws labels and isolated object.
    """
    isolated = local.select(coarse)
    shares = np.stack([coarse.astype(np.float32), probability], axis=1)
    views = []
    for camera, picture in zip(cameras, pictures, strict=True):
        shown = renderer.blend_values(local, camera, shares)
        object_alpha = renderer.blend_values(isolated, camera, np.ones((len(isolated), 1), np.float32))[..., 0]
        visible, prior = np.ascontiguousarray(shown[..., 0]), np.ascontiguousarray(shown[..., 1])
        views.append(View(camera, picture, object_alpha, visible, prior, bounding_box(object_alpha > HALF)))
    return views
