"""The paper's order: masks in the views, a split of what straddles their contours, and a vote on all of the parts.

Centres mislead: a Gaussian whose centre lies inside a mask may show mostly outside of it. What counts here is the blend
weight that a Gaussian has inside and outside the masks, summed over the views. The sums do not depend on the order of
views or Gaussians. They are in pixels of five views of 512 x 512, so that thresholds hold for any number and size of
views.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, concatenate, mask_of_rows
from gaussian_trimmer.rendering.tile_renderer import UNDECIDED, label_weights, share_inside
from gaussian_trimmer.trimming.clock import Clock
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.evidence import EvidenceConfig
from gaussian_trimmer.trimming.straddlers import CutGaussians, split_straddlers
from gaussian_trimmer.views.view import HALF, MIN_SEEN_PIXELS, TrimmedView, visible_weight


def decide_by_masks(
    gaussians: Gaussians,
    selection: BoolArray,
    probability: FloatArray,
    views: Sequence[TrimmedView],
    config: TrimConfig,
    clock: Clock,
) -> tuple[BoolArray, CutGaussians | None]:
    """Return which Gaussians belong to the object, (N,), by the evidence of the whole scene, and those that are cut.

    A Gaussian stays cut if the views show both of its parts, and give the inner one to the object and the outer one to
    the background. All others are whole.

    Args:
        gaussians: what the views show: the N Gaussians to decide on, and what hides them after them.
        selection: what is selected, (N,).
        probability: corrected labels, (N,).
        views: views with their masks, accepted or not.
        config: which Gaussians are cut, how, and thresholds.
        clock: takes the time of both steps.
    """
    accepted = [trimmed for trimmed in views if not trimmed.rejected]
    with clock("split"):
        cut = split_straddlers(gaussians, selection | (probability > HALF), accepted, config.boundary, config.split)
    with clock("weigh"):
        uncut = ~mask_of_rows(cut.rows, len(gaussians))
        parts = [cut.inner] if cut.outer is None else [cut.inner, cut.outer]
        pieces = concatenate([gaussians.select(uncut), *parts]) if len(cut.rows) else gaussians
        cameras = [trimmed.view.camera for trimmed in accepted]
        of_views = list(label_weights(pieces, cameras, [trimmed.mask for trimmed in accepted]))
        sums = visible_weight(of_views, [trimmed.view.camera for trimmed in views])  # (pieces, 2)
        inner, outer = np.split(sums[np.count_nonzero(uncut) :], [len(cut.rows)])
        weights = np.empty((len(selection), 2), sums.dtype)
        weights[uncut[: len(selection)]] = sums[: len(selection) - len(cut.rows)]
        weights[cut.rows] = inner + outer if len(outer) else inner
        members = classify_gaussians(weights, probability, selection, config.evidence)
        # Of parts, the masks alone decide: the label is that of the whole.
        stays = (selection | members)[cut.rows] & (share_inside(inner, MIN_SEEN_PIXELS) > UNDECIDED)
        if len(outer):
            stays &= share_inside(outer, MIN_SEEN_PIXELS) < UNDECIDED
        members[cut.rows[stays]] = True
        return members, cut.select(stays)


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
