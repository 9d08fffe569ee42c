"""The flat surfaces that an object stands on, hangs on or leans against: table, floor, wall, the corner of two."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.planes import MIN_INLIERS, Plane, find_plane, floor_and_wall_directions
from gaussian_trimmer.removal.surface_picture import goes_on
from gaussian_trimmer.removal.views import THICKNESS_RADII, RemovalViews, Surface
from gaussian_trimmer.views.view import HALF

_REACH_RADII = 2.0
"""Distance from the object's centre within which surfaces are looked for, in object radii."""
_BELOW_RADII = 0.4
"""How far a surface may lie beyond the object's end, in object radii."""
_END_QUANTILE = 0.02
"""Share of what is seen of the object that may lie beyond its end, so that floaters do not count."""
_BIN_RADII = 0.02
_MIN_SHARE = 0.12
"""Smallest share that a further surface must hold of what is seen around the object from before it: floors and walls of
the benchmark's scenes hold 0.15 and more, other layers 0.09 and less."""
_BAND = 3 * THICKNESS_RADII
"""Half of the thickness of the layer of which a surface holds more than half: a cloud is as dense beside it."""
_MIN_ABOVE = 0.9
"""Smallest share of the object's Gaussians that must lie on the surface's side."""
_LEAST_RISE = 0.15
"""Sine of the angle above a surface from which on a view sees it; those from its edge look into walls."""
_MAX_SURFACES = 3
_MAX_ALIKE = 0.75
"""Cosine of the angle between surfaces from which on they are one: of a cloth and its table, the cloth counts, and
between two walls at a corner none lies askew."""

_MAX_OPPOSED = -0.5
"""The same of surfaces that face each other, which an object cannot both lean against and be seen."""


def find_surfaces(views: RemovalViews) -> list[Surface]:
    """Return the flat surfaces that an object touches, the largest first: at most one horizontal one, and walls.

    A surface faces most of the places that the object was seen from. Only views from before it that show the object
    count: behind walls hangs what no photograph shows. Of the layers at the object's end that hold most of what is seen
    there, those are surfaces that are seen to go on.
    """
    bounds, members = views.bounds, views.removed
    local = (views.gaussians.means - bounds.centre) @ bounds.axes.T / bounds.radius
    visible = views.visible_in_view.sum(axis=2)
    around = ~members & visible.any(axis=0) & (np.linalg.norm(local, axis=1) < _REACH_RADII)
    if around.sum() < MIN_INLIERS or not members.any():
        return []
    eyes, observers = (
        np.array([(camera.centre - bounds.centre) @ bounds.axes.T for camera in cameras]).reshape(-1, 3)
        for cameras in (views.cameras, views.observing)
    )
    eyes /= np.linalg.norm(eyes, axis=1, keepdims=True)
    showing = np.array([sight.of_object for sight in views.sights])
    points, object_points = local[around], local[members]
    free, directions, found = np.ones(len(points), np.bool_), floor_and_wall_directions(), list[Surface]()
    if len(observers):
        before = observers @ directions.T > -np.abs(directions) @ bounds.half_extents
        directions = directions[before.mean(axis=0) > HALF]

    @cache
    def weights_from(side: bytes) -> tuple[Float64Array, Float64Array]:
        seen = visible[np.frombuffer(side, np.bool_)].sum(axis=0, dtype=np.float64)
        return seen[around], seen[members]

    def weights_from_before(direction: Float64Array) -> tuple[Float64Array, Float64Array]:
        return weights_from((showing & (eyes @ direction > _LEAST_RISE)).tobytes())

    def weights_at_the_end(direction: Float64Array) -> Float64Array:
        weights, of_object = weights_from_before(direction)
        lowest, highest = _quantiles(object_points @ direction, of_object, [_END_QUANTILE, 1 - _MIN_ABOVE])
        heights = points @ direction
        return np.where(free & (heights > lowest - _BELOW_RADII) & (heights < highest + THICKNESS_RADII), weights, 0)

    while len(directions) and len(found) < _MAX_SURFACES:
        plane, guess, _ = find_plane(points, directions, weights_at_the_end, _BIN_RADII, THICKNESS_RADII)
        weights, _ = weights_from_before(guess.normal)
        layer, band = (weights @ (np.abs(plane.signed_distance(points)) < width) for width in (THICKNESS_RADII, _BAND))
        if layer <= max(HALF * band, 0 if not found else _MIN_SHARE * weights.sum()):
            break
        surface = _surface(plane, bounds)
        if goes_on(views, surface, found):
            found.append(surface)
            free &= np.abs(plane.signed_distance(points)) > 2 * THICKNESS_RADII
        alike = directions @ plane.normal
        directions = directions[(alike < _MAX_ALIKE) & (alike > _MAX_OPPOSED)]
    return found


def _quantiles(heights: Float64Array, weights: Float64Array, shares: Sequence[float]) -> Float64Array:
    """Return the heights below which some shares of the weight lie, to a quarter of a bin."""
    lowest, bin_height = float(heights.min()), _BIN_RADII / 4
    held = np.cumsum(np.bincount(((heights - lowest) / bin_height).astype(np.int64), weights))
    return np.asarray(lowest + bin_height * np.searchsorted(held, np.array(shares) * held[-1]))


def _surface(plane: Plane, bounds: Bounds) -> Surface:
    """Return a plane of the bounds' own coordinates, in object radii, with a frame in it."""
    normal = plane.normal
    across = np.eye(3)[0] if abs(normal[0]) < _MAX_ALIKE else np.eye(3)[1]
    first = np.cross(across, normal)
    first /= np.linalg.norm(first)
    frame = np.stack([first, np.cross(normal, first), normal])
    return Surface(
        bounds.centre + plane.offset * bounds.radius * normal @ bounds.axes, frame @ bounds.axes, bounds.radius
    )
