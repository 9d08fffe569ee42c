"""What of a trim deserves a second look: the object's Gaussians that no accepted view shows."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.config import CONTEXT_RADIUS
from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.result import TrimResult
from gaussian_trimmer.segmentation.view_rendering import visible_weight

_VISIBLE_WEIGHT = 0.5
"""Blend weight, in pixels of the default views, from which on the trim counts a Gaussian as seen."""


def find_unchecked(result: TrimResult) -> BoolArray:
    """Which Gaussians of the scene belong to the trimmed object and are shown by no accepted view, (N,).

    Those are the inside, the underside, and sides on which no view was accepted. None where nothing was trimmed.
    """
    cameras = [view.view.camera for view in result.views if not view.rejected]
    if not cameras or not len(result.object):
        return result.object_mask
    near = np.linalg.norm(result.scene.means - result.bounds.centre.astype(np.float32), axis=1)
    rows = np.flatnonzero((near < CONTEXT_RADIUS * result.bounds.radius) | result.object_mask)
    local = result.scene.select(rows)
    weights = [
        result.used_renderer.blend_weights(local, camera, np.zeros((camera.height, camera.width), np.uint8), 1)[:, 0]
        for camera in cameras
    ]
    unchecked = result.object_mask.copy()
    unchecked[rows[visible_weight(weights, cameras) >= _VISIBLE_WEIGHT]] = False
    return unchecked
