"""Boundary Gaussian Decomposition, the parts: the object's Gaussians, and both sides of those that are cut."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gaussian_trimmer.decomposition.evidence import HIDDEN
from gaussian_trimmer.decomposition.membership import IsolatedObject
from gaussian_trimmer.decomposition.split_rules import SPLIT_RULES
from gaussian_trimmer.decomposition.straddlers import BoundaryConfig, find_straddlers
from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray
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
    isolated: IsolatedObject,
    members: BoolArray,
    accepted: Sequence[TrimmedView],
    renderer: Renderer,
    boundary: BoundaryConfig,
    config: SplitConfig,
) -> Decomposition:
    """Cut those of the object's Gaussians that straddle its boundary, as it is in isolation.

    Args:
        isolated: the object before it was pruned.
        members: which Gaussians of the scope are the object, (L,); all are among the isolated ones.
        accepted: views whose masks were accepted.
        renderer: gives the contributors of the contours' pixels.
        boundary: which Gaussians straddle.
        config: the rule that cuts them.
    """
    if config.rule == "none" or not members.any():
        return Decomposition(members, np.zeros(0, np.int64))
    sides = [weight[:, :HIDDEN] for weight in isolated.weights]
    found = find_straddlers(isolated.gaussians, accepted, sides, renderer, boundary)
    ours = members[isolated.rows[found.rows]]
    rows = found.rows[ours]
    cut = SPLIT_RULES[config.rule](isolated.gaussians.select(rows), found.normals[ours], found.offsets[ours])
    return Decomposition(members, isolated.rows[rows], *cut)
