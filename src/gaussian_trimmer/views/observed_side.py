"""The directions from which an object was observed, for scenes without cameras.

Training keeps the space between the cameras and what they saw free; behind the object of a forward-facing capture the
scene is full of haze and of what stands there. So where all that blocks the view of an object is on one side of it, it
was photographed from the other side; what stands around it here and there, as on a table, was looked past.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.views.virtual_cameras import PlanConfig

_SECTORS = 16
"""Sectors of the circle around the object in which it is asked how freely the object is seen."""
_PITCHES_DEGREES = (20.0, 40.0)
"""Height of these sectors. Lower ones are blocked by whatever lies beside the object, from higher ones one looks over
everything."""
_NEAR_RADII, _FAR_RADII = 1.1, 12.0
"""Distances from the object's centre, in object radii, between which things block the view of it."""
_SAMPLE_SIZE = 100_000
"""Gaussians that are looked at, evenly spaced in the scene's order if there are more."""
_ONE_SIDED_LENGTH = 0.165
"""Length of the mean direction in which the object is seen freely, as a part of a unit vector, from which on it was
photographed from one side: 0 if it is free or blocked all around, 0.32 if it is blocked over half of the circle."""
_FREE_SHARE = 0.5
"""Share of a view that is not blocked from which on the object counts as seen from there."""
_MIDDLE_SHARE = 0.4
"""Share of the free arc, in its middle, from which the object is looked at."""
_FACING_PITCHES_DEGREES = 30.0, 10.0
"""Height from which the flattest of things is looked at then, and what is as tall as it is wide."""


def limit_yaw_to_observed(scene: Gaussians, selection: BoolArray, bounds: Bounds, config: PlanConfig) -> PlanConfig:
    """Return the plan limited to the middle of the directions from which the object is unobstructed, at a low pitch.

    The plan is returned unchanged if the object is not blocked on one side, or if it gives yaw or pitch itself.

    Args:
        scene: all N Gaussians.
        selection: which of them are the object, (N,).
        bounds: the object's; their third axis is up.
        config: the plan so far.
    """
    if config.yaw_range_degrees is not None or config.pitch_degrees is not None or config.framing != "fit":
        return config
    free = _free_shares(scene, selection, bounds)
    mean = np.mean(free * np.exp(2j * np.pi * (np.arange(_SECTORS) + 0.5) / _SECTORS))
    if abs(mean) < _ONE_SIDED_LENGTH:
        return config
    middle = float(np.degrees(np.angle(mean)))
    half_span = _MIDDLE_SHARE * 180.0 * float(np.mean(free > _FREE_SHARE))
    level, upright = _FACING_PITCHES_DEGREES
    pitch = level + (upright - level) * min(1.0, bounds.half_extents[2] / bounds.half_extents[:2].max())
    return replace(config, yaw_range_degrees=(middle - half_span, middle + half_span), pitch_degrees=float(pitch))


def _free_shares(scene: Gaussians, selection: BoolArray, bounds: Bounds) -> Float64Array:
    """Return how freely the object is seen in each sector around it, from 0 to 1, (_SECTORS,).

    A sector is filled by the solid angles of the Gaussians in it, as if they lay there at random: what they leave free
    falls off exponentially with their sum.
    """
    offset = scene.means - bounds.centre.astype(np.float32)
    squared = np.einsum("ni,ni->n", offset, offset)
    near, far = (_NEAR_RADII * bounds.radius) ** 2, (_FAR_RADII * bounds.radius) ** 2
    rows = np.flatnonzero(~selection & (squared > near) & (squared < far))
    step = -(-len(rows) // _SAMPLE_SIZE) or 1
    rows = rows[::step]
    x, y, z = (offset[rows] @ bounds.axes.T).T
    low, high = np.sin(np.radians(_PITCHES_DEGREES))
    height = z / np.sqrt(squared[rows])
    within = (height > low) & (height < high)
    rows, x, y = rows[within], x[within], y[within]
    deviations = np.sort(scene.log_scales[rows].astype(np.float64), axis=1)
    angles = np.pi * np.exp(deviations[:, 1] + deviations[:, 2]) / squared[rows] * scene.select(rows).opacities
    sectors = np.floor((np.arctan2(y, x) / (2 * np.pi)) * _SECTORS).astype(np.int64) % _SECTORS
    filled = step * np.bincount(sectors, np.minimum(angles, 1.0), _SECTORS)
    return np.asarray(np.exp(-filled / (2 * np.pi / _SECTORS * (high - low))))
