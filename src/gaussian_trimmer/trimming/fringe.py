"""Black Gaussians around an object that was trained on pictures cut out before black.

There they cost nothing, whatever they are like: thin ones are left in the air around the object, where they hang on
nothing. A black part of the object hangs on the rest of it, or is a surface of its own, as densely covered as the rest.
"""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.gaussians import SH_C0, BoolArray, Gaussians, IntArray, mask_of_rows
from gaussian_trimmer.geometry.graphs import connected_pairs, nearest
from gaussian_trimmer.views.view import HALF

_BLACK = 1 / 255
"""Largest value of each channel of what a picture shows as black."""
_NEIGHBOURS = 16
"""Number of the nearest Gaussians that are tried for what one touches."""


def without_black_fringe(gaussians: Gaussians) -> Gaussians:
    """Return an object alone in which its black fringe is blank, as rows are that cannot be used."""
    logits = np.where(find_black_fringe(gaussians), np.float32(-np.inf), gaussians.opacity_logits)
    return gaussians.replace(opacity_logits=logits)


def find_black_fringe(gaussians: Gaussians) -> BoolArray:
    """Return which Gaussians of an object alone are a black fringe around it, (N,).

    These are connected pieces of black ones most of which touch nothing else, and which are covered less than half as
    densely as the object: by the median number of those that one touches. Two touch if their ellipsoids of one standard
    deviation meet.
    """
    black = (HALF + SH_C0 * gaussians.sh_dc <= _BLACK).all(axis=1) & ~gaussians.blank
    fringe, rows, others = np.zeros(len(gaussians), np.bool_), np.flatnonzero(black), np.flatnonzero(~black)
    if not len(rows) or not len(others):
        return fringe
    asked = np.concatenate([rows, others[:: max(1, len(others) // len(rows))]])  # about as many others tell how dense
    _, near = nearest(gaussians.means, gaussians.means[asked], min(_NEIGHBOURS + 1, len(gaussians)))
    pairs = np.stack([np.repeat(asked, near.shape[1]), near.reshape(-1)], axis=1)
    pairs = pairs[_meet(gaussians, pairs)]
    count, ends_black = np.bincount(pairs[:, 0], minlength=len(black)), black[pairs]
    pieces = connected_pairs(len(black), pairs[ends_black.all(axis=1)])[rows]
    hangs = mask_of_rows(pairs[ends_black[:, 0] & ~ends_black[:, 1], 0], len(black))
    least = HALF * np.median(count[asked[len(rows) :]])
    for piece in np.unique(pieces):
        members = rows[pieces == piece]
        fringe[members] = hangs[members].mean() <= HALF and np.median(count[members]) < least
    return fringe


def _meet(gaussians: Gaussians, pairs: IntArray) -> BoolArray:
    """Tell whether the ellipsoids of pairs of Gaussians (P, 2) meet; none meets itself, (P,)."""
    first, second = pairs.T
    offsets = gaussians.means[second].astype(np.float64) - gaussians.means[first]
    factors = gaussians.factors()
    reach = sum(np.linalg.norm(np.einsum("pij,pi->pj", factors[ends], offsets), axis=1) for ends in (first, second))
    return np.asarray((first != second) & (np.square(offsets).sum(axis=1) <= reach))
