"""What of a trim deserves a second look: Gaussians across the boundary, and Gaussians that no accepted view shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.config import CONTEXT_RADIUS
from gaussian_trimmer.decomposition.straddlers import find_straddlers
from gaussian_trimmer.gaussians import BoolArray, IntArray
from gaussian_trimmer.result import TrimResult
from gaussian_trimmer.segmentation.view_rendering import visible_weight
from gaussian_trimmer.views import TrimmedView

_SEEN = 0.5
"""Blend weight in pixels of the default views from which on a Gaussian counts as seen, as for the trim."""


@dataclass(frozen=True, eq=False)
class Highlights:
    """Gaussians of the scene that belong to a trimmed object, N of the scene."""

    straddlers: BoolArray
    """Those that show on both sides of the outline in an accepted view, (N,)."""
    unchecked: BoolArray
    """Those that no accepted view shows, (N,)."""


def find_highlights(result: TrimResult) -> Highlights:
    """Straddlers and unchecked Gaussians of a trimmed object; none where nothing was trimmed."""
    n, accepted = len(result.scene), [view for view in result.views if not view.rejected]
    straddlers, unchecked = np.zeros(n, np.bool_), result.object_mask
    if accepted and len(result.object):
        straddlers[_straddlers(result, accepted)] = True
        unchecked = unchecked & ~_seen(result, accepted)
    return Highlights(straddlers, unchecked)


def _straddlers(result: TrimResult, accepted: list[TrimmedView]) -> IntArray:
    """Scene rows of the object's Gaussians across the outlines of the masks."""
    renderer = result.used_renderer
    weights = [
        renderer.blend_weights(result.object, view.view.camera, view.mask.astype(np.uint8), 2) for view in accepted
    ]
    found = find_straddlers(result.object, accepted, weights, renderer, result.config.boundary)
    return np.asarray(result.source_index[found.rows])


def _seen(result: TrimResult, accepted: list[TrimmedView]) -> BoolArray:
    """Which Gaussians of the scene the accepted views show, (N,), where the object's surroundings hide what they do."""
    near = np.linalg.norm(result.scene.means - result.bounds.centre.astype(np.float32), axis=1)
    rows = np.flatnonzero((near < CONTEXT_RADIUS * result.bounds.radius) | result.object_mask)
    local = result.scene.select(rows)
    cameras = [view.view.camera for view in accepted]
    weights = [
        result.used_renderer.blend_weights(local, camera, np.zeros((camera.height, camera.width), np.uint8), 1)[:, 0]
        for camera in cameras
    ]
    seen = np.zeros(len(result.scene), np.bool_)
    seen[rows[visible_weight(weights, cameras) >= _SEEN]] = True
    return seen
