"""Planes: found along known directions, or by RANSAC where none is known, and fitted by least squares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import Float64Array, FloatArray

MIN_INLIERS = 20
"""Fewest points that a plane is found from."""
_MAX_TILT_COSINE = np.cos(np.radians(8))
"""Cosine of the largest angle between a fitted plane and the direction that it was found along."""
_FITTING_ROUNDS = 5
_WALLS = 48
"""Directions in which walls are looked for."""
_PLANES_AT_ONCE = 64
"""Planes that are compared with all points at once, so that the distances fit into the processor's cache."""


@dataclass(frozen=True, eq=False)
class Plane:
    """Points p with normal . p = offset."""

    normal: Float64Array
    """Unit vector, (3,)."""
    offset: float

    def signed_distance(self, points: FloatArray | Float64Array) -> Float64Array:
        """Return how far points (N, 3) lie from the plane, positive on the side of its normal, (N,)."""
        return np.asarray(points @ self.normal - self.offset)

    def pixel_heights(self, camera: Camera, depth: FloatArray) -> Float64Array:
        """Return how high above the plane what a camera's pixels show at these depths (H, W) lies, (H, W)."""
        x = (np.arange(camera.width) + 0.5 - camera.K[0, 2]) / camera.K[0, 0]
        y = (np.arange(camera.height) + 0.5 - camera.K[1, 2]) / camera.K[1, 1]
        right, down, forward = camera.rotation @ self.normal
        return np.asarray(self.normal @ camera.centre - self.offset + depth * (right * x + down * y[:, None] + forward))


def floor_and_wall_directions() -> Float64Array:
    """Return the normals that planes may have where z is up: up itself, then horizontal ones all around, (49, 3)."""
    turns = 2 * np.pi * np.arange(_WALLS) / _WALLS
    return np.concatenate([[[0.0, 0.0, 1.0]], np.column_stack([np.cos(turns), np.sin(turns), np.zeros(_WALLS)])])


def find_plane(
    points: Float64Array,  # (N, 3)
    directions: Float64Array,  # (D, 3)
    weights_along: Callable[[Float64Array], Float64Array],
    bin_height: float,
    tolerance: float,
) -> tuple[Plane, Plane, Float64Array]:
    """Return the plane whose layer holds most weight, its first guess, and the weight that each direction holds, (D,).

    The first guess is the densest layer along one of the directions; the plane is fitted to the points of that one.

    Args:
        points: where the surfaces are.
        directions: normals that the plane may have, but for a few degrees.
        weights_along: gives how much each point (N,) counts for a plane of a direction; fewer than twenty make none.
        bin_height: a third of the thickness of a layer.
        tolerance: distance from the plane of the points that it is fitted to.
    """
    layers = []
    for direction in directions:
        weights = weights_along(direction)
        rows = np.flatnonzero(weights)
        heights = points[rows] @ direction
        layers.append(densest_layer(heights, weights[rows], bin_height) if len(rows) >= MIN_INLIERS else None)
    held = np.array([layer[1] if layer else 0.0 for layer in layers])
    best = int(np.argmax(held))
    layer, weights = layers[best], weights_along(directions[best])
    rows = np.flatnonzero(weights)
    guess = Plane(directions[best], layer[0] if layer else 0.0)
    return fit_plane(guess, points[rows], weights[rows], tolerance, _MAX_TILT_COSINE), guess, held


def densest_layer(
    heights: Float64Array,  # (N,)
    weights: NDArray[np.floating],  # (N,)
    bin_height: float,
    lowest: float | None = None,
) -> tuple[float, float] | None:
    """Return mean height and weight of the three neighbouring bins that hold most weight; None where there is none.

    Args:
        heights: heights of points.
        weights: their weights.
        bin_height: height of a bin.
        lowest: lower edge of the first bin, at most the least height; None: that.

    >>> densest_layer(np.array([0.5, 0.52, 3.0]), np.ones(3), 0.1)
    (0.51, 2.0)
    """
    if not weights.any():
        return None
    lowest = float(heights.min()) if lowest is None else lowest
    bins = ((heights - lowest) / bin_height).astype(np.int64)
    held = np.convolve(np.bincount(bins, weights), np.ones(3))[1:-1]
    best = int(np.argmax(held))
    near = np.abs(bins - best) <= 1
    return float(np.average(heights[near], weights=weights[near])), float(held[best])


def fit_plane(
    plane: Plane, points: Float64Array, weights: Float64Array, tolerance: float, min_cosine: float = -1.0
) -> Plane:
    """Return the weighted least-squares plane of the inliers of a first guess, found anew a few times.

    Args:
        plane: the first guess.
        points: (N, 3).
        weights: (N,).
        tolerance: distance from the plane within which points are inliers.
        min_cosine: least cosine of the angle to the first guess; a plane that turns farther is not taken.
    """
    first = plane.normal
    for _ in range(_FITTING_ROUNDS):
        near = np.abs(plane.signed_distance(points)) < tolerance
        if np.count_nonzero(near) < MIN_INLIERS:
            break
        inliers, share = points[near], weights[near]
        centre = np.average(inliers, axis=0, weights=share)
        normal = np.linalg.eigh((inliers - centre).T * share @ (inliers - centre))[1][:, 0]
        normal = normal * (np.sign(normal @ first) or 1.0)
        if normal @ first < min_cosine:
            break
        plane = Plane(normal, float(centre @ normal))
    return plane


def random_planes(
    points: Float64Array, count: int, smallest: float, rng: np.random.Generator
) -> tuple[Float64Array, Float64Array]:
    """Return normals (P, 3) and offsets (P,) of planes through three random points each, the hypotheses of RANSAC.

    Args:
        points: (N, 3).
        count: number of tries; three points in a line, or twice the same one, make no plane.
        smallest: twice the area of the smallest triangle that counts.
        rng: where the points are drawn from.
    """
    first, second, third = points[rng.integers(len(points), size=(3, count))]
    normals = np.cross(second - first, third - first)
    lengths = np.linalg.norm(normals, axis=1)
    proper = lengths > smallest
    normals = normals[proper] / lengths[proper, None]
    return normals, np.asarray((normals * first[proper]).sum(axis=1))


def median_radius(points: FloatArray | Float64Array) -> float:
    """Return the median distance of points (N, 3) from their middle, which tolerances are relative to."""
    return float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))


def inlier_shares(normals: Float64Array, offsets: Float64Array, points: Float64Array, tolerance: float) -> Float64Array:
    """Return the shares of points (N, 3) that lie near each of some planes, (P,)."""
    columns, counts = np.ascontiguousarray(points.T), np.empty(len(normals))
    for start in range(0, len(normals), _PLANES_AT_ONCE):
        rows = slice(start, start + _PLANES_AT_ONCE)
        heights = normals[rows] @ columns - offsets[rows, None]
        counts[rows] = np.count_nonzero(np.abs(heights, out=heights) < tolerance, axis=1)
    return counts / len(points)
