"""Cuts that a user draws on an object: what shows under a stroke goes, and what crosses its edge is split there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.geometry.split import split_plane
from gaussian_trimmer.rendering import blend_weights
from gaussian_trimmer.trimming.refinement import Pieces
from gaussian_trimmer.trimming.straddlers import BoundaryConfig, straddlers_in_view

_ROUNDS = 3
"""A Gaussian as long as a stroke is wide crosses both of its edges, and its halves are soft."""
_LEAST_SHARE = 0.1
"""Share of what shows of a Gaussian under a stroke from which on it is cut."""


@dataclass(frozen=True, eq=False)
class StrokeCut:
    """A stroke in a view. N Gaussians of the scene."""

    camera: Camera
    mask: BoolArray
    """Pixels under the stroke, (H, W)."""
    spared: BoolArray
    """What was selected again after it, (N,)."""


def cut_at_stroke(pieces: Pieces, cut: StrokeCut) -> tuple[Pieces, Pieces]:
    """Cut an object, seen alone, at a stroke: what crosses both of its edges, or shows under what was cut, in rounds.

    Parts and fitted Gaussians under the stroke go. Other whole ones there are not the object's, or were selected again.

    Args:
        pieces: the object.
        cut: the stroke.

    Returns:
        The object, with the Gaussians that were cut after all others, and what was cut off.
    """
    inner, off = pieces, pieces.select(np.zeros(0, np.int64))
    for _ in range(_ROUNDS):
        beside, under = blend_weights(inner.gaussians, cut.camera, cut.mask.astype(np.uint8), 2).T
        crossing = ~cut.spared[inner.source] & (under > _LEAST_SHARE * (under + beside))
        found = straddlers_in_view(inner.gaussians, crossing, cut.camera, ~cut.mask, BoundaryConfig())
        gone = crossing & (inner.part | inner.fitted) & (under > beside)
        gone[found.rows] = False
        kept = ~gone
        kept[found.rows] = False
        split = inner.select(found.rows)
        inside, outside = split_plane(split.gaussians, found.normals, found.offsets)
        off = off.followed_by(inner.select(np.flatnonzero(gone))).followed_by(split.parts(outside))
        inner = inner.select(np.flatnonzero(kept)).followed_by(split.parts(inside))
    return inner, off
