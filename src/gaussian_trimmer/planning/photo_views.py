"""Training cameras whose photographs show an object best, each cropped to it, as views in place of virtual ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.geometry.bounds import Bounds

_MIN_INSIDE = 0.9
"""Smallest share of the object's outline, in area, that a photograph must hold, if some photograph holds so much."""
_MAX_ENLARGEMENT = 4.0
"""Largest factor by which a photograph's pixels are enlarged."""
_SIZE_WEIGHT = 0.5
"""Exponent of an object's size in a photograph beside the angle between viewing directions."""


def photo_views(
    cameras: Sequence[Camera], bounds: Bounds, number: int, size: int = 512, fill: float = 0.75
) -> list[Camera]:
    """Up to `number` of the cameras that show an object large and from different sides, cropped to it.

    Args:
        cameras: cameras whose photographs can be read.
        bounds: the object's.
        number: how many views are wanted.
        size: width and height of the crops in pixels.
        fill: share of the crop's width or height that the bounds fill.

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
    chosen = [int(possible[np.argmax(extents[possible])])]
    while len(chosen) < min(number, len(possible)):
        angles = np.arccos(np.clip(directions[possible] @ directions[chosen].T, -1, 1)).min(axis=1)
        worth = angles * extents[possible] ** _SIZE_WEIGHT
        worth[np.isin(possible, chosen)] = -1
        chosen.append(int(possible[np.argmax(worth)]))
    return [_cropped(cameras[i], boxes[i], size, fill) for i in sorted(chosen)]


def _box(camera: Camera, bounds: Bounds) -> Float64Array | None:
    """Pixel box of the bounds' corners (4,), or None if one of them is behind the camera."""
    pixels, depths = camera.project(bounds.corners())
    if not (depths > camera.near).all():
        return None
    return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])


def _share_inside(camera: Camera, box: Float64Array | None) -> float:
    """Share of a pixel box that lies within a camera's picture; zero without a box."""
    if box is None:
        return 0.0
    clipped = np.clip(box.reshape(2, 2), 0, (camera.width, camera.height))
    return float(np.prod(clipped[1] - clipped[0]) / max(float(np.prod(box[2:] - box[:2])), 1e-12))


def _cropped(camera: Camera, box: Float64Array | None, size: int, fill: float) -> Camera:
    """The same camera on a square crop around a box, scaled to `size` pixels."""
    assert box is not None
    side = max(float(max(box[2:] - box[:2])) / fill, size / _MAX_ENLARGEMENT)
    corner = (box[:2] + box[2:]) / 2 - side / 2
    crop = np.array([[size / side, 0, -corner[0] * size / side], [0, size / side, -corner[1] * size / side], [0, 0, 1]])
    return replace(camera, K=crop @ camera.K, width=size, height=size)
