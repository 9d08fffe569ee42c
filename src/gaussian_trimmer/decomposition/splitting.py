"""Boundary Gaussian Decomposition, the parts: the object's Gaussians, and both sides of those that are cut."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gaussian_trimmer.decomposition.split_rules import SPLIT_RULES
from gaussian_trimmer.decomposition.straddlers import BoundaryConfig, find_straddlers
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray
from gaussian_trimmer.rendering import Renderer, parallel_map
from gaussian_trimmer.scope import Scope
from gaussian_trimmer.views import TrimmedView, clearly_nearer

_OUTSIDE, _INSIDE, _HIDDEN = range(3)
"""Sides of a mask, and outside of it where something nearer hides the object."""


@dataclass(frozen=True)
class SplitConfig:
    """What is done with Gaussians that straddle the boundary."""

    rule: Literal["plane", "principal_axis", "sagd", "none"] = "none"
    """`plane`: cut at the silhouette; `principal_axis`: eqs. 8 and 9 of the paper; `sagd`: SAGD's single, smaller
    child; `none`: no Gaussian is split."""


@dataclass(frozen=True, eq=False)
class Decomposition:
    """How the L Gaussians of a scope are divided between object and background."""

    members: BoolArray
    """Which ones belong to the object, whole or in part, (L,)."""
    split: IntArray
    """Rows of the scope of those that are cut in two, ascending, (S,)."""
    inner: Gaussians | None = None
    """Their parts inside the object, (S,); None if nothing is cut."""
    outer: Gaussians | None = None
    """Their parts outside it, (S,); None if nothing is cut, or if the rule keeps only one part."""

    def without(self, lost: BoolArray) -> Decomposition:
        """The division after some Gaussians (L,) were taken from the object with all of their parts."""
        kept = ~lost[self.split]
        inner, outer = (part.select(kept) if part is not None else None for part in (self.inner, self.outer))
        return Decomposition(self.members & ~lost, self.split[kept], inner, outer)


def split_boundary(
    scope: Scope,
    members: BoolArray,
    accepted: Sequence[TrimmedView],
    renderer: Renderer,
    boundary: BoundaryConfig,
    config: SplitConfig,
) -> Decomposition:
    """Cut those of the object's Gaussians that straddle its boundary, as it is in isolation.

    Args:
        scope: the object and the Gaussians around it, L of them.
        members: which of them are the object, (L,).
        accepted: views whose masks were accepted.
        renderer: draws the object, and gives the contributors of the contours' pixels.
        boundary: which Gaussians straddle.
        config: the rule that cuts them.
    """
    if config.rule == "none" or not members.any():
        return Decomposition(members, np.zeros(0, np.int64))
    rows = np.flatnonzero(members)
    isolated = scope.local.select(rows)
    radius = scope.bounds.radius
    sides = list(parallel_map(lambda view: _sides(isolated, view, radius, renderer), accepted, using=[renderer]))
    found = find_straddlers(isolated, accepted, sides, renderer, boundary)
    cut = SPLIT_RULES[config.rule](isolated.select(found.rows), found.normals, found.offsets)
    return Decomposition(members, rows[found.rows], *cut)


def _sides(isolated: Gaussians, trimmed: TrimmedView, radius: float, renderer: Renderer) -> FloatArray:
    """Blend weights of an object's Gaussians outside and inside a mask, where nothing nearer hides it, (M, 2)."""
    camera = trimmed.view.camera
    hidden = clearly_nearer(trimmed.view.depth, renderer.render(isolated, camera).depth, radius)
    labels = np.where(trimmed.mask, np.uint8(_INSIDE), np.where(hidden, np.uint8(_HIDDEN), np.uint8(_OUTSIDE)))
    return renderer.blend_weights(isolated, camera, labels, 3)[:, :_HIDDEN]
