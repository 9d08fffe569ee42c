"""Cuts that a user draws on an object: what shows under a stroke goes, and what crosses its edge is split there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.decomposition.split_rules import split_plane
from gaussian_trimmer.decomposition.straddlers import BoundaryConfig, straddlers_in_view
from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.rendering import Renderer

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


@dataclass(frozen=True, eq=False)
class CutObject:
    """An object of M Gaussians after a cut, and what was cut off."""

    object: Gaussians
    """Whole Gaussians in their order, then the parts of split ones."""
    parent: IntArray
    """Row of the object before the cut that each comes from, (M,)."""
    n_parts: int
    """Number of parts of split Gaussians, the last ones."""
    cut_off: Gaussians
    cut_off_parent: IntArray
    """Row of the object before the cut that each of them comes from."""


def cut_at_stroke(
    gaussians: Gaussians, free: BoolArray, pieces: BoolArray, cut: StrokeCut, renderer: Renderer
) -> CutObject:
    """Cut an object, seen alone, at a stroke: what crosses both of its edges, or shows under what was cut, in rounds.

    Args:
        gaussians: the object, (M,).
        free: which of them may be cut, (M,).
        pieces: which of them are parts of a Gaussian of the scene, (M,): those under the stroke go. Whole ones there
            are not the object's, or were selected again.
        cut: the stroke.
        renderer: tells what shows.
    """
    inner, parent, n_whole = gaussians, np.arange(len(gaussians)), len(gaussians)
    off, off_parent = [gaussians.select(slice(0))], [parent[:0]]
    for _ in range(_ROUNDS):
        beside, under = renderer.blend_weights(inner, cut.camera, cut.mask.astype(np.uint8), 2).T
        crossing = free[parent] & (under > _LEAST_SHARE * (under + beside))
        found = straddlers_in_view(inner, crossing, cut.camera, ~cut.mask, renderer, BoundaryConfig())
        is_part = np.arange(len(inner)) >= n_whole
        gone = crossing & (is_part | pieces[parent]) & (under > beside)
        gone[found.rows] = False
        kept = ~gone
        kept[found.rows] = False
        halves = split_plane(inner.select(found.rows), found.normals, found.offsets)
        off += [inner.select(np.flatnonzero(gone)), halves[1]]
        off_parent += [parent[gone], parent[found.rows]]
        n_whole = int(np.count_nonzero(kept & ~is_part))
        inner = concatenate([inner.select(np.flatnonzero(kept)), halves[0]])
        parent = np.concatenate([parent[kept], parent[found.rows]])
    return CutObject(inner, parent, len(inner) - n_whole, concatenate(off), np.concatenate(off_parent))
