"""Judging every Gaussian by what it shows in the views: keep, prune, recover.

Centres lie: a Gaussian whose centre is inside a mask may paint mostly outside of it. What counts here is the blend
weight that a Gaussian puts inside and outside the masks, summed over views. Sums do not depend on the order of views
or Gaussians.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.settings import Share, Weight

_SEEN = 1e-3


@dataclass(frozen=True)
class EvidenceConfig:
    """When a Gaussian belongs to the object."""

    prior: Weight = 1.0
    """Weight of the corrected label beside the share of blend weight inside the masks; 0: the masks alone decide."""
    recover: bool = True
    """Whether Gaussians outside the coarse selection may join the object."""
    recover_limit: Share = 0.3
    """Least corrected label of a Gaussian that joins: what is only seen through the object must not."""
    second_evidence: bool = True
    """Whether a Gaussian is pruned for what it shows outside the masks when the object is rendered alone."""
    alone_limit: Share = 0.5
    """Largest share outside the masks, in the object rendered alone, of a Gaussian that the scene shows as well."""
    hidden_limit: Share = 0.3
    """The same for a Gaussian that no view of the scene shows."""


def judge(
    inside: FloatArray, outside: FloatArray, probability: FloatArray, coarse: BoolArray, config: EvidenceConfig
) -> BoolArray:
    """Which Gaussians the views of the whole scene support as object, (N,).

    Args:
        inside: blend weight inside the masks, summed over the accepted views, (N,).
        outside: blend weight outside them, (N,).
        probability: the corrected coarse label, (N,); it alone decides for Gaussians that no view shows.
        coarse: the coarse selection, (N,).
        config: thresholds.
    """
    total = inside + outside
    share = np.divide(inside, total, out=np.full_like(total, 0.5), where=total > 0)
    supported = np.where(total > _SEEN, share - 0.5 + config.prior * (probability - 0.5), probability - 0.5) > 0
    return supported & (coarse | (probability > config.recover_limit)) if config.recover else supported & coarse


def shows_outside(
    alone: FloatArray, inside: FloatArray, outside: FloatArray, free_standing: BoolArray, config: EvidenceConfig
) -> BoolArray:
    """Which Gaussians paint beside the object when it is rendered alone, (N,).

    These are the halo under and behind an object: hidden in the scene, so that the first evidence cannot judge them.
    Two kinds of Gaussians are none of them, however much they paint outside the masks when alone. What the scene shows
    inside the masks more than the object alone shows outside: the far wall of a hollow object, seen through a hole of
    a bad selection. And what stands clear of the surface below but behind something nearer, if the scene shows it
    mostly inside from elsewhere.

    Args:
        alone: blend weight in the object alone: outside the masks, inside, and outside but hidden in the scene by
            something clearly nearer, (N, 3).
        inside: blend weight inside the masks in the views of the whole scene, (N,).
        outside: blend weight outside them in those views, (N,).
        free_standing: what lies above the surface that the object stands on, (N,).
        config: thresholds.
    """
    supported = free_standing & (inside > outside)
    beside = alone[:, 0] + np.where(supported, 0, alone[:, 2])
    total = beside + alone[:, 1]
    limit = np.where(inside + outside > _SEEN, config.alone_limit, config.hidden_limit)
    return np.asarray((total > _SEEN) & (beside > limit * total) & (beside > inside))
