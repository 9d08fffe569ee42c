"""The directions from which an object was observed, for scenes without cameras.

Training keeps the space between the cameras and what they saw free; behind the object of a forward-facing capture the
scene is full of haze and the backs of other objects. So an object that is visible without obstruction from all around
was photographed from all around, and one that is visible from one side was photographed from the middle of that side.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians
from gaussian_trimmer.planning.virtual_cameras import PlanConfig, plan_cameras
from gaussian_trimmer.rendering import Renderer

_PROBES = 8
_PROBE_SIZE = 96
_FREE = 0.85
_BLOCKED = 0.75
_BLOCKED_SHARE = 0.25
_FACING_PITCH_DEGREES = 10.0


def limit_yaw_to_observed(
    local: Gaussians, selection: BoolArray, up: Float64Array, config: PlanConfig, renderer: Renderer
) -> PlanConfig:
    """The plan limited to the middle half of the directions from which the object is unobstructed, at a low pitch.

    The plan is returned unchanged if the object is unobstructed all around, or if it gives yaw or pitch itself.

    Args:
        local: the coarse object and the Gaussians around it.
        selection: which of them are the object, (N,).
        up: up vector, (3,).
        config: the plan so far.
        renderer: renders small pictures from all around.
    """
    if config.yaw_range_degrees is not None or config.pitch_degrees is not None or config.framing == "paper":
        return config
    isolated = local.select(selection)
    probes, _ = plan_cameras(isolated, up, replace(config, views=_PROBES, size=_PROBE_SIZE))
    labels = selection.astype(np.float32)[:, None]
    shown = np.array([renderer.blend_values(local, camera, labels).sum() for camera in probes])
    ones = np.ones((len(isolated), 1), np.float32)
    whole = np.array([renderer.blend_values(isolated, camera, ones).sum() for camera in probes])
    free = shown / np.maximum(whole, 1e-9)
    if np.mean(free < _BLOCKED * free.max()) < _BLOCKED_SHARE:
        return config
    first, length = _longest_arc(free >= _FREE * free.max())
    step = 360.0 / _PROBES
    middle, half_span = (first + (length - 1) / 2) * step, length * step / 4
    return replace(
        config, yaw_range_degrees=(middle - half_span, middle + half_span), pitch_degrees=_FACING_PITCH_DEGREES
    )


def _longest_arc(flags: BoolArray) -> tuple[int, int]:
    """Start and length of the longest run of True on a circle.

    >>> _longest_arc(np.array([True, False, False, True, True]))
    (3, 3)
    """
    n = len(flags)
    runs = [(start, next((k for k in range(n) if not flags[(start + k) % n]), n)) for start in range(n)]
    return max(runs, key=lambda run: run[1])
