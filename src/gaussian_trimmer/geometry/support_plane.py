"""The plane that an object stands on.

Rough selections are wrong most often at table tops and floors, and these are easy to find: a horizontal layer that
holds much of what surrounds the object. With the layer taken away, what stands on it falls apart into pieces that do
not touch each other. Of a piece of which the selection has every end, more may belong to the object than was selected:
a leaf that was missed, the spokes of a wheel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray
from gaussian_trimmer.geometry.bounds import BOUND_PERCENTILES, Bounds
from gaussian_trimmer.settings import Range, Share

_FOOT_DISTANCE_RADII = 0.4
"""Vertical distance from the object's foot within which the plane is searched, in object radii."""


@dataclass(frozen=True)
class SupportPlaneConfig:
    """How the plane that the object stands on is found and used."""

    enabled: bool = True
    """Look for the plane; where there is none, nothing changes."""
    min_share: Share = 0.3
    """Smallest share that the plane must hold of the visible Gaussians around the object near the height of its foot.
    What lies far below, such as the ground around a plinth, or far above, such as walls, does not count."""
    min_share_of_all: Share = 0.1
    """Smallest share that the plane must hold of all visible Gaussians around the object."""
    thickness: Annotated[float, Range(1e-3, 10)] = 0.05
    """Half of the plane's thickness, relative to the object's radius."""
    max_selected_within: Share = 0.5
    """Largest share of what the selection shows that may lie within the plane or below it. With more, the selection is
    the surface itself, or lies on it as a rug does, and there is no plane to tell it from."""
    min_selected: Share = 0.1
    """Smallest selected share of a piece within the bounds of the selection of which more may be the object's."""
    min_within_bounds: Share = 0.97
    """Smallest share of a piece within the bounds of the selection from which on it counts as lying within them."""


@dataclass(frozen=True, eq=False)
class SupportPlane:
    """The plane, and where each of N Gaussians lies relative to it."""

    height: float
    """Height of the plane above the bounds' centre, in object radii."""
    thickness: float
    """Half of its thickness, in object radii."""
    on_surface: BoolArray
    """Gaussians within its thickness, (N,)."""
    above: BoolArray
    """Gaussians above it, (N,)."""


def find_support_plane(
    positions: FloatArray, selection: BoolArray, weights: Float64Array, bounds: Bounds, config: SupportPlaneConfig
) -> SupportPlane | None:
    """The horizontal layer near the object's foot that holds most of what surrounds it; None if there is none.

    Args:
        positions: centres divided by the object's radius, (N, 3).
        selection: the given labels, (N,).
        weights: how visible each Gaussian is, (N,).
        bounds: the object's bounds; their third axis is up.
        config: what counts as a plane.
    """
    local = (positions - bounds.centre / bounds.radius) @ bounds.axes.T
    height = local[:, 2]
    if not config.enabled or not selection.any():
        return None
    foot = np.percentile(height[selection], BOUND_PERCENTILES[0])
    level = ~selection & (np.abs(height - foot) < _FOOT_DISTANCE_RADII)
    bin_height = 2 / 3 * config.thickness  # a layer is three bins
    lowest, highest = foot - _FOOT_DISTANCE_RADII, foot + _FOOT_DISTANCE_RADII + bin_height
    layer = densest_layer(height[level], weights[level], float(lowest), float(highest), bin_height)
    least = config.min_share * weights[level].sum(), config.min_share_of_all * weights[~selection].sum()
    if layer is None or layer[1] < max(least):
        return None
    shown = weights[selection]
    if shown[height[selection] <= layer[0] + config.thickness].sum() > config.max_selected_within * shown.sum():
        return None
    on_surface, above = np.abs(height - layer[0]) <= config.thickness, height > layer[0] + config.thickness
    return SupportPlane(layer[0], config.thickness, on_surface, above)


def plane_through(
    points: Float64Array, weights: Float64Array, direction: Float64Array, min_cosine: float
) -> tuple[Float64Array, float] | None:
    """Unit normal and offset of the plane through points, by weighted least squares; None if it is too steep.

    Args:
        points: (N, 3), at least three.
        weights: (N,).
        direction: the side that the normal faces.
        min_cosine: smallest cosine of the angle between normal and direction.
    """
    centre = np.average(points, axis=0, weights=weights)
    normal = np.linalg.eigh((points - centre).T * weights @ (points - centre))[1][:, 0]
    normal = normal * (np.sign(normal @ direction) or 1.0)
    return None if normal @ direction < min_cosine else (normal, float(centre @ normal))


def densest_layer(
    heights: Float64Array, weights: NDArray[np.floating], lowest: float, highest: float, bin_height: float
) -> tuple[float, float] | None:
    """Mean height and weight of the three neighbouring bins that hold most weight; None where there is none.

    Args:
        heights: heights of points, (N,).
        weights: their weights, (N,).
        lowest: lower edge of the first bin.
        highest: the last bin ends before this.
        bin_height: height of a bin.

    >>> densest_layer(np.array([0.5, 0.52, 3.0]), np.ones(3), 0.0, 4.0, 0.1)
    (0.51, 2.0)
    """
    edges = np.arange(lowest, highest, bin_height)
    held = np.convolve(np.histogram(heights, edges, weights=weights)[0], [1, 1, 1], "same")
    best = int(np.argmax(held))
    near = np.abs(heights - (edges[best] + bin_height / 2)) < 1.5 * bin_height
    if weights[near].sum() <= 0:
        return None
    return float(np.average(heights[near], weights=weights[near])), float(held[best])
