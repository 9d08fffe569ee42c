"""Boundary Gaussian Decomposition, the decision: which Gaussians the views give to the object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.decomposition.evidence import (
    HIDDEN,
    INSIDE,
    OUTSIDE,
    EvidenceConfig,
    classify_gaussians,
    find_halo,
    find_large_halo,
)
from gaussian_trimmer.decomposition.underside import find_underside, reaching_into_ground
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray
from gaussian_trimmer.geometry.support_plane import SupportPlane
from gaussian_trimmer.rendering import Renderer, over_views
from gaussian_trimmer.scope import Scope
from gaussian_trimmer.views import OCCLUDER_DISTANCE, TrimmedView, to_reference


@dataclass(frozen=True, eq=False)
class SceneEvidence:
    """What the views of the whole scene say of its L Gaussians: blend weights over all accepted views, (L,) each."""

    inside: FloatArray
    """Inside the masks."""
    outside: FloatArray
    """Outside them."""
    probability: FloatArray
    """The corrected label."""


def weigh_scene(
    scope: Scope, probability: FloatArray, accepted: Sequence[TrimmedView], renderer: Renderer
) -> SceneEvidence:
    """What the accepted views of the whole scene show of each Gaussian.

    Args:
        scope: the object and the Gaussians around it, L of them.
        probability: their corrected labels, (L,).
        accepted: views whose masks were accepted.
        renderer: gives blend weights.
    """

    def weighed(trimmed: TrimmedView) -> FloatArray:
        return renderer.blend_weights(scope.local, trimmed.view.camera, trimmed.mask.astype(np.uint8), 2)

    weights = list(over_views(renderer, weighed, accepted))
    outside, inside = to_reference(np.sum(weights, axis=0), scope.cameras).T
    return SceneEvidence(inside, outside, probability)


def find_members(scope: Scope, evidence: SceneEvidence, config: EvidenceConfig) -> BoolArray:
    """Which Gaussians belong to the object by the evidence of the whole scene, (L,)."""
    return classify_gaussians(evidence.inside, evidence.outside, evidence.probability, scope.selected, config)


@dataclass(frozen=True, eq=False)
class IsolatedObject:
    """M Gaussians that the scene's evidence gives to the object, where nothing else is drawn."""

    rows: IntArray
    """Rows of the scope, (M,)."""
    gaussians: Gaussians
    weights: Sequence[FloatArray]
    """Blend weights in each accepted view, (M, 3). The columns are `evidence.OUTSIDE` and `INSIDE` the mask, and
    `HIDDEN`: outside it, but hidden in the scene by something nearer."""


def weigh_isolated(
    scope: Scope, members: BoolArray, accepted: Sequence[TrimmedView], renderer: Renderer
) -> IsolatedObject:
    """What the accepted views show of an object without its surroundings.

    Args:
        scope: the object and the Gaussians around it, L of them.
        members: which of them are the object, (L,).
        accepted: views whose masks were accepted.
        renderer: draws the object and gives blend weights.
    """
    rows = np.flatnonzero(members)
    isolated = scope.local.select(rows)

    def weighed(trimmed: TrimmedView) -> FloatArray:
        camera, nearest_depth = trimmed.view.camera, trimmed.view.depth
        depth = renderer.render(isolated, camera).depth
        occluded = (nearest_depth > 0) & (nearest_depth < depth - OCCLUDER_DISTANCE * scope.bounds.radius)
        labels = np.where(trimmed.mask, np.uint8(INSIDE), np.where(occluded, np.uint8(HIDDEN), np.uint8(OUTSIDE)))
        return renderer.blend_weights(isolated, camera, labels, 3)

    return IsolatedObject(rows, isolated, list(over_views(renderer, weighed, accepted if len(rows) else ())))


def prune_halo(
    scope: Scope,
    isolated: IsolatedObject,
    evidence: SceneEvidence,
    plane: SupportPlane | None,
    config: EvidenceConfig,
) -> BoolArray:
    """The object without what spoils it in isolation, (L,).

    Args:
        scope: the object and the Gaussians around it, L of them.
        isolated: the object so far.
        evidence: what the whole scene says.
        plane: what the object stands on, if anything.
        config: thresholds.
    """
    members, rows = np.zeros(len(scope.rows), np.bool_), isolated.rows
    if not len(rows):
        return members
    free = plane.above[rows] if plane else np.ones(len(rows), np.bool_)
    alone = to_reference(np.sum(isolated.weights, axis=0), scope.cameras)
    widths = np.exp(isolated.gaussians.log_scales.max(axis=1) - np.log(scope.bounds.radius))
    inside = evidence.inside[rows]
    halo = find_halo(alone, inside, evidence.outside[rows], free, config) | find_large_halo(alone, inside, widths)
    members[rows[~halo]] = True
    return members


def prune_underside(
    scope: Scope, members: BoolArray, plane: SupportPlane, low_cameras: Sequence[Camera], renderer: Renderer
) -> BoolArray:
    """The members without what hangs below the object, as it is seen from just above the plane, (L,)."""
    in_ground = reaching_into_ground(scope.local, members, scope.bounds, plane)
    return members & ~find_underside(scope.local, members, in_ground, low_cameras, renderer)
