"""Pieces that stand on the support plane and touch the object."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray
from gaussian_trimmer.geometry.components import connected_points
from gaussian_trimmer.geometry.support_plane import SupportPlane, SupportPlaneConfig


def attached_to_object(
    positions: FloatArray,
    labels: BoolArray,
    weights: Float64Array,
    plane: SupportPlane,
    gap: float,
    reach: float,
    config: SupportPlaneConfig,
) -> BoolArray:
    """Gaussians that are not labelled as object but belong to a piece that may be the object's, (N,).

    A piece is what lies above the plane and is connected by short steps. It may be the object's if some of it is
    labelled so and all of it lies within the bounds of what is labelled, so that the selection has every end of it: a
    lawn that touches a plant, or a robot of which an arm was selected, reaches beyond them.

    Args:
        positions: centres divided by the object's radius, (N, 3).
        labels: the labels so far, (N,).
        weights: how visible each Gaussian is, (N,).
        plane: the plane that the object stands on.
        gap: largest step within a piece, in object radii.
        reach: how far a piece may lie outside the bounds of the selection, in object radii.
        config: what counts as a piece.
    """
    attached = np.zeros(len(labels), np.bool_)
    rows = np.flatnonzero(plane.above)
    if len(rows) == 0:
        return attached
    piece = connected_points(positions[rows].astype(np.float64), gap)
    near = _within_bounds(positions[rows], positions[labels], reach)
    selected, total = np.bincount(piece, weights[rows] * labels[rows]), np.bincount(piece, weights[rows])
    within = np.bincount(piece, weights[rows] * near) >= config.min_within_bounds * total
    attached[rows] = (within & (selected > config.min_selected * total))[piece] & ~labels[rows]
    return attached


def _within_bounds(positions: FloatArray, selected: FloatArray, margin: float) -> BoolArray:
    """Which positions (N, 3) lie in the box of the selected ones (M, 3), widened by a margin, (N,)."""
    if len(selected) == 0:
        return np.zeros(len(positions), np.bool_)
    low, high = selected.min(axis=0) - margin, selected.max(axis=0) + margin
    return np.asarray(((positions >= low) & (positions <= high)).all(axis=1))
