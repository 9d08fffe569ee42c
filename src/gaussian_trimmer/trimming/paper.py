"""The paper's order: masks in the views, a split of what straddles their contours, and a vote on all of the parts.

Centres mislead: a Gaussian whose centre lies inside a mask may show mostly outside of it. What counts here is the blend
weight that a Gaussian has inside and outside the masks, summed over the views. The sums do not depend on the order of
views or Gaussians. They are in pixels of five views of 512 x 512, so that thresholds hold for any number and size of
views.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.rendering.tile_renderer import UNDECIDED, label_weights, share_inside
from gaussian_trimmer.trimming.evidence import Decomposition, EvidenceConfig
from gaussian_trimmer.views.view import MIN_SEEN_PIXELS, TrimmedView, visible_weight


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
        selection: what is selected, (N,).
        config: thresholds.
    """
    label = probability - UNDECIDED
    support = share_inside(weights) - UNDECIDED + config.prior * label
    supported = np.where(weights.sum(axis=1) > MIN_SEEN_PIXELS, support, label) > 0
    return supported if config.recover else supported & selection
