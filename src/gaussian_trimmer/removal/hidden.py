"""What only the object hid: Gaussians of its interior, and fragments of its skin that the masks gave to the background.

Training puts Gaussians where no photograph can contradict them: inside an object and behind its skin. The object
occludes them; in the scene without it they are a dark cloud. This occluded interior is told by three things: it shows
in the background alone and hardly in the whole scene; what it shows lies within the object's silhouettes, from every
side and height; and it lies where the object was. Below the object, where what it stands on goes on, only Gaussians of
colours that are not seen around it count.

Fragments are visible pieces of the object's own skin. Nearly all that is near a fragment belongs to the object, so the
fragment does too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.gaussians import SH_C0, BoolArray, FloatArray
from gaussian_trimmer.geometry.neighbours import nearest
from gaussian_trimmer.removal.surfaces import THICKNESS_RADII, Surface, above_all
from gaussian_trimmer.removal.views import RemovalViews
from gaussian_trimmer.views.view import TOUCHING_RADII

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
_MAX_JOINING_SHARE = 0.02
"""Largest blend weight in the object, relative to that in the background alone, of interior that joins the object."""


def find_hidden(views: RemovalViews, surfaces: Sequence[Surface]) -> tuple[BoolArray, BoolArray, FloatArray]:
    """Return which Gaussians only the object hid, which are fragments of it, and what shows without it, (N,) each.

    Fragments do not change how the object looks; some of the occluded interior is among them. The last array is the
    blend weight of each Gaussian in the background alone, to be compared with that in the whole scene.

    Args:
        views: the object from all sides, at several heights.
        surfaces: what it stands on, hangs on or leans against.
    """
    within, above = _where_the_object_was(views, surfaces)
    there = within & (above | _foreign_colours(views))
    interior, isolated = np.zeros(len(there), np.bool_), np.zeros(len(there), np.float32)
    noticed = _MIN_SHOWN_SHARE * sum(camera.width * camera.height for camera in views.cameras)
    for _ in range(_MAX_ROUNDS):
        alone = views.weigh(~(views.removed | interior))
        isolated = np.maximum(isolated, alone.sum(axis=1))
        found = there & (isolated > noticed) & (views.total_visible <= _MAX_VISIBLE_SHARE * isolated)
        found &= (alone[:, 1] >= _MIN_INSIDE_SHARE * isolated) & ~interior
        if not found.any():
            break
        interior |= found
    fragments = _find_fragments(views, interior, within & above)
    if interior.any():
        both = views.weigh(views.of_object | interior | fragments)
        # What lies below would show there, where no view looks.
        fragments |= interior & above & (both.sum(axis=1) <= _MAX_JOINING_SHARE * isolated)
    return interior, fragments, isolated


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
    total, means = views.total_visible, views.gaussians.means
    possible = np.flatnonzero(there & ~interior & (total > 0) & (views.visible[:, 1] >= _FRAGMENT_SHARE * total))
    fragments = np.zeros(len(interior), np.bool_)
    if not len(possible):
        return fragments
    _, near = nearest(means, means[possible], min(_FRAGMENT_NEIGHBOURS + 1, len(means)))
    others = near != possible[:, None]
    ours = ((views.of_object | interior)[near] & others).sum(axis=1) >= _FRAGMENT_SHARE * others.sum(axis=1)
    rows = possible[ours]
    rows = rows[np.argsort(total[rows], kind="stable")]
    fragments[rows[np.cumsum(total[rows]) <= _MAX_FRAGMENT_WEIGHT_SHARE * total[views.of_object].sum()]] = True
    return fragments
