"""Views to click in, for scenes without cameras: from all around the part with most detail."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.planning.virtual_cameras import PlanConfig, plan_cameras

_MIDDLE_SHARE = 0.25
"""Share of the Gaussians nearest to the middle that the views frame."""
_WHOLE_SHARE = 0.95
"""Share of the Gaussians whose distance tells whether a capture is compact."""
_COMPACT = 3.2
"""A capture is compact, as of a single object, if it has the latter share within this many radii of the former."""
_REACH = 3.0
"""Gaussians farther from the middle than this many radii of what is framed are left out: walls would hide the rest."""
_ROUNDS = 5
_SIZE = 640
_MIDDLE_FILL, _WHOLE_FILL = 0.6, 0.9


@dataclass(frozen=True, eq=False)
class Overview:
    """Views around the middle of a scene, and which Gaussians they show."""

    cameras: list[Camera]
    rows: IntArray
    """Rows of the Gaussians that are drawn, (L,); the others may be in front of them."""


def plan_overview(gaussians: Gaussians, up: Float64Array, views: int = 8) -> Overview:
    """Views on a circle around the middle of a scene, 30 degrees above the horizon.

    Training makes many small Gaussians where there is detail and few large ones elsewhere, so the middle is where the
    centres are densest, found by repeated medians of the nearest ones. A compact capture, as of a single object, is
    framed as a whole.

    Args:
        up: the scene's up vector, (3,).
        views: their number.
    """
    distance = _distance_from_middle(gaussians.means)
    middle, whole = np.quantile(distance, [_MIDDLE_SHARE, _WHOLE_SHARE])
    compact = whole < _COMPACT * middle
    framed = gaussians if compact else gaussians.select(distance <= middle)
    fill = _WHOLE_FILL if compact else _MIDDLE_FILL
    cameras, _ = plan_cameras(framed, up, PlanConfig(views=views, size=_SIZE, pitch_degrees=30.0, fill=fill))
    return Overview(cameras, np.flatnonzero(distance <= _REACH * (whole if compact else middle)))


def _distance_from_middle(means: FloatArray) -> FloatArray:
    """Distance of every centre (N, 3) from where they lie densest, (N,)."""
    middle = np.median(means, axis=0)
    for _ in range(_ROUNDS):
        distance = np.linalg.norm(means - middle, axis=1)
        middle = np.median(means[distance <= np.quantile(distance, _MIDDLE_SHARE)], axis=0)
    return np.asarray(np.linalg.norm(means - middle, axis=1))
