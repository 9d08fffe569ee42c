"""Do no harm: which masks are believed, and when the coarse selection comes back as it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.settings import Range, Share
from gaussian_trimmer.views import TrimmedView, View


@dataclass(frozen=True)
class AcceptConfig:
    """When a view's mask is believed, and when the whole trim is."""

    least_overlap: Share = 0.6
    """Smallest intersection over union of a mask with the silhouette that the corrected labels expect."""
    least_silhouette: Annotated[int, Range(0, 1 << 26)] = 64
    """Smallest expected silhouette in pixels; less of the object cannot be judged."""
    least_views: Share = 0.4
    """Smallest share of views that must be accepted for the trim to stand."""
    least_remaining: Share = 0.4
    """Smallest share of what the selection shows that must remain of it."""


def accept(views: Sequence[View], masks: Sequence[BoolArray], config: AcceptConfig) -> list[TrimmedView]:
    """Pair views and masks, with the reason where a mask is not believed."""
    judged = []
    for view, mask in zip(views, masks, strict=True):
        expected = view.expected > 0.5
        size = int(np.count_nonzero(expected))
        overlap = int(np.count_nonzero(mask & expected)) / max(int(np.count_nonzero(mask | expected)), 1)
        reason = ""
        if size < config.least_silhouette:
            reason = f"the object is expected in only {size} pixels"
        elif overlap < config.least_overlap:
            reason = f"the mask overlaps the expected silhouette by {overlap:.2f}; {config.least_overlap} is needed"
        judged.append(TrimmedView(view, mask, reason))
    return judged


def refusal(judged: Sequence[TrimmedView], config: AcceptConfig) -> str:
    """Why the coarse selection must stay as it is; empty if the views suffice."""
    accepted = sum(not view.rejected for view in judged)
    if accepted >= max(1.0, config.least_views * len(judged)):
        return ""
    reasons = "; ".join(sorted({view.rejected for view in judged if view.rejected}))
    return f"only {accepted} of {len(judged)} views were accepted ({reasons})"


def harm(coarse: BoolArray, keep: BoolArray, visible: FloatArray, config: AcceptConfig) -> str:
    """Why labels that leave too little of the selection must not stand; empty if they may.

    Args:
        coarse: the coarse selection, (N,).
        keep: what would be the object, (N,).
        visible: how much each Gaussian is seen, (N,).
        config: how much must remain.
    """
    if not keep.any():
        return "no Gaussian was left in the object"
    shown = visible[coarse].sum()
    remaining = float(visible[coarse & keep].sum() / shown) if shown > 0 else 1.0
    if remaining >= config.least_remaining:
        return ""
    return f"only {remaining:.2f} of what the selection shows would remain; {config.least_remaining} is needed"
