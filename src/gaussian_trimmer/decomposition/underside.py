"""What hangs below an object: Gaussians in the ground that show only once the object is alone.

The views that judge an object look down at it, and what lies in the ground below its foot is within its silhouette
there. From just above the ground it hangs out below: a dark smear, grey spikes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import SH_C0, BoolArray, FloatArray, Gaussians
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.support_plane import SupportPlane
from gaussian_trimmer.rendering import Renderer, over_views
from gaussian_trimmer.views import HALF

_MAX_ROUNDS = 3
"""What hangs below may hide more of its kind."""
_REACH_DEVIATIONS = 2.0
"""Standard deviations that a Gaussian is taken to reach down."""
_DEEP_THICKNESSES = 2.0
"""Depth below the middle of the plane, relative to half of its thickness, from which on that is deep."""
_MAX_REACHING_SHARE = 0.1
"""Share of an object's Gaussians that may reach into the ground; where more do, the object does not stand on it."""
_MIN_SHOWN_PIXELS = 2e-4
"""Mean blend weight in the views, in pixels, below which nothing is noticed."""


def reaching_into_ground(gaussians: Gaussians, keep: BoolArray, bounds: Bounds, plane: SupportPlane) -> BoolArray:
    """Which Gaussians of an object (N,) reach deep below the plane that it stands on, (N,); none if it stands in it."""
    up, part = bounds.axes[2], gaussians.select(keep)
    deviations = np.sqrt(np.einsum("i,nij,j->n", up, part.covariances(), up))
    lowest = (part.means - bounds.centre) @ up - _REACH_DEVIATIONS * deviations
    deep = lowest < (plane.height - _DEEP_THICKNESSES * plane.thickness) * bounds.radius
    reaching = keep.copy()
    reaching[keep] = deep & (np.count_nonzero(deep) <= _MAX_REACHING_SHARE * len(deep))
    return reaching


def find_underside(
    gaussians: Gaussians, keep: BoolArray, in_ground: BoolArray, cameras: Sequence[Camera], renderer: Renderer
) -> BoolArray:
    """Which Gaussians of an object are in the ground and show mostly below the object once it is alone, (N,).

    What the scene shows of a Gaussian beside the object is not counted against it, as in `evidence.find_halo`; and what
    shows more of the object, alone or in the scene, than hangs out of it stays.

    Args:
        gaussians: the object and the Gaussians around it, N of them.
        keep: which of them are the object, (N,).
        in_ground: which of the object's reach deep into the ground, (N,).
        cameras: views from just above the ground.
        renderer: draws the scene, and the object by itself.
    """
    hanging = np.zeros(len(keep), np.bool_)
    if not in_ground.any() or not (keep & ~in_ground).any():
        return hanging
    labelled = _coloured(gaussians, keep)
    drawn = over_views(renderer, lambda camera: renderer.render(labelled, camera), cameras)
    visible = [rendering.rgb[..., 0] > HALF for rendering in drawn]
    seen_outside, seen_inside = _weights(labelled, cameras, visible, renderer)
    for _ in range(_MAX_ROUNDS):
        rows = np.flatnonzero(keep & ~hanging)
        outside, inside = _weights(gaussians.select(rows), cameras, visible, renderer)
        uncovered = outside - seen_outside[rows]
        noticed = uncovered > _MIN_SHOWN_PIXELS * len(cameras)
        found = in_ground[rows] & noticed & (uncovered > np.maximum(inside, seen_inside[rows]))
        if not found.any():
            break
        hanging[rows[found]] = True
    return hanging


def _weights(
    part: Gaussians, cameras: Sequence[Camera], visible: Sequence[BoolArray], renderer: Renderer
) -> tuple[FloatArray, FloatArray]:
    """Blend weights outside and inside what is visible of the object, summed over the views, (N,) each."""

    def weighed(camera: Camera, mask: BoolArray) -> FloatArray:
        return renderer.blend_weights(part, camera, mask.astype(np.uint8), 2)

    outside, inside = np.sum(list(over_views(renderer, weighed, cameras, visible)), axis=0).T
    return outside, inside


def _coloured(gaussians: Gaussians, keep: BoolArray) -> Gaussians:
    """The Gaussians, white those of the object and black the others, so that a picture is the object's share."""
    colours = np.repeat(np.where(keep, 0.5, -0.5)[:, None] / SH_C0, 3, axis=1)
    return gaussians.replace(sh_dc=colours.astype(np.float32), sh_rest=np.zeros((len(keep), 3, 0), np.float32))
