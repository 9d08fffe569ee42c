"""What stands on the supporting surface in one piece with the object."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray
from gaussian_trimmer.geometry.components import connected_points
from gaussian_trimmer.geometry.support_plane import SupportPlane, SupportPlaneConfig


def attached_to_object(
    positions: FloatArray,
    spacing: FloatArray,
    labels: BoolArray,
    weights: Float64Array,
    support: SupportPlane,
    config: SupportPlaneConfig,
) -> BoolArray:
    """Gaussians that are not labelled object but stand in one piece with it, (N,).

    Pieces are what lies above the surface and is connected by steps of at most the gap.

    Args:
        places: centres divided by the object's radius, (N, 3).
        spacing: distance of each from its nearest neighbour, (N,).
        labels: what is labelled object so far, (N,).
        weights: how much each Gaussian is visible, (N,).
        support: the surface.
        config: what counts as a piece.
    """
    attached = np.zeros(len(labels), np.bool_)
    rows = np.flatnonzero(support.above)
    if len(rows) == 0:
        return attached
    gap = max(config.gap, config.gap_spacing * float(np.median(spacing[labels])) if labels.any() else 0.0)
    piece = connected_points(positions[rows].astype(np.float64), gap)
    selected, total = np.bincount(piece, weights[rows] * labels[rows]), np.bincount(piece, weights[rows])
    attached[rows] = (selected > config.min_selected * total)[piece] & ~labels[rows]
    return attached
