"""Many small views: of an object, from several heights or cut out of larger views, and of the place where it stands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.geometry.bounds import BOUND_PERCENTILES, Bounds
from gaussian_trimmer.views.camera_rings import framing_ring
from gaussian_trimmer.views.virtual_cameras import FULL_CIRCLE_GAP, MAX_PITCH, PlanConfig, cameras_that_see, widest_gap

FAR_FOV_DEGREES = 20.0
"""Field of view. Training cameras are farther away than views that frame an object in a wide lens, and what
was trained from afar is not right in their perspective: an outline that is fitted in wide views shrinks."""
_PITCH_STEPS = (-20.0, 0.0, 20.0, 40.0)
"""Heights of the views above and below the planned ones, in degrees."""
_MIN_PITCH = 5.0
"""Smallest pitch in degrees where nothing is known of the training cameras; what they saw is looked at from there."""
_MAX_PITCH = float(np.degrees(MAX_PITCH))
_PITCH_MARGIN = 25.0
"""How much farther up and down than the training cameras, or than planned views that leave a part of the circle out,
the views may look from, in degrees."""
_SINGLE_VIEW_SPAN = np.radians(30)
"""Span of yaws around a single view."""
_CLOSE_UP_MARGIN = 0.15
"""Margin around the object in a view that is cut out, as a share of its box."""
_PLACE_RINGS = ((12.0, 4), (45.0, 4))
"""Pitches in degrees of the views of a place, and how many views have each."""
_PLACE_RINGS_ABOVE = ((70.0, 5),)


def views_at_heights(
    bounds: Bounds, planned: Sequence[Camera], training: Sequence[Camera], count: int, size: int
) -> list[Camera]:
    """Return small views that frame the object, from the part of the circle that the planned views look from.

    Args:
        bounds: the object's.
        planned: views that were planned for it, at least one.
        training: training cameras, if known: no view is much higher or lower than those that see the object.
        count: number of views, spread over four heights.
        size: width and height in pixels.
    """
    yaws, pitches = angles_around(planned, bounds)
    first, span = observed_arc(yaws)
    pitch = float(np.degrees(np.median(pitches)))
    low, high = (_MIN_PITCH, _MAX_PITCH) if span >= 2 * np.pi else (pitch - _PITCH_MARGIN, pitch + _PITCH_MARGIN)
    seen = cameras_that_see(training, bounds)
    if seen:
        lowest, highest = np.degrees(np.percentile(angles_around(seen, bounds)[1], BOUND_PERCENTILES))
        low, high = max(lowest - _PITCH_MARGIN, -_MAX_PITCH), min(highest + _PITCH_MARGIN, _MAX_PITCH)
    heights = np.radians(np.clip(pitch + np.array(_PITCH_STEPS), min(low, pitch), max(high, pitch)))
    # One after the other at the next height, a step of yaw farther: as seen from above they are evenly spread.
    places = first + span * (np.arange(count) + 0.5) / count
    pitches = heights[np.arange(count) % len(heights)]
    return framing_ring(bounds, places, pitches, size, float(np.radians(FAR_FOV_DEGREES)), PlanConfig.fill)


def close_up_of(camera: Camera, bounds: Bounds, size: int) -> tuple[Camera, tuple[slice, slice]]:
    """Return the part of a view that holds the object, at most `size` pixels wide and high, and its slices.

    Args:
        camera: the view.
        bounds: the object's. Where a corner lies behind the camera, the whole view is taken.
        size: largest width and height in pixels.
    """
    pixels, depths = camera.project(bounds.corners())
    x0, y0, x1, y1 = 0, 0, camera.width, camera.height
    if (depths > 0).all() and np.isfinite(pixels).all():
        margin = _CLOSE_UP_MARGIN * np.ptp(pixels, axis=0)
        first = np.clip(np.floor(pixels.min(axis=0) - margin), 0, (x1, y1)).astype(int)
        last = np.clip(np.ceil(pixels.max(axis=0) + margin), 0, (x1, y1)).astype(int)
        if (last - first >= 1).all():
            (x0, y0), (x1, y1) = first.tolist(), last.tolist()
    part = camera.part(x0, y0, x1, y1)
    return part.resized(min(1.0, size / max(part.width, part.height))), (slice(y0, y1), slice(x0, x1))


def views_of_place(bounds: Bounds, size: int, above: bool = False) -> list[Camera]:
    """Return small views from all sides at two heights, those of the upper one between those of the lower one.

    They go around the whole circle even where the object was seen from one side only: with views of that side alone,
    hidden Gaussians behind the object pass for parts of it (docs/decisions.md).

    Args:
        bounds: the object's bounds, which the views frame; their third axis is up.
        size: width and height of the views in pixels.
        above: steep views in place of these, which see the ground before walls and in corners.
    """
    fov, cameras = float(np.radians(PlanConfig.fov_degrees)), []
    for i, (pitch, count) in enumerate(_PLACE_RINGS_ABOVE if above else _PLACE_RINGS):
        yaws = 2 * np.pi * (np.arange(count) + 0.5 * i) / count
        cameras += framing_ring(bounds, yaws, np.radians(pitch), size, fov, PlanConfig.fill)
    return cameras


def angles_around(cameras: Sequence[Camera], bounds: Bounds) -> tuple[Float64Array, Float64Array]:
    """Return yaws and pitches of cameras around the object, in radians, (V,) each."""
    places = np.array([camera.centre for camera in cameras]).reshape(-1, 3)
    offsets = (places - bounds.centre) @ bounds.axes.T
    return np.arctan2(offsets[:, 1], offsets[:, 0]), np.arctan2(offsets[:, 2], np.hypot(offsets[:, 0], offsets[:, 1]))


def observed_arc(yaws: Float64Array) -> tuple[float, float]:
    """Return first yaw and span of the arc that evenly spread views stand for, in radians."""
    if len(yaws) == 1:
        return float(yaws[0]) - _SINGLE_VIEW_SPAN / 2, float(_SINGLE_VIEW_SPAN)
    first, gap = widest_gap(yaws)
    if gap <= max(FULL_CIRCLE_GAP, 2 * np.pi / len(yaws) + 1e-6):
        return float(yaws.min()), float(2 * np.pi)
    between = 2 * np.pi - gap
    step = between / (len(yaws) - 1)
    return float(first - step / 2), float(between + step)
