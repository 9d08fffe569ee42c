"""What an object rendered alone should show in a view: coverage of pixels, from 0 to 1, and the colours inside it.

A photograph's pixel belongs to the object, or it does not; only those on its outline are shared. Gaussians are softer
than that, so what they show is made twice as steep. Two pictures of the outline err to different sides. The opacity of
the object rendered alone, A, is too large where the scene hides what sticks out. Its share of the scene's picture,
S, is too small where others lie across the object's edge. Their weighted geometric mean stays close to A. Leaves and
wires have no inside to be steep towards, and keep their opacity. Where masks are known, they are what is covered.
"""

from __future__ import annotations

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.decomposition.fitting import Target
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.rendering.gradients import Drawing, draw_with
from gaussian_trimmer.views import HALF, OCCLUDER_DISTANCE

_SHARPENING = 2.0
"""Factor by which coverage is steeper at an outline than the Gaussians show it."""
_SCENE_EXPONENT = 0.25
"""Weight of the share in the scene's picture in the geometric mean; the rest is that of the opacity alone."""
_HIDDEN_SHARE = 0.25
"""Share of the object's opacity below which something nearer hides it, and does not only shine through."""
_MIN_SHOWN_OPACITY = 0.02
"""Opacity from which on the object shows at a pixel."""
_THIN = np.ones((7, 7), np.uint8)
"""What this square does not fit into, in pixels, is thin."""


def coverage_target(alone: Drawing, everything: Gaussians, radius: float, mask: FloatArray | None = None) -> Target:
    """What the object alone should show in a view, with no weight where something nearer hides it.

    Args:
        alone: the object.
        everything: object and background; the object's Gaussians come first.
        radius: the object's radius in scene units.
        mask: known coverage of what is visible of the object, (H, W).
    """
    opacity = alone.image[3]
    member = np.zeros((len(everything), 1), np.float32)
    member[: len(alone.gaussians)] = 1
    # Where the object does not reach, only a mask can ask for something to be shown.
    together, (share,) = draw_with(everything, alone.camera, member, alone.reached if mask is None else None)
    nearer = (together.depth > 0) & (together.depth < alone.depth - OCCLUDER_DISTANCE * radius)
    hidden = nearer & (opacity > _MIN_SHOWN_OPACITY)
    coverage = mask
    if coverage is None:
        coverage = sharpened(np.clip(opacity, 0, 1) ** (1 - _SCENE_EXPONENT) * np.clip(share, 0, 1) ** _SCENE_EXPONENT)
        hidden &= share < _HIDDEN_SHARE * opacity
    picture = np.concatenate([np.clip(together.image[:3], 0, 1) * coverage, coverage[None]]).astype(np.float32)
    # The three channels of colour count as much together as coverage does.
    counts = np.where(hidden, np.float32(0), np.float32(1))
    return Target(alone.camera, picture, np.stack([counts / 3, counts / 3, counts / 3, counts]).astype(np.float32))


def sharpened(opacity: FloatArray) -> FloatArray:
    """Opacity made twice as steep about one half, but where it is thin, (H, W)."""
    solid = (opacity > HALF).astype(np.uint8)
    thin = solid - cv2.morphologyEx(solid, cv2.MORPH_OPEN, _THIN)
    near_thin = cv2.dilate(thin, _THIN) > 0
    steep = np.clip(HALF + _SHARPENING * (opacity - HALF), 0, 1)
    return np.asarray(np.where(near_thin, opacity, steep), np.float32)


def resized_mask(mask: BoolArray, camera: Camera) -> FloatArray:
    """Coverage of the pixels of a camera's smaller image by a mask, in [0, 1], (H, W)."""
    size = camera.width, camera.height
    return np.asarray(cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA), np.float32)
