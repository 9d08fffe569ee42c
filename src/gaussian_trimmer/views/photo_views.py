"""Training cameras whose photographs show an object best, each cropped to it, as views in place of virtual ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.rendering import blend_values, render

_MIN_INSIDE = 0.9
"""Smallest share of the object's outline, in area, that a photograph must hold, if some photograph holds so much."""
_MAX_ENLARGEMENT = 4.0
"""Largest factor by which a photograph's pixels are enlarged."""
_SIZE_WEIGHT = 0.5
"""Exponent of an object's size in a photograph beside the angle between viewing directions."""
_SMALL_PIXELS = 128
"""Width and height of the renderings that tell how much of the object a photograph shows."""


def photo_views(
    cameras: Sequence[Camera],
    bounds: Bounds,
    number: int,
    size: int = 512,
    fill: float = 0.75,
    visible_share: Callable[[Camera], float] = lambda camera: 1.0,
) -> list[Camera]:
    """Return up to `number` of the cameras that show an object large, unhidden and from different sides, cropped to it.

    Args:
        cameras: cameras whose photographs can be read.
        bounds: the object's.
        number: how many views are wanted.
        size: width and height of the crops in pixels.
        fill: share of the crop's width or height that the bounds fill.
        visible_share: how much of the object a crop shows that nothing hides, in [0, 1]; asked of few crops only.

    Returns:
        cameras of square crops, in the order of `cameras`; none if no camera has the object before it.
    """
    boxes = [_box(camera, bounds) for camera in cameras]
    inside = np.array([_share_inside(camera, box) for camera, box in zip(cameras, boxes, strict=True)])
    possible = np.flatnonzero(inside >= min(_MIN_INSIDE, 0.99 * inside.max(initial=0.0)))
    possible = possible[inside[possible] > 0]
    if not len(possible) or number < 1:
        return []
    extents = np.array([max(box[2:] - box[:2]) if box is not None else 0.0 for box in boxes])
    offsets = np.array([camera.centre for camera in cameras]) - bounds.centre
    directions = offsets / np.maximum(np.linalg.norm(offsets, axis=1, keepdims=True), 1e-12)
    visible, asked, chosen = np.ones(len(cameras)), np.zeros(len(cameras), np.bool_), list[int]()
    while len(chosen) < min(number, len(possible)):
        worth = extents * visible
        if chosen:
            angles = np.arccos(np.clip(directions @ directions[chosen].T, -1, 1)).min(axis=1)
            worth = angles * extents**_SIZE_WEIGHT * visible
        open_ones = np.setdiff1d(possible, chosen)
        best = int(open_ones[np.argmax(worth[open_ones])])
        if asked[best]:
            chosen.append(best)
        else:  # its worth is not known yet, only what it is at most
            asked[best], visible[best] = True, visible_share(_cropped(cameras[best], boxes[best], size, fill))
    return [_cropped(cameras[i], boxes[i], size, fill) for i in sorted(chosen)]


def visible_share(scene: Gaussians, selection: BoolArray, camera: Camera) -> float:
    """Return how much of a selected object a camera sees that nothing hides, in [0, 1]; 0 if it sees nothing of it."""
    small = camera.resized(_SMALL_PIXELS / max(camera.width, camera.height))
    alone = float(render(scene.select(selection), small).alpha.sum())
    shown = float(blend_values(scene, small, selection.astype(np.float32)[:, None]).sum())
    return min(shown / alone, 1.0) if alone > 0 else 0.0


def _box(camera: Camera, bounds: Bounds) -> Float64Array | None:
    """Return the pixel box of the bounds' corners (4,), or None if one of them is behind the camera."""
    pixels, depths = camera.project(bounds.corners())
    if not (depths > camera.near).all():
        return None
    return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])


def _share_inside(camera: Camera, box: Float64Array | None) -> float:
    """Return the share of a pixel box that lies within a camera's picture; zero without a box."""
    if box is None:
        return 0.0
    clipped = np.clip(box.reshape(2, 2), 0, (camera.width, camera.height))
    return float(np.prod(clipped[1] - clipped[0]) / max(float(np.prod(box[2:] - box[:2])), 1e-12))


def _cropped(camera: Camera, box: Float64Array | None, size: int, fill: float) -> Camera:
    """Return the same camera on a square crop around a box, scaled to `size` pixels."""
    assert box is not None
    side = max(float(max(box[2:] - box[:2])) / fill, size / _MAX_ENLARGEMENT)
    corner = (box[:2] + box[2:]) / 2 - side / 2
    crop = np.array([[size / side, 0, -corner[0] * size / side], [0, size / side, -corner[1] * size / side], [0, 0, 1]])
    return replace(camera, K=crop @ camera.K, width=size, height=size)
