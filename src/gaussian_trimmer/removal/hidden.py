"""What leaves a scene with an object: what only it hid, fragments of its skin, and what only it held.

Training puts Gaussians where no photograph can contradict them: inside an object and behind its skin. The object
occludes them; in the scene without it they are a dark cloud. This occluded interior is told by three things: it shows
in the background alone and hardly in the whole scene; what it shows lies within the object's silhouettes, from every
side and height; and it lies where the object was. Below the object, where what it stands on goes on, only Gaussians of
colours that are not seen around it count.

Fragments are visible pieces of the object's own skin. Nearly all that is near a fragment belongs to the object, so the
fragment goes with it. So does what was pruned from the object since it would stick out of it, such as the back of a
bookcase, unless most of what is near it stays: then its label was wrong, and it is the wall's.

What is above the surfaces around an object hangs together with them, or with what lies farther away. A piece that hangs
together with nothing but the object loses its hold with it. A small one within the object's bounds is a remnant of it,
such as the dark half of a roof that no camera saw.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.gaussians import (
    SH_C0,
    BoolArray,
    Float64Array,
    FloatArray,
    IntArray,
    ellipsoid_points,
    mask_of_rows,
)
from gaussian_trimmer.geometry.graphs import connected_pairs, nearest
from gaussian_trimmer.removal.views import THICKNESS_RADII, RemovalViews, Surface, above_all
from gaussian_trimmer.views.view import HALF, TOUCHING_RADII

_MAX_ROUNDS = 3
"""What the interior itself has hidden shows when it is gone, and may be interior as well."""
_MIN_SHOWN_SHARE = 2e-6
"""Smallest blend weight in the background alone, as a share of the views' pixels, of what can be noticed."""
_MAX_VISIBLE_SHARE = 0.4
"""Largest blend weight in the whole scene, relative to that in the background alone."""
_MIN_INSIDE_SHARE = 0.65
"""Smallest share of the blend weight in the background alone within the object's silhouettes."""
_COLOUR_LEVELS = 8
"""Levels of each channel between which colours are told apart."""
_FOREIGN_SHARE = 0.02
"""Largest share of what is seen around the object that has about a foreign colour."""
_FRAGMENT_NEIGHBOURS = 12
_FRAGMENT_SHARE = 0.8
"""Least share of the nearest Gaussians of a fragment that are the object's or its interior, and of what it shows that
lies in the object's silhouettes."""
_MAX_FRAGMENT_WEIGHT_SHARE = 0.01
"""Largest blend weight of all fragments in the scene, relative to the object's; more is not a fragment."""
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


def find_hidden(views: RemovalViews, surfaces: Sequence[Surface]) -> tuple[BoolArray, FloatArray]:
    """Return the occluded interior and fragments of an object, and what shows without it, (N,) each.

    The last array is the blend weight of each Gaussian in the background alone, to be compared with that in the whole
    scene.

    Args:
        views: the object from all sides, at several heights.
        surfaces: what it stands on, hangs on or leans against.
    """
    within, above = _where_the_object_was(views, surfaces)
    there = within & (above | _foreign_colours(views))
    interior, unoccluded = np.zeros(len(there), np.bool_), np.zeros(len(there), np.float32)
    noticed = _MIN_SHOWN_SHARE * sum(camera.width * camera.height for camera in views.cameras)
    for _ in range(_MAX_ROUNDS):
        shown = views.weigh(~(views.removed | interior))
        unoccluded = np.maximum(unoccluded, shown.sum(axis=1))
        found = there & (unoccluded > noticed) & (views.total_visible <= _MAX_VISIBLE_SHARE * unoccluded)
        found &= (shown[:, 1] >= _MIN_INSIDE_SHARE * unoccluded) & ~interior
        if not found.any():
            break
        interior |= found
    return interior | _find_fragments(views, interior, within & above) | _find_pruned(views, interior), unoccluded


def _where_the_object_was(views: RemovalViews, surfaces: Sequence[Surface]) -> tuple[BoolArray, BoolArray]:
    """Return the background Gaussians within the object's bounds, and those above what it stands on, (N,) each."""
    bounds, margin = views.bounds, TOUCHING_RADII * views.bounds.radius
    local = (views.gaussians.means - bounds.centre) @ bounds.axes.T
    # The bounds are robust ones, so a thin top rises above them.
    top = max(bounds.half_extents[2], float(local[views.of_object, 2].max(initial=0.0))) + margin
    within = (np.abs(local[:, :2]) <= bounds.half_extents[:2] + margin).all(axis=1) & (local[:, 2] < top)
    above = above_all(surfaces, views.gaussians.means, THICKNESS_RADII)
    if not surfaces:
        above = local[:, 2] > -bounds.half_extents[2]
    return within & ~views.removed, above


def _foreign_colours(views: RemovalViews) -> BoolArray:
    """Return the Gaussians with colours of which hardly anything is seen around the object, (N,)."""
    rgb = 0.5 + SH_C0 * views.gaussians.sh_dc
    level = np.clip((rgb * _COLOUR_LEVELS).astype(np.int64), 0, _COLOUR_LEVELS - 1)
    seen, counts = np.where(views.removed, 0, views.total_visible), np.zeros((_COLOUR_LEVELS + 2,) * 3)
    np.add.at(counts, tuple(level.T + 1), seen)
    for axis in range(3):
        counts += np.roll(counts, 1, axis) + np.roll(counts, -1, axis)
    return np.asarray(counts[tuple(level.T + 1)] < _FOREIGN_SHARE * seen.sum())


def _find_fragments(views: RemovalViews, interior: BoolArray, there: BoolArray) -> BoolArray:
    """Return the visible pieces of the object among the background, (N,)."""
    total = views.total_visible
    possible = np.flatnonzero(there & ~interior & (total > 0) & (views.visible[:, 1] >= _FRAGMENT_SHARE * total))
    fragments = np.zeros(len(interior), np.bool_)
    ours = _share_of_neighbours(views, views.of_object | interior, possible) >= _FRAGMENT_SHARE
    rows = possible[ours]
    rows = rows[np.argsort(total[rows], kind="stable")]
    fragments[rows[np.cumsum(total[rows]) <= _MAX_FRAGMENT_WEIGHT_SHARE * total[views.of_object].sum()]] = True
    return fragments


def _find_pruned(views: RemovalViews, interior: BoolArray) -> BoolArray:
    """Return what was pruned from the object and lies mostly among what is its own or was pruned, too, (N,)."""
    if views.pruned is None:
        return np.zeros_like(interior)
    rows = np.flatnonzero(views.pruned & ~views.removed)
    ours = _share_of_neighbours(views, views.of_object | interior | views.pruned, rows) > HALF
    return mask_of_rows(rows[ours], len(interior))


def _share_of_neighbours(views: RemovalViews, counted: BoolArray, rows: IntArray) -> Float64Array:
    """Return the share of the Gaussians nearest to some, by their rows (R,), that is counted, (R,)."""
    means = views.gaussians.means
    if not len(rows):
        return np.zeros(0)
    _, near = nearest(means, means[rows], min(_FRAGMENT_NEIGHBOURS + 1, len(means)))
    others = near != rows[:, None]
    return np.asarray((counted[near] & others).sum(axis=1) / others.sum(axis=1))


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
