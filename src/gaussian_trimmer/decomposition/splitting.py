"""Boundary Gaussian Decomposition, the parts: the object's Gaussians, and both sides of those that are cut."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from gaussian_trimmer.decomposition.split_rules import SPLIT_RULES
from gaussian_trimmer.decomposition.straddlers import BoundaryConfig, find_straddlers
from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.views import TrimmedView


@dataclass(frozen=True)
class SplitConfig:
    """What is done with Gaussians that straddle the boundary."""

    rule: Literal["plane", "principal_axis", "sagd", "none"] = "none"
    """`plane`: cut at the silhouette; `principal_axis`: eqs. 8 and 9 of the paper; `sagd`: SAGD's single, smaller
    child; `none`: no Gaussian is split."""


@dataclass(frozen=True, eq=False)
class Decomposition:
    """How L Gaussians are divided between object and background."""

    members: BoolArray
    """Which ones belong to the object, whole or in part, (L,)."""
    split: IntArray
    """Rows of those that are cut in two, ascending, (S,)."""
    inner: Gaussians | None = None
    """Their parts inside the object, (S,); None if nothing is cut."""
    outer: Gaussians | None = None
    """Their parts outside it, (S,); None if nothing is cut, or if the rule keeps only one part."""

    def without(self, lost: BoolArray) -> Decomposition:
        """Return the division after some Gaussians (L,) were taken from the object with all of their parts."""
        return replace(self.only(~lost[self.split]), members=self.members & ~lost)

    def only(self, cut: BoolArray) -> Decomposition:
        """Return the division in which only some of the split ones (S,) are cut."""
        inner, outer = (part.select(cut) if part is not None else None for part in (self.inner, self.outer))
        return Decomposition(self.members, self.split[cut], inner, outer)

    def whole(self) -> BoolArray:
        """Return which Gaussians are not cut, (L,)."""
        whole = np.ones(len(self.members), np.bool_)
        whole[self.split] = False
        return whole

    def parts_of(self, gaussians: Gaussians) -> Gaussians:
        """Return Gaussians, of which the first L are divided, without the split ones, with the parts of these last."""
        kept = np.ones(len(gaussians), np.bool_)
        kept[self.split] = False
        if not len(self.split):
            return gaussians
        return concatenate([gaussians.select(kept), *(p for p in (self.inner, self.outer) if p is not None)])


def split_straddlers(
    gaussians: Gaussians,
    candidates: BoolArray,
    accepted: Sequence[TrimmedView],
    renderer: Renderer,
    boundary: BoundaryConfig,
    config: SplitConfig,
) -> Decomposition:
    """Cut the Gaussians that straddle the outline of the object in the views.

    Args:
        gaussians: what the views show: L Gaussians, of which the first N may be cut.
        candidates: which of these N may be, (N,).
        accepted: views whose masks were accepted.
        renderer: gives blend weights, and the contributors of the contours' pixels.
        boundary: which Gaussians straddle.
        config: the rule that cuts them.

    Returns:
        A division of the N Gaussians of which nothing is decided yet: all candidates are members.
    """
    if config.rule == "none" or not candidates.any():
        return Decomposition(candidates, np.zeros(0, np.int64))
    found = find_straddlers(gaussians, candidates, accepted, renderer, boundary)
    cut = SPLIT_RULES[config.rule](gaussians.select(found.rows), found.normals, found.offsets)
    return Decomposition(candidates, found.rows, *cut)
