"""The plane that an object stands on, and the pieces on it that touch the object.

Rough selections are wrong most often at table tops and floors, and these are easy to find: a horizontal layer that
holds much of what surrounds the object. With the layer taken away, what stands on it falls apart into pieces that do
not touch each other. Of a piece of which the selection has every end, more may belong to the object than was selected:
a leaf that was missed, the spokes of a wheel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray
from gaussian_trimmer.geometry.bounds import BOUND_PERCENTILES, Bounds
from gaussian_trimmer.geometry.graphs import connected_points
from gaussian_trimmer.geometry.planes import Plane, densest_layer
from gaussian_trimmer.settings import Range, Share

_FOOT_DISTANCE_RADII = 0.4
"""Vertical distance from the object's foot within which the plane is searched, in object radii."""
_MIN_SURFACE_WEIGHT = 0.01
"""Visible weight, relative to the object's, of the faintest surface; floaters beside an object that was captured alone
have less."""


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
    """Smallest share of a piece within the bounds of the selection, or selected, from which on all of it counts so."""


@dataclass(frozen=True, eq=False)
class SupportPlane:
    """The plane, and where each of N Gaussians lies relative to it."""

    plane: Plane
    """In scene units."""
    thickness: float
    """Half of the thickness of its layer, in scene units."""
    on_surface: BoolArray
    """Gaussians within its thickness, (N,)."""
    above: BoolArray
    """Gaussians above it, (N,)."""


def find_support_plane(
    positions: FloatArray, selection: BoolArray, weights: Float64Array, bounds: Bounds, config: SupportPlaneConfig
) -> SupportPlane | None:
    """Return the horizontal layer near the object's foot that holds most of what surrounds it, None if there is none.

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
    layer = densest_layer(height[level], weights[level], bin_height, float(foot - _FOOT_DISTANCE_RADII))
    least = config.min_share * weights[level].sum(), config.min_share_of_all * weights[~selection].sum()
    if layer is None or layer[1] < max(*least, _MIN_SURFACE_WEIGHT * weights[selection].sum()):
        return None
    shown = weights[selection]
    if shown[height[selection] <= layer[0] + config.thickness].sum() > config.max_selected_within * shown.sum():
        return None
    on_surface, above = np.abs(height - layer[0]) <= config.thickness, height > layer[0] + config.thickness
    up = bounds.axes[2]
    plane = Plane(up, float(up @ bounds.centre + layer[0] * bounds.radius))
    return SupportPlane(plane, config.thickness * bounds.radius, on_surface, above)


def pieces_of_object(
    positions: FloatArray,
    labels: BoolArray,
    weights: Float64Array,
    plane: SupportPlane,
    gap: float,
    reach: float,
    config: SupportPlaneConfig,
) -> tuple[BoolArray, BoolArray]:
    """Return Gaussians of pieces that may be the object's though they are not labelled so, and that are its own, (N,).

    A piece is what lies above the plane and is connected by short steps. It may be the object's if some of it is
    labelled so and all of it lies within the bounds of what is labelled, so that the selection has every end of it: a
    lawn that touches a plant, or a robot of which an arm was selected, reaches beyond them.

    Args:
        positions: centres divided by the object's radius, (N, 3).
        labels: the labels so far, (N,).
        weights: how visible each Gaussian is, (N,).
        plane: the plane that the object stands on.
        gap: largest step within a piece, in object radii.
        reach: how far a piece may lie outside the bounds of the selection, in object radii.
        config: what counts as a piece.
    """
    attached, own = (np.zeros(len(labels), np.bool_) for _ in range(2))
    rows = np.flatnonzero(plane.above)
    if len(rows) == 0:
        return attached, own
    piece = connected_points(positions[rows].astype(np.float64), gap)
    near = _within_bounds(positions[rows], positions[labels], reach)
    selected, total = np.bincount(piece, weights[rows] * labels[rows]), np.bincount(piece, weights[rows])
    within = np.bincount(piece, weights[rows] * near) >= config.min_within_bounds * total
    attached[rows] = (within & (selected > config.min_selected * total))[piece] & ~labels[rows]
    own[rows] = (selected >= config.min_within_bounds * total)[piece] & labels[rows]
    return attached, own


def _within_bounds(positions: FloatArray, selected: FloatArray, margin: float) -> BoolArray:
    """Return which positions (N, 3) lie in the box of the selected ones (M, 3), widened by a margin, (N,)."""
    if len(selected) == 0:
        return np.zeros(len(positions), np.bool_)
    low, high = selected.min(axis=0) - margin, selected.max(axis=0) + margin
    return np.asarray(((positions >= low) & (positions <= high)).all(axis=1))
