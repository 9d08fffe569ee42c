"""Where a cut-out is to be doubted: sides that were not checked, the softest edge, a hole that is not filled."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.output.report import checked_sides, middle_degree, why_unchecked
from gaussian_trimmer.rendering import render
from gaussian_trimmer.trimming.result import TrimResult

_SOFT = (0.05, 0.5)
"""Alpha of pixels that are the object's and hardly show it."""
_RISE = 0.3
"""How high a side is looked at from, relative to the distance."""


def doubts(result: TrimResult) -> list[tuple[str, Float64Array]]:
    """Return what there is to doubt of a single object, in words, and the direction (3,) from the object to see it."""
    part = result.objects[0]
    found = [(view, view.view.camera.centre - part.bounds.centre) for view in part.views]
    said = [(f"From here it could not be checked: {view.rejected}.", away) for view, away in found if view.rejected]
    checked, observed = checked_sides(part, result.cameras)
    if why := why_unchecked(unseen := middle_degree(~checked), checked, observed):
        yaw = np.radians(unseen)
        away = np.array([np.cos(yaw), np.sin(yaw), _RISE]) @ part.bounds.axes
        said.append((f"The side seen least: {why}.", away))
    alphas = [render(part.gaussians, view.view.camera).alpha for view, _ in found]
    if alphas:
        soft = [((alpha > _SOFT[0]) & (alpha < _SOFT[1])).mean() for alpha in alphas]
        said.append(("The softest edge is seen from here.", found[int(np.argmax(soft))][1]))
    if part.not_filled:
        said.append((f"The hole is not filled: {part.not_filled}.", part.up.direction + _RISE * part.bounds.axes[0]))
    return said
