"""A study: may a few learned weights decide which Gaussians belong to the object, in place of hand-set rules?

Each Gaussian has a few features, all without a unit; a weighted sum of them gives its log-odds. `learn.py` learns the
weights from scenes with ground truth and compares the decision with the trimmer's own. What came of it, and why it does
not decide yet: docs/decisions/rules.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import training_cameras
from gaussian_trimmer.decomposition.evidence import HIDDEN, INSIDE, OUTSIDE
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray
from gaussian_trimmer.geometry.support_plane import SupportPlane
from gaussian_trimmer.planning.outline_views import views_at_heights
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.scope import Scope
from gaussian_trimmer.trimming.task import Task
from gaussian_trimmer.views import HALF, OCCLUDER_DISTANCE

FEATURES = (
    "bias",
    "selected",
    "label",
    "share",
    "open leak",
    "hidden leak",
    "selected and wide",
    "in the surface",
)
VIEWS, SIZE = 16, 192
"""Small views at four heights, and their width and height in pixels."""
POSSIBLE = 0.15
"""Corrected label from which on a Gaussian is drawn with the object alone, to see what it would show there."""
SEEN_PIXELS = 1.0
"""Blend weight in all views at which a Gaussian counts as half seen."""
SHOWN_PIXELS = 0.5
"""Blend weight in the object alone below which leaks are noise."""
TYPICAL_WIDTH_RADII = 0.05
MAX_LOG_ODDS, MAX_LOG_WIDTH = 4.0, 3.0


@dataclass(frozen=True, eq=False)
class Evidence:
    """Blend weights of L Gaussians, summed over the views."""

    inside: FloatArray
    """In the whole scene, inside the silhouettes of the corrected labels, (L,)."""
    outside: FloatArray
    """In the whole scene, outside them, (L,)."""
    alone: FloatArray
    """In the object alone: outside, inside, and outside where something nearer hides that in the scene, (L, 3)."""


def weigh(task: Task, scope: Scope, label: FloatArray, renderer: Renderer) -> Evidence:
    """What small views show of the Gaussians of a scope with corrected labels (L,)."""
    rows = np.flatnonzero(scope.selected | (label > POSSIBLE))
    isolated = scope.local.select(rows)
    seen, alone = np.zeros((len(label), 2), np.float32), np.zeros((len(label), 3), np.float32)
    for camera in views_at_heights(scope.bounds, scope.cameras, training_cameras(task.cameras), VIEWS, SIZE):
        nearest = renderer.render(scope.local, camera).depth
        mask = renderer.blend_values(scope.local, camera, label[:, None])[..., 0] > HALF
        seen += renderer.blend_weights(scope.local, camera, mask.astype(np.uint8), 2)
        depth = renderer.render(isolated, camera).depth
        nearer = (nearest > 0) & (nearest < depth - OCCLUDER_DISTANCE * scope.bounds.radius)
        sides = np.where(mask, np.uint8(INSIDE), np.where(nearer, np.uint8(HIDDEN), np.uint8(OUTSIDE)))
        alone[rows] += renderer.blend_weights(isolated, camera, sides, 3)
    return Evidence(seen[:, INSIDE], seen[:, OUTSIDE], alone)


def features(scope: Scope, label: FloatArray, plane: SupportPlane | None, evidence: Evidence) -> Float64Array:
    """The features of each Gaussian of a scope, in the order of `FEATURES`, (L, F)."""
    sign = np.where(scope.selected, 1.0, -1.0)
    seen = evidence.inside.astype(np.float64) + evidence.outside
    share = np.divide(evidence.inside, seen, out=np.full_like(seen, HALF), where=seen > 0) - HALF
    shown = evidence.alone.sum(axis=1) + SHOWN_PIXELS
    odds = np.log((label + 1e-3) / (1 - label + 1e-3))
    # What the scene shows outside the masks was counted by the share: large Gaussians leak over every edge.
    leak = np.maximum(evidence.alone[:, OUTSIDE] - evidence.outside, 0) / shown
    width = scope.local.log_scales.max(axis=1) - np.log(TYPICAL_WIDTH_RADII * scope.bounds.radius)
    columns = [
        np.ones_like(sign),
        sign,
        np.clip(odds, -MAX_LOG_ODDS, MAX_LOG_ODDS),
        share * seen / (seen + SEEN_PIXELS),
        leak,
        evidence.alone[:, HIDDEN] / shown,
        sign * np.clip(width, -MAX_LOG_WIDTH, MAX_LOG_WIDTH),
        np.zeros(len(sign)) if plane is None else plane.on_surface.astype(np.float64),
    ]
    return np.stack(columns, axis=1)


def likely(values: FloatArray, weights: Float64Array) -> BoolArray:
    """Which Gaussians are more likely the object's than not, by their features (L, F) and learned weights (F,)."""
    return np.asarray(values @ weights > 0)
