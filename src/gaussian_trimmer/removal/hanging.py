"""What hangs in the air once an object is gone: things that stood on it, and remnants and splinters of it.

What is above the surfaces around an object hangs together with them, or with what lies farther away. A piece that hangs
together with nothing but the object loses its hold with it. A small one within the object's bounds is a remnant of it,
such as the dark half of a roof that no camera saw.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, IntArray, ellipsoid_points
from gaussian_trimmer.geometry.components import connected_pairs
from gaussian_trimmer.geometry.neighbours import nearest
from gaussian_trimmer.removal.surfaces import THICKNESS_RADII, Surface, above_all
from gaussian_trimmer.removal.views import RemovalViews

_NEIGHBOURS = 8
_REACH_DEVIATIONS = 2.0
"""Gaussians touch whose centres are no farther apart than so many of their largest standard deviations; none counts as
wider than the object's median one, or haze would connect everything."""
_LEAST_OPACITY = 0.1
"""Fainter Gaussians hold nothing."""
_FAR_RADII = 1.5
"""What lies this far from the object's centre has another hold, in object radii."""
_FEWEST_OF_A_THING = 8
"""A piece of fewer Gaussians is a splinter."""
_MAX_REMNANT_SHARE = 0.05
"""Largest number of Gaussians of a remnant, relative to the object's; most of them lie whole within the object's
bounds: one that reaches out of them, as a patch of the wall behind a picture, would show beside it."""


def find_hanging(
    views: RemovalViews, gone: BoolArray, surfaces: Sequence[Surface]
) -> tuple[IntArray, BoolArray, BoolArray]:
    """Return things that only the object holds, numbered from 1, 0 elsewhere, its remnants and splinters, (N,) each.

    Args:
        views: the object and what is around it.
        gone: Gaussians that leave with the object, (N,).
        surfaces: what it stands on, hangs on or leans against.
    """
    gaussians, bounds = views.gaussians, views.bounds
    widths = np.exp(gaussians.largest_log_scales)
    reach = _REACH_DEVIATIONS * np.minimum(widths, np.median(widths[views.of_object]))
    things = np.zeros(len(gaussians), np.int64)
    remnants, splinters = (np.zeros(len(gaussians), np.bool_) for _ in range(2))
    rows = np.flatnonzero(~(views.removed | gone) & (gaussians.opacities >= _LEAST_OPACITY) & (widths < bounds.radius))
    means, members = gaussians.means[rows], np.flatnonzero(views.of_object)
    piece = _pieces(means, reach[rows])
    held = np.linalg.norm(means - bounds.centre, axis=1) > _FAR_RADII * bounds.radius
    held |= ~above_all(surfaces, means, THICKNESS_RADII)
    free = np.flatnonzero(~np.isin(piece, piece[held]))
    squared, near = nearest(gaussians.means[members], means[free], 1)
    touching = np.sqrt(squared[:, 0]) < reach[rows[free]] + reach[members[near[:, 0]]]
    free = free[np.isin(piece[free], piece[free[touching]])]
    _, number, count = np.unique(piece[free], return_inverse=True, return_counts=True)
    ends = (ellipsoid_points(gaussians.select(rows[free])) - bounds.centre) @ bounds.axes.T
    within = (np.abs(ends) <= bounds.half_extents).all(axis=(1, 2))
    inside = np.bincount(number, within) > 0.5 * count
    remnant = (inside & (count <= _MAX_REMNANT_SHARE * len(members)))[number]
    large = (count >= _FEWEST_OF_A_THING)[number] & ~remnant
    remnants[rows[free[remnant]]] = True
    splinters[rows[free[~large & ~remnant]]] = True
    things[rows[free[large]]] = np.unique(number[large], return_inverse=True)[1] + 1
    return things, remnants, splinters


def _pieces(means: np.ndarray, reach: np.ndarray) -> IntArray:
    """Return the number of the piece of touching Gaussians that each of some centres (N, 3) is in, (N,)."""
    squared, near = nearest(means, means, min(_NEIGHBOURS + 1, len(means)))
    pairs = np.column_stack([np.repeat(np.arange(len(means)), near.shape[1]), near.ravel()])
    return connected_pairs(len(means), pairs[np.sqrt(squared.ravel()) < reach[pairs].sum(axis=1)])
