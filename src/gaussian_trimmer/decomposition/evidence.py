"""Which Gaussians belong to the object, by what they show in the views: keep, prune, recover.

Centres mislead: a Gaussian whose centre lies inside a mask may show mostly outside of it. What counts here is the blend
weight that a Gaussian has inside and outside the masks, summed over the views. The sums do not depend on the order of
views or Gaussians. They are in pixels of five views of 512 x 512, so that thresholds hold for any number and size of
views.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.settings import Share, Weight

OUTSIDE, INSIDE, HIDDEN = range(3)
"""Columns of blend weights (N, 3): outside the masks, inside them, and outside them where something nearer hides."""
_MIN_SEEN_PIXELS = 1e-3
"""Blend weight above which a Gaussian counts as seen."""
_UNDECIDED_SHARE = 0.5
"""Share inside the masks, and probability, that speak neither for the object nor against it."""
_LARGE_WIDTH_RADII = 0.25
"""Largest standard deviation, in object radii, from which on a Gaussian is judged as large."""
_LARGE_HALO_SHARE = 0.6
"""Share of its blend weight outside the masks from which on a Gaussian as large as that is none of the object."""


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
    second_evidence: bool = True
    """Prune Gaussians by what they show outside the masks when the object is rendered in isolation."""
    isolated_limit: Share = 0.35
    """Largest share of a Gaussian's blend weight in the object in isolation that appears outside the masks and that the
    scene hides."""


def classify_gaussians(
    inside: FloatArray, outside: FloatArray, probability: FloatArray, selection: BoolArray, config: EvidenceConfig
) -> BoolArray:
    """Which Gaussians belong to the object according to the views of the whole scene, (N,).

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
    supported = np.where(total > _MIN_SEEN_PIXELS, support, label - _UNDECIDED_SHARE) > 0
    return supported & (selection | (probability > config.recover_limit)) if config.recover else supported & selection


def find_halo(
    isolated: FloatArray, inside: FloatArray, outside: FloatArray, free_standing: BoolArray, config: EvidenceConfig
) -> BoolArray:
    """Which Gaussians show outside the masks when the object is rendered in isolation, (N,).

    These form the halo below and behind an object: they are hidden in the scene, so the evidence of the whole scene
    cannot classify them. What the scene shows outside the masks is not counted, since that evidence has seen it: large
    Gaussians leak over every edge. Two kinds of Gaussians are not part of the halo, whatever they show outside:

    - Those that show more inside the masks in the scene than outside them in isolation: for example the far wall of a
      hollow object, seen through a hole in a poor selection.
    - Those above the support plane, where something nearer hides them in the scene: the pot behind its plant.

    Args:
        isolated: blend weight in the object in isolation: outside the masks, inside them, and outside them but hidden
            in the scene by something clearly nearer, (N, 3).
        inside: blend weight inside the masks in the views of the whole scene, (N,).
        outside: blend weight outside them in those views, (N,).
        free_standing: what lies above the plane that the object stands on, (N,).
        config: thresholds.
    """
    uncovered = np.maximum(isolated[:, OUTSIDE] + np.where(free_standing, 0, isolated[:, HIDDEN]) - outside, 0)
    total = uncovered + isolated[:, INSIDE]
    return np.asarray((total > _MIN_SEEN_PIXELS) & (uncovered > config.isolated_limit * total) & (uncovered > inside))


def find_large_halo(isolated: FloatArray, inside: FloatArray, widths: FloatArray) -> BoolArray:
    """Which large Gaussians show mostly outside the masks when the object is rendered in isolation, (N,).

    Large Gaussians leak over every edge, and what hides their leak in the scene is gone when the object is shown alone.
    `find_halo` excuses what the scene shows outside the masks and what something nearer hides; one whose
    standard deviation is a quarter of the object's radius, and of which most is outside, spoils every picture of it.

    Args:
        isolated: as in `find_halo`, (N, 3).
        inside: blend weight inside the masks in the views of the whole scene, (N,).
        widths: largest standard deviation of each Gaussian, in object radii, (N,).
    """
    outside = isolated[:, OUTSIDE] + isolated[:, HIDDEN]
    mostly = (outside > _MIN_SEEN_PIXELS) & (outside > _LARGE_HALO_SHARE * (outside + isolated[:, INSIDE]))
    return np.asarray((widths > _LARGE_WIDTH_RADII) & mostly & (outside > inside))
