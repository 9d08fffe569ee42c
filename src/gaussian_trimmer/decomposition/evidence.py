"""Which Gaussians the views of the whole scene give to the object, by what they show: keep, prune, recover.

Centres mislead: a Gaussian whose centre lies inside a mask may show mostly outside of it. What counts here is the blend
weight that a Gaussian has inside and outside the masks, summed over the views. The sums do not depend on the order of
views or Gaussians. They are in pixels of five views of 512 x 512, so that thresholds hold for any number and size of
views.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.rendering import Renderer, parallel_map
from gaussian_trimmer.scope import Scope
from gaussian_trimmer.settings import Share, Weight
from gaussian_trimmer.views import MIN_SEEN_PIXELS, TrimmedView, to_reference

_UNDECIDED_SHARE = 0.5
"""Share inside the masks, and probability, that speak neither for the object nor against it."""


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


def find_members(
    scope: Scope,
    probability: FloatArray,
    accepted: Sequence[TrimmedView],
    renderer: Renderer,
    config: EvidenceConfig,
) -> BoolArray:
    """Which Gaussians belong to the object by the evidence of the whole scene, (L,).

    Args:
        scope: the object and the Gaussians around it, L of them.
        probability: their corrected labels, (L,).
        accepted: views whose masks were accepted.
        renderer: gives blend weights.
        config: thresholds.
    """

    def weighed(trimmed: TrimmedView) -> FloatArray:
        weights = renderer.blend_weights(scope.shown, trimmed.view.camera, trimmed.mask.astype(np.uint8), 2)
        return weights[: len(scope.local)]

    weights = list(parallel_map(weighed, accepted, using=[renderer]))
    outside, inside = to_reference(np.sum(weights, axis=0), scope.cameras).T
    return classify_gaussians(inside, outside, probability, scope.selected, config)


def classify_gaussians(
    inside: FloatArray, outside: FloatArray, probability: FloatArray, selection: BoolArray, config: EvidenceConfig
) -> BoolArray:
    """Which Gaussians belong to the object according to their blend weights in the views, (N,).

    Args:
        inside: blend weight inside the masks, summed over the accepted views, (N,).
        outside: blend weight outside them, (N,).
        probability: the corrected label, (N,); it alone decides for Gaussians that no view shows.
        selection: what is selected, (N,). What is outside of it joins only if the masks show it, so that a corrected
            label that no picture supports adds nothing.
        config: thresholds.
    """
    total = inside + outside
    share = np.divide(inside, total, out=np.full_like(total, _UNDECIDED_SHARE), where=total > 0)
    label = np.where(selection, probability, _UNDECIDED_SHARE * probability)
    support = share - _UNDECIDED_SHARE + config.prior * (label - _UNDECIDED_SHARE)
    supported = np.where(total > MIN_SEEN_PIXELS, support, label - _UNDECIDED_SHARE) > 0
    return supported & (selection | (probability > config.recover_limit)) if config.recover else supported & selection
