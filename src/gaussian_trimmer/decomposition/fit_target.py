"""What an object rendered alone should show in a view: coverage of pixels, from 0 to 1, and the colours inside it.

A photograph's pixel belongs to the object, or it does not; only those on its outline are shared. Gaussians are softer
than that, and what they show near an outline is a guess that has to be sharpened. Two guesses are at hand, which err to
different sides: the share of the picture that the object's Gaussians have where the whole scene is rendered, S, is too
small where others shine through or lie before the object's edge; the opacity of the object rendered alone, A, is too
large where the scene hides what sticks out. So A is right where the scene shows at least half of it. Where it shows
less, the geometric mean of A and 2 S takes over, which is as large at a half and nothing where the scene shows nothing.
This is made twice as steep (docs/decisions/fitted-outlines.md), so that an outline grows sharp where it is.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.decomposition.fitting import Target
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.rendering.gradients import Drawing, draw_with
from gaussian_trimmer.views import HALF, OCCLUDER_DISTANCE

_SHARPENING_FACTOR = 2.0
"""Factor by which coverage is steeper at an outline than the Gaussians show it."""
_TRUSTED_SHARE = 0.5
"""Share of the object's opacity alone that the scene has to show for that opacity to be right."""
_HIDDEN_OPACITY_SHARE = 0.25
"""Share of the object's opacity below which it is hidden, and not only seen through something."""
_MIN_SHOWN_OPACITY = 0.02
"""Opacity from which on the object shows at a pixel."""


def coverage_target(alone: Drawing, everything: Gaussians, radius: float, mask: FloatArray | None = None) -> Target:
    """What the object alone should show in a view, with no weight where something nearer hides it.

    Args:
        alone: the object.
        everything: object and background; the object's Gaussians come first.
        radius: the object's radius in scene units.
        mask: known coverage of what is visible of the object, in place of the labels', (H, W).
    """
    opacity, n_object = alone.image[3], len(alone.gaussians)
    member = np.zeros((len(everything), 1), np.float32)
    member[:n_object] = 1
    # Where the object does not reach, only a mask can ask for something to be shown.
    together, (share,) = draw_with(everything, alone.camera, member, alone.reached if mask is None else None)
    coverage = mask
    if coverage is None:
        shown = np.minimum(opacity, np.sqrt(np.maximum(opacity * share, 0) / _TRUSTED_SHARE))
        coverage = np.clip(HALF + _SHARPENING_FACTOR * (shown - HALF), 0, 1)
    scene_depth, object_depth = together.depth, alone.depth
    hidden = (
        (scene_depth > 0) & (scene_depth < object_depth - OCCLUDER_DISTANCE * radius) & (opacity > _MIN_SHOWN_OPACITY)
    )
    if mask is None:
        hidden &= share < _HIDDEN_OPACITY_SHARE * opacity  # Else it is an outline at which something shines through.
    picture = np.concatenate([np.clip(together.image[:3], 0, 1) * coverage, coverage[None]]).astype(np.float32)
    counts = np.where(hidden, np.float32(0), np.float32(1))
    # The three channels of colour count as much together as coverage does.
    return Target(alone.camera, picture, np.stack([counts / 3, counts / 3, counts / 3, counts]).astype(np.float32))


def resized_mask(mask: BoolArray, camera: Camera) -> FloatArray:
    """Coverage of the pixels of a camera's smaller image by a mask, in [0, 1], (H, W)."""
    size = camera.width, camera.height
    return np.asarray(cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA), np.float32)


def thin_share(drawings: Sequence[Drawing]) -> float:
    """Share of what an object covers in some views that is less than three pixels wide: leaves, wires, spokes."""
    covered, thick, square = 0, 0, np.ones((3, 3), np.uint8)
    for drawing in drawings:
        mask = (drawing.image[3] > HALF).astype(np.uint8)
        covered += int(mask.sum())
        thick += int(cv2.morphologyEx(mask, cv2.MORPH_OPEN, square).sum())
    return 1 - thick / covered if covered else 0.0
