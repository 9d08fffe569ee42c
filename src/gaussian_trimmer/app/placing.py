"""Gaussians moved to where other programs want them: standing on the origin, y up. M Gaussians."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.gaussians import Float64Array, Gaussians
from gaussian_trimmer.geometry.bounds import up_frame
from gaussian_trimmer.output.engines import turned

_Z_UP_TO_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
_FOOT_QUANTILE = 0.01
"""Share of the Gaussians that may lie below the foot: those that stick out of it."""


def stood_upright(gaussians: Gaussians, up: Float64Array) -> Gaussians:
    """The Gaussians with their foot at the origin and y up, as large as they were."""
    turn = _Z_UP_TO_Y_UP @ up_frame(up)
    upright = turned(gaussians, turn)
    foot = np.median(upright.means, axis=0)
    foot[1] = np.quantile(upright.means[:, 1], _FOOT_QUANTILE)
    return upright.replace(means=upright.means - foot)
