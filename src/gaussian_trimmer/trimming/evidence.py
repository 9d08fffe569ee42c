"""Which Gaussians belong to the object, by what they show: in the views of the whole scene, and with the object alone.

Centres mislead: a Gaussian whose centre lies inside a mask may show mostly outside of it. What counts here is the blend
weight that a Gaussian has inside and outside the masks, summed over the views. The sums do not depend on the order of
views or Gaussians. They are in pixels of five views of 512 x 512, so that thresholds hold for any number and size of
views.

Below and behind an object lie Gaussians that the scene hides, and that the evidence of the whole scene cannot tell from
the object's own. Once the object is alone they form a halo around it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.rendering.lifting import UNDECIDED, label_weights, share_inside
from gaussian_trimmer.settings import Share, Weight
from gaussian_trimmer.trimming.alpha_targets import ObjectRender, OutlineViews
from gaussian_trimmer.views.view import MIN_SEEN_PIXELS, TrimmedView, visible_weight


@dataclass(frozen=True)
class EvidenceConfig:
    """When a Gaussian belongs to the object."""

    prior: Weight = 1.0
    """Weight of the corrected label relative to the share of blend weight inside the masks; 0: the masks alone
    decide."""
    recover: bool = True
    """Allow Gaussians outside the selection to join the object."""
    recover_limit: Share = 0.3
    """Smallest corrected label of a Gaussian that joins, so that what is only visible through the object stays out."""
    min_in_place: Share = 0.7
    """Smallest share of what a Gaussian shows of the object alone that must lie where the scene shows the object, too.
    Of others the scene hides too much: they would stick out. 0: all stay."""


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


def vote(
    gaussians: Gaussians,
    parts: Decomposition,
    selection: BoolArray,
    probability: FloatArray,
    views: Sequence[TrimmedView],
    config: EvidenceConfig,
) -> Decomposition:
    """Decide which Gaussians belong to the object by the evidence of the whole scene, and judge the parts of cut ones.

    A Gaussian stays cut if the views show both of its parts, and give the inner one to the object and the outer one to
    the background. All others are whole.

    Args:
        gaussians: what the views show: the N Gaussians to decide on, and what hides them after them.
        parts: which of the N are cut, and their parts.
        selection: what is selected, (N,).
        probability: corrected labels, (N,).
        views: views with their masks, accepted or not.
        config: thresholds.
    """
    pieces = parts.parts_of(gaussians)
    accepted = [trimmed for trimmed in views if not trimmed.rejected]
    cameras = [trimmed.view.camera for trimmed in accepted]
    of_views = list(label_weights(pieces, cameras, [trimmed.mask for trimmed in accepted]))
    sums = visible_weight(of_views, [trimmed.view.camera for trimmed in views])  # (pieces, 2)
    n, n_split = len(selection), len(parts.split)
    n_uncut = len(gaussians) - n_split  # with what hides them
    inner, outer = sums[n_uncut : n_uncut + n_split], sums[n_uncut + n_split :]
    weights = np.empty((n, 2), sums.dtype)
    weights[parts.whole()] = sums[: n - n_split]
    weights[parts.split] = inner + outer if len(outer) else inner
    members = classify_gaussians(weights, probability, selection, config)
    # Of parts, the masks alone decide: the label is that of the whole.
    cut = (selection | members)[parts.split] & (share_inside(inner, MIN_SEEN_PIXELS) > UNDECIDED)
    if len(outer):
        cut &= share_inside(outer, MIN_SEEN_PIXELS) < UNDECIDED
    members[parts.split[cut]] = True
    return replace(parts, members=members).only(cut)


def classify_gaussians(
    weights: FloatArray, probability: FloatArray, selection: BoolArray, config: EvidenceConfig
) -> BoolArray:
    """Decide which Gaussians belong to the object by their blend weights in the views, (N,).

    Args:
        weights: blend weight outside and inside the masks, summed over the accepted views, (N, 2).
        probability: the corrected label, (N,); it alone decides for Gaussians that no view shows.
        selection: what is selected, (N,). What is outside of it joins only if the masks show it, so that a corrected
            label that no picture supports adds nothing.
        config: thresholds.
    """
    label = np.where(selection, probability, UNDECIDED * probability)
    support = share_inside(weights) - UNDECIDED + config.prior * (label - UNDECIDED)
    supported = np.where(weights.sum(axis=1) > MIN_SEEN_PIXELS, support, label - UNDECIDED) > 0
    return supported & (selection | (probability > config.recover_limit)) if config.recover else supported & selection


def prune_halo(gaussians: Gaussians, parts: Decomposition, views: OutlineViews, min_share: float) -> Decomposition:
    """Take from an object the members of which too little is consistent with the scene when the object is alone.

    A pixel is consistent where the scene shows at least half of the opacity that the object has alone, or where a known
    mask has it. Where something clearly nearer than the object hides it, other than the ground, no view can tell, and
    nothing counts. A Gaussian that shows nowhere stays.

    Args:
        gaussians: the object and the Gaussians around it, L of them.
        parts: how these are divided.
        views: where to look from.
        min_share: least share of what a Gaussian shows alone that has to be consistent.
    """
    whole = np.flatnonzero(parts.members & parts.whole())
    inside = [gaussians.select(whole), *([parts.inner] if parts.inner else [])]
    outside = [gaussians.select(~parts.members), *([parts.outer] if parts.outer else [])]
    renders = views.render(concatenate(inside), concatenate(outside))
    weights = np.sum(list(parallel_map(_weights, renders)), axis=0)
    lost = np.zeros(len(gaussians), np.bool_)
    lost[np.concatenate([whole, parts.split])] = weights[:, 0] < min_share * weights[:, 1]
    return parts.without(lost)


def _weights(render: ObjectRender) -> FloatArray:
    """Return blend weights of the object's Gaussians alone: where consistent, and where the view can tell, (M, 2)."""
    counts = ~render.unknown
    return render.alone.weigh(np.stack([render.consistent & counts, counts]).astype(np.float32))
