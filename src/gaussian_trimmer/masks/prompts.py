"""What a promptable model is told about the object in a view: box, points inside and outside, expected silhouette."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray
from gaussian_trimmer.geometry.distances import distance_to_outside
from gaussian_trimmer.views.view import Box

BACKGROUND, FOREGROUND = 0, 1
BOX_CORNERS = (2, 3)
"""Point labels by which models of the SAM family know background, object, and a box's two corners."""
MASK_LOGITS = (20.0, -10.0)
"""Scale and offset that turn a mask of zeros and ones into the logits that such a model takes as a prompt."""
IMAGENET = ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
"""Mean and standard deviation of the colours that these models were trained on."""


@dataclass(frozen=True, eq=False)
class Prompt:
    """What the model is told; each part may be missing. Coordinates are those of pixels' corners: centres at +0.5."""

    box: Box | None = None
    """Pixels (x0, y0, x1, y1) around the object; x1 and y1 are exclusive."""
    points: Float64Array = field(default_factory=lambda: np.zeros((0, 2)))
    """Points (P, 2)."""
    inside: BoolArray = field(default_factory=lambda: np.zeros(0, np.bool_))
    """Which points are on the object, (P,)."""
    logits: FloatArray | None = None
    """Where the object is expected: above zero on it, (H, W)."""

    def corners(self) -> Float64Array:
        """Return centres of the box's first and last pixel, (2, 2)."""
        assert self.box is not None
        x0, y0, x1, y1 = self.box
        return np.array([[x0 + 0.5, y0 + 0.5], [x1 - 0.5, y1 - 0.5]])


def middle_points(region: BoolArray, number: int) -> Float64Array:
    """Return up to `number` points (P, 2) deep inside a region (H, W) and far from each other, deepest first.

    >>> middle_points(np.ones((5, 7), bool), 1).tolist()
    [[2.5, 2.5]]
    """
    # The picture's frame counts as the region's edge, so that no point lies on it.
    depth = distance_to_outside(region, beyond=False)
    found: list[tuple[float, float]] = []
    rows, columns = np.indices(region.shape, np.float32)
    while len(found) < number and depth.max(initial=0) > 0:
        y, x = np.unravel_index(int(np.argmax(depth)), depth.shape)
        found.append((float(x) + 0.5, float(y) + 0.5))
        depth = np.minimum(depth, np.hypot(columns - x, rows - y) / 2)
    return np.array(found, np.float64).reshape(-1, 2)


def expected_logits(share: FloatArray) -> FloatArray:
    """Return the share of the picture that the object is expected to contribute (H, W) as logits of a prompt (H, W)."""
    scale, offset = MASK_LOGITS
    return np.asarray(np.clip(share, 0, 1) * np.float32(scale) + np.float32(offset))
