"""What only the object hid: Gaussians of its inside, and scraps of its skin that the masks gave to the background.

Training puts Gaussians where no photograph can contradict them: inside an object and behind its skin. The object hides
them; in the scene without it they are a dark cloud. These ghosts are told by three things: they show in the background
alone and hardly in the whole scene; what they show lies within the object's silhouettes, from every side and height;
and they lie where the object was. Below the object, where what it stands on goes on, only those are ghosts whose
colours are not seen around it.

Crumbs are visible scraps of the object's own skin. Nearly all that is near a crumb belongs to the object, so the crumb
does too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.gaussians import SH_C0, BoolArray, FloatArray
from gaussian_trimmer.geometry.neighbours import nearest
from gaussian_trimmer.removal.place import Place
from gaussian_trimmer.removal.surfaces import THICKNESS_RADII, Surface, above_all
from gaussian_trimmer.views import TOUCHING_RADII

_MAX_ROUNDS = 3
"""What a ghost has hidden shows when it is gone, and may be another ghost."""
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
_CRUMB_NEIGHBOURS = 12
_CRUMB_SHARE = 0.8
"""Least share of the nearest Gaussians of a crumb that are the object's or ghosts, and of what it shows that lies in
the object's silhouettes."""
_MAX_CRUMB_WEIGHT_SHARE = 0.01
"""Largest blend weight of all crumbs in the scene, relative to the object's; more is no crumb."""
_MAX_JOINING_SHARE = 0.02
"""Largest blend weight in the object, relative to that in the background alone, of a ghost that joins the object."""


@dataclass(frozen=True, eq=False)
class Hidden:
    """What the object hides, of N Gaussians."""

    ghosts: BoolArray
    """Those that show in the background alone, (N,)."""
    to_object: BoolArray
    """Those that belong to the object and do not change how it looks: some ghosts, and crumbs, (N,)."""
    shown: FloatArray
    """Blend weight of each Gaussian in the background alone, (N,); compare with that in the whole scene."""


def find_hidden(place: Place, surfaces: Sequence[Surface]) -> Hidden:
    """Which Gaussians of the background are only there because the object hid them, or are scraps of it.

    Args:
        place: the object in views from all sides, at several heights.
        surfaces: what it stands on, hangs on or leans against.
    """
    visible = place.seen.sum(axis=1)
    within, above = _where_the_object_was(place, surfaces)
    there = within & (above | _foreign_colours(place))
    ghosts, shown = np.zeros(len(there), np.bool_), np.zeros(len(there), np.float32)
    noticed = _MIN_SHOWN_SHARE * sum(camera.width * camera.height for camera in place.cameras)
    for _ in range(_MAX_ROUNDS):
        alone = place.weigh(~(place.removed | ghosts))
        shown = np.maximum(shown, alone.sum(axis=1))
        found = there & (shown > noticed) & (visible <= _MAX_VISIBLE_SHARE * shown)
        found &= (alone[:, 1] >= _MIN_INSIDE_SHARE * shown) & ~ghosts
        if not found.any():
            break
        ghosts |= found
    joins = _find_crumbs(place, ghosts, within & above)
    if ghosts.any():
        both = place.weigh(place.own | ghosts | joins)
        # What lies below would show there, where no view looks.
        joins |= ghosts & above & (both.sum(axis=1) <= _MAX_JOINING_SHARE * shown)
    return Hidden(ghosts, joins, shown)


def _where_the_object_was(place: Place, surfaces: Sequence[Surface]) -> tuple[BoolArray, BoolArray]:
    """Which Gaussians of the background lie within the object's bounds, and which lie above what it stands on, (N,)."""
    bounds, margin = place.bounds, TOUCHING_RADII * place.bounds.radius
    local = (place.gaussians.means - bounds.centre) @ bounds.axes.T
    # The bounds are robust ones, so a thin top rises above them.
    top = max(bounds.half_extents[2], float(local[place.own, 2].max(initial=0.0))) + margin
    within = (np.abs(local[:, :2]) <= bounds.half_extents[:2] + margin).all(axis=1) & (local[:, 2] < top)
    above = above_all(surfaces, place.gaussians.means, THICKNESS_RADII)
    if not surfaces:
        above = local[:, 2] > -bounds.half_extents[2]
    return within & ~place.removed, above


def _foreign_colours(place: Place) -> BoolArray:
    """Which Gaussians have colours of which hardly anything is seen around the object, (N,)."""
    rgb = 0.5 + SH_C0 * place.gaussians.sh_dc
    level = np.clip((rgb * _COLOUR_LEVELS).astype(np.int64), 0, _COLOUR_LEVELS - 1)
    seen, counts = np.where(place.removed, 0, place.seen.sum(axis=1)), np.zeros((_COLOUR_LEVELS + 2,) * 3)
    np.add.at(counts, tuple(level.T + 1), seen)
    for axis in range(3):
        counts += np.roll(counts, 1, axis) + np.roll(counts, -1, axis)
    return np.asarray(counts[tuple(level.T + 1)] < _FOREIGN_SHARE * seen.sum())


def _find_crumbs(place: Place, ghosts: BoolArray, there: BoolArray) -> BoolArray:
    """Visible scraps of the object among the background, (N,)."""
    total, means = place.seen.sum(axis=1), place.gaussians.means
    possible = np.flatnonzero(there & ~ghosts & (total > 0) & (place.seen[:, 1] >= _CRUMB_SHARE * total))
    crumbs = np.zeros(len(ghosts), np.bool_)
    if not len(possible):
        return crumbs
    _, near = nearest(means, means[possible], min(_CRUMB_NEIGHBOURS + 1, len(means)))
    others = near != possible[:, None]
    ours = ((place.own | ghosts)[near] & others).sum(axis=1) >= _CRUMB_SHARE * others.sum(axis=1)
    rows = possible[ours]
    rows = rows[np.argsort(total[rows], kind="stable")]
    crumbs[rows[np.cumsum(total[rows]) <= _MAX_CRUMB_WEIGHT_SHARE * total[place.own].sum()]] = True
    return crumbs
