"""Views to click in, for scenes without cameras: those of a person in rooms, elsewhere from around and from outside."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from gaussian_trimmer.cameras import Camera, Point, Viewpoint, intrinsics, look_at, up_frame
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.geometry.bounds import Bounds, robust_bounds
from gaussian_trimmer.geometry.limits import check_size
from gaussian_trimmer.geometry.storey import TILE_SIDES, find_storey, sampled, tile_sides
from gaussian_trimmer.settings import Range, Vector
from gaussian_trimmer.views.camera_rings import NEAR_RADII, Lens, framing_distance, ring
from gaussian_trimmer.views.standing import TRIED_GAUSSIANS, seen_shares, stands_in_rooms, thinned
from gaussian_trimmer.views.view import HALF

_MIDDLE_SHARE = 0.25
"""Share of the Gaussians nearest to the middle that the views frame."""
_WHOLE_SHARE = 0.95
"""Share of the Gaussians whose distance tells whether a capture is compact."""
_COMPACT_RATIO = 3.2
"""A capture is compact, as of a single object, if it has the latter share within this many radii of the former."""
_DRAWN_RADII = 3.0
"""Gaussians farther from the middle than this many radii of what is framed are left out: walls would hide the rest."""
_END_QUANTILES = (0.005, 0.995)
"""Quantiles of the centres along each axis between which the whole capture lies."""
_MEDIAN_ROUNDS = 5
_SIZE_PIXELS, _FOV_RADIANS = 640, float(np.radians(60))
"""Width and height in pixels, and field of view."""
_PITCH_DEGREES = 30.0
_MIDDLE_FILL, _WHOLE_FILL = 0.6, 0.9
_SQUARE_FILL, _MOST_SQUARES = 1.25, 100
"""Width of a square of the ground in its view: corners are seen in the next one; how many are shown at most."""
_TRIAL_SCALE, _FREE_SHARE = 0.15, 0.5
"""Scale of pictures in which it is tried what shows; what is nearer than this share of the distance is in the way."""
_TARGET_RADII = 3.0
"""Distance of the views around a given point, in radii of the part with most detail."""


@dataclass(frozen=True)
class OverviewConfig:
    """Where the views to click in stand, for scenes without cameras."""

    pitch: Annotated[float, Range(-89, 89)] = _PITCH_DEGREES
    """Degrees above the horizon from which the views look."""
    distance: Annotated[float, Range(0.01, 100)] = 1.0
    """Distance of the views from what they look at, relative to the usual one; 0.5 is twice as near."""
    target: Vector | None = None
    """Point X Y Z of the scene that the views look at, in place of its middle."""
    ring: Annotated[int, Range(1, 100)] = 8
    """Number of views around."""


@dataclass(frozen=True, eq=False)
class Overview:
    """Views around the middle of a scene and, where these do not show all of it, of the whole capture."""

    views: list[Viewpoint]
    whole: range
    """Numbers of those that frame the whole capture."""


def plan_views(gaussians: Gaussians, up: Float64Array, config: OverviewConfig = OverviewConfig()) -> Overview:
    """Return views to click in: those of a person who looks around in rooms, elsewhere an overview from outside.

    On ground much wider than things are high, the first views show a square of it each, the fullest first.

    Args:
        gaussians: of the capture.
        up: the scene's up vector, (3,).
        config: where the views stand; in rooms only their number counts, unless it names a point.
    """
    if config.target is not None:
        return plan_overview(gaussians, up, config)
    lens, views = intrinsics(_FOV_RADIANS, _SIZE_PIXELS, _SIZE_PIXELS), []
    for eye, target in stands_in_rooms(gaussians, up, 2 * config.ring):
        near = NEAR_RADII * float(np.linalg.norm(target - eye))
        views.append(Viewpoint(Camera(look_at(eye, target, up), lens, _SIZE_PIXELS, _SIZE_PIXELS, near=near)))
    if views:
        return Overview(views, range(0))
    squares, overview = _over_squares(gaussians, up, config), plan_overview(gaussians, up, config)
    if not squares:
        return overview
    whole = overview.views[overview.whole.start :]
    return Overview(squares + whole, range(len(squares), len(squares) + len(whole)))


def _over_squares(gaussians: Gaussians, up: Float64Array, config: OverviewConfig) -> list[Viewpoint]:
    """Return a view of each square of a ground that is much wider than things are high; none of another place."""
    storey, axes = find_storey(sampled(gaussians), up), up_frame(up)
    points = gaussians.means.astype(np.float64) @ axes.T
    sides = tile_sides(storey, points[:, 2])
    if not sides:
        return []
    side = sides[1]
    squares, counts = np.unique(np.floor(points[:, :2] / side), axis=0, return_counts=True)
    fullest = np.argsort(-counts, kind="stable")[:_MOST_SQUARES]
    height, views = sides[0] / TILE_SIDES[0] / 2, list[Viewpoint]()
    drawn = thinned(gaussians, np.arange(len(gaussians)), len(gaussians) // TRIED_GAUSSIANS)
    for x, y in (squares[fullest] + 0.5) * side:
        middle = np.array([x, y, storey.floor + height]) @ axes
        bounds = Bounds(middle, axes, np.array([side / 2, side / 2, height]))
        for camera in _framing_ring(bounds, replace(config, ring=1), _SQUARE_FILL):
            distance = float(np.linalg.norm(camera.centre - middle))
            if seen_shares(drawn, camera.resized(_TRIAL_SCALE), _FREE_SHARE * distance)[2] > HALF:
                views.append(Viewpoint(camera))
    return views


def plan_overview(gaussians: Gaussians, up: Float64Array, config: OverviewConfig = OverviewConfig()) -> Overview:
    """Return views on a circle around the middle of a scene, and after them as many of the whole capture.

    Training makes many small Gaussians where there is detail and few large ones elsewhere, so the middle is where the
    centres are densest, found by repeated medians of the nearest ones. A compact capture, as of a single object, is
    framed as a whole by the first views.

    Args:
        up: the scene's up vector, (3,).
        config: where the views stand.
    """
    middle_point = _middle(gaussians.means)
    distance = np.linalg.norm(gaussians.means - middle_point, axis=1)
    middle, whole = (float(radius) for radius in np.quantile(distance, [_MIDDLE_SHARE, _WHOLE_SHARE]))
    if config.target is not None:
        return _around_target(config.target, middle, up_frame(up), config)
    compact = whole < _COMPACT_RATIO * middle
    framed = gaussians if compact else gaussians.select(distance <= np.float32(middle))
    bounds = robust_bounds(framed, up_frame(up))
    check_size(bounds.radius)
    x, y, z = (float(value) for value in middle_point)
    reach = _DRAWN_RADII * (whole if compact else middle) * max(1.0, config.distance)
    cameras = _framing_ring(bounds, config, _WHOLE_FILL if compact else _MIDDLE_FILL)
    views = [Viewpoint(camera, (x, y, z), reach) for camera in cameras]
    if compact:
        return Overview(views, range(len(views)))
    return Overview(views + views_of_all(gaussians, up, _WHOLE_FILL, config), range(len(views), 2 * len(views)))


def views_of_all(
    gaussians: Gaussians, up: Float64Array, fill: float, config: OverviewConfig = OverviewConfig()
) -> list[Viewpoint]:
    """Return views on a circle around the box of nearly all centres.

    Args:
        gaussians: of the capture.
        up: the scene's up vector, (3,).
        fill: width of the box in the pictures; corners of one of more than 1 lie outside.
        config: where the views stand.
    """
    return [Viewpoint(camera) for camera in _framing_ring(_bounds_of_nearly_all(gaussians, up), config, fill)]


def drawn_rows(means: FloatArray, view: Viewpoint) -> IntArray:
    """Return rows of the Gaussians, with centres (N, 3), that a view draws; others may be in front of them."""
    if view.drawn_centre is None:
        return np.arange(len(means))
    distance = np.linalg.norm(means - np.array(view.drawn_centre, np.float32), axis=1)
    return np.flatnonzero(distance <= np.float32(view.drawn_radius))


def drawn_part(scene: Gaussians, view: Viewpoint) -> tuple[Gaussians, IntArray]:
    """Return the M Gaussians of a scene that are drawn in a view, and their rows, (M,)."""
    rows = drawn_rows(scene.means, view)
    return scene if len(rows) == len(scene) else scene.select(rows), rows


def _framing_ring(bounds: Bounds, config: OverviewConfig, fill: float) -> list[Camera]:
    """Return views whose middle `fill` holds the bounds, nearer or farther by the factor of the configuration."""
    yaws, pitch = _angles(config)
    distance = config.distance * framing_distance(bounds, yaws, pitch, _FOV_RADIANS, fill)
    return ring(
        bounds.centre, bounds.axes, distance, yaws, pitch, Lens(_SIZE_PIXELS, _FOV_RADIANS, NEAR_RADII * bounds.radius)
    )


def _around_target(target: Point, radius: float, axes: Float64Array, config: OverviewConfig) -> Overview:
    distance = _TARGET_RADII * radius * config.distance
    lens = Lens(_SIZE_PIXELS, _FOV_RADIANS, max(NEAR_RADII * radius, 1e-6))
    cameras = ring(np.array(target, np.float64), axes, distance, *_angles(config), lens)
    # What is farther from the point than the camera stands behind walls as often as not.
    return Overview([Viewpoint(camera, target, 0.95 * distance) for camera in cameras], range(0))


def _angles(config: OverviewConfig) -> tuple[Float64Array, float]:
    """Return yaws (V,) and the pitch, in radians."""
    return 2 * np.pi * np.arange(config.ring) / config.ring, float(np.radians(config.pitch))


def _bounds_of_nearly_all(gaussians: Gaussians, up: Float64Array) -> Bounds:
    """Return the box that holds nearly all centres, wherever they lie dense."""
    axes = up_frame(up)
    low, high = np.quantile(gaussians.means.astype(np.float64) @ axes.T, _END_QUANTILES, axis=0)
    return Bounds((low + high) / 2 @ axes, axes, (high - low) / 2)


def _middle(means: FloatArray) -> FloatArray:
    """Return where the centres (N, 3) lie densest, (3,)."""
    middle = np.median(means, axis=0)
    for _ in range(_MEDIAN_ROUNDS):
        distance = np.linalg.norm(means - middle, axis=1)
        middle = np.median(means[distance <= np.quantile(distance, _MIDDLE_SHARE)], axis=0)
    return np.asarray(middle, np.float32)
