"""The pictures to segment: two renderings for each view, the object in its surroundings and the object in isolation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.rendering import Renderer, Rendering
from gaussian_trimmer.views import HALF, View, bounding_box, to_reference

OCCLUDER_DISTANCE = 0.1
"""Distance in front of the object, in object radii, from which on something hides the object instead of touching it."""


def visible_weight(weights: Sequence[FloatArray], cameras: Sequence[Camera]) -> FloatArray:
    """Blend weight of each Gaussian over all views, in pixels of five views of 512 x 512, (N,).

    Args:
        weights: blend weights in each view, in pixels of that view, (N,) each.
        cameras: the cameras of the views.
    """
    return to_reference(np.sum(weights, axis=0), cameras)


def complete_views(
    pictures: Sequence[Rendering], isolated: Sequence[Rendering], local: Gaussians, coarse: BoolArray,
    probability: FloatArray, cameras: Sequence[Camera], radius: float, renderer: Renderer,
) -> list[View]:  # fmt: skip
    """What the segmenter is given for each camera.

    Args:
        pictures: what the cameras see.
        isolated: what they see of the coarse object in isolation.
        local: the coarse object and the Gaussians around it, N of them.
        coarse: which of them are the coarse object, (N,).
        probability: their corrected labels, (N,).
        cameras: the cameras of the views.
        radius: the object's radius.
        renderer: draws the labels.
    """
    shares = np.stack([coarse.astype(np.float32), probability], axis=1)
    views = []
    for camera, picture, alone in zip(cameras, pictures, isolated, strict=True):
        shown = renderer.blend_values(local, camera, shares)
        visible, prior = np.ascontiguousarray(shown[..., 0]), np.ascontiguousarray(shown[..., 1])
        whole = alone.alpha > HALF
        nearer = (picture.depth > 0) & (picture.depth < alone.depth - OCCLUDER_DISTANCE * radius)
        hidden = whole & (visible <= HALF) & nearer
        views.append(View(camera, picture, alone.alpha, visible, prior, bounding_box(whole), hidden))
    return views
