"""The found objects on a plan: the scene from above, what is sure in colour and with its number."""

from __future__ import annotations

import colorsys

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera, look_at, up_frame
from gaussian_trimmer.finding.found import FoundObjects
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.output.pictures import Picture, as_picture, draw_number
from gaussian_trimmer.rendering import blend_values, render
from gaussian_trimmer.views.camera_rings import NEAR_RADII

_LONGER_PIXELS = 1400
_FONT_SCALE, _SMALL_FONT_SCALE, _MANY = 0.6, 0.3, 100
"""Size of the numbers, and that of so many or more."""
_DISTANCE = 4.0
"""Distance of the camera, relative to the longer side of the plan: far enough that little of any side shows."""
_MARGIN = 0.05
"""Border around the outermost objects, relative to the longer side."""
_DIMMED, _TINT = 0.7, 0.45
"""Brightness of what is not an object, and share of an object's colour on the plan that is not its own."""
_TURN = 0.618034
"""Of the colour circle, from one object to the next: colours of neighbours in the list are far apart."""


def draw_plan(found: FoundObjects) -> Picture:
    """Return the scene from above, without what was not looked at, with the objects and their numbers.

    The sure objects are in colour; if there are none, all are.
    """
    shown = [one for one in found if one.sure] or list(found)
    camera = _camera_above(found, np.array([one.centre for one in shown]), np.array([one.size for one in shown]))
    scene, labels = found.scene.select(found.looked_at), found.labels[found.looked_at]
    tints = np.zeros((len(found) + 1, 4), np.float32)
    for one in shown:
        tints[one.id] = *colorsys.hsv_to_rgb(_TURN * one.id % 1, 0.9, 1), 1
    blended = blend_values(scene, camera, tints[labels])
    share = np.clip(blended[..., 3:], 0, 1)
    rgb = render(scene, camera).rgb * (_DIMMED + (1 - _DIMMED - _TINT) * share) + _TINT * blended[..., :3]
    picture = np.ascontiguousarray(as_picture(rgb))
    scale = _FONT_SCALE if len(shown) < _MANY else _SMALL_FONT_SCALE
    for one, (x, y) in zip(shown, camera.project(np.array([one.centre for one in shown]))[0], strict=True):
        (width, height), _ = cv2.getTextSize(str(one.id), cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
        draw_number(picture, one.id, (round(x) - width // 2, round(y) + height // 2), scale)
    return picture


def _camera_above(found: FoundObjects, centres: Float64Array, sizes: Float64Array) -> Camera:
    """Return a camera that looks down on boxes, by their middles and sizes along the axes of the frame, (O, 3) each."""
    axes = up_frame(found.up.direction)
    local = centres @ axes.T
    low, high = (local - sizes / 2).min(axis=0), (local + sizes / 2).max(axis=0)
    sides = (high - low)[:2] + 2 * _MARGIN * float((high - low)[:2].max())
    longer, upwards = float(sides.max()), int(sides[1] <= sides[0])  # the picture is wide
    width, height = _LONGER_PIXELS, max(1, round(_LONGER_PIXELS * float(sides.min()) / longer))
    middle = np.array([*(low + high)[:2] / 2, high[2]]) @ axes
    focal = _DISTANCE * _LONGER_PIXELS
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    pose = look_at(middle + _DISTANCE * longer * axes[2], middle, axes[upwards])
    return Camera(pose, K, width, height, near=NEAR_RADII * longer)
