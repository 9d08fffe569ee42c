"""Do no harm: which masks are accepted, and when the selection is returned as it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.settings import Share
from gaussian_trimmer.views.view import TrimmedView, View, mask_overlap


@dataclass(frozen=True)
class AcceptanceConfig:
    """When the mask of a view is accepted, and when the trim as a whole is."""

    max_wrong: Share = 0.6
    """Largest share of a mask and the silhouette of the corrected labels together that only one of them has, of the
    views whose masks are rejected, of the object that something nearer hides, and of what the selection shows that is
    removed. 1: whatever the masks say is done."""


def check_masks(
    views: Sequence[View], masks: Sequence[BoolArray], config: AcceptanceConfig, judged: bool = True
) -> list[TrimmedView]:
    """Pair views with their masks, and say of each mask that is rejected why.

    Args:
        views: V views.
        masks: a mask (H, W) for each.
        config: how far a mask may differ from the silhouette of the labels.
        judged: whether masks are held against these silhouettes; there is nothing to judge where they are the masks.
    """
    checked, least = [], 1 - config.max_wrong
    for view, mask in zip(views, masks, strict=True):
        silhouette, reason = view.silhouette, None
        overlap = mask_overlap(mask, silhouette)
        if not silhouette.any():
            reason = "the object is hidden or missing"
        elif judged and overlap < least:
            reason = f"the mask overlaps the expected silhouette by {overlap:.2f}; {least:.2f} is needed"
        checked.append(TrimmedView(view, mask, reason, judged))
    return checked


def rejection(views: Sequence[TrimmedView], config: AcceptanceConfig) -> str | None:
    """Say why the views do not suffice to change the selection; None if they do."""
    accepted = [trimmed.view for trimmed in views if not trimmed.rejected]
    if len(accepted) >= max(1.0, (1 - config.max_wrong) * len(views)):
        hidden = float(np.mean([view.hidden_share for view in accepted]))
        if hidden > config.max_wrong:
            return f"something nearer hides {hidden:.2f} of the object in the views; {config.max_wrong} is allowed"
        return None
    reasons = "; ".join(sorted({view.rejected for view in views if view.rejected}))
    return f"only {len(accepted)} of {len(views)} views were accepted ({reasons})"


def excessive_loss(
    selection: BoolArray, keep: BoolArray, visible: FloatArray, alone: FloatArray, config: AcceptanceConfig
) -> str | None:
    """Say why an object that keeps too little of the selection is refused; None if it keeps enough.

    Args:
        selection: what was selected, (N,).
        keep: what would be the object, (N,).
        visible: how much of each Gaussian the views show, (N,).
        alone: how much of each of the C selected ones they would show if there was nothing else, (C,).
        config: how much must remain.
    """
    if not keep.any():
        return "no Gaussian was left in the object"
    kept = keep[selection]
    remaining = min(
        float(shown[kept].sum() / shown.sum()) if shown.sum() > 0 else 1.0 for shown in (visible[selection], alone)
    )
    least = 1 - config.max_wrong
    if remaining >= least:
        return None
    return f"only {remaining:.2f} of what the selection shows would remain; {least:.2f} is needed"
