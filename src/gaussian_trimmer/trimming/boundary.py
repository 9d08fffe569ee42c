"""Boundary Gaussian Decomposition: evidence of the whole scene and of the object alone, then splits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.decomposition.contact import split_at_support_plane
from gaussian_trimmer.decomposition.evidence import classify_gaussians, find_halo, find_large_halo, find_outsiders
from gaussian_trimmer.decomposition.split_rules import SPLIT_RULES
from gaussian_trimmer.decomposition.straddlers import find_straddlers
from gaussian_trimmer.decomposition.underside import find_underside, reaching_into_ground
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.support_plane import SupportPlane
from gaussian_trimmer.planning.virtual_cameras import small_views_from
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.segmentation.view_rendering import OCCLUDER_DISTANCE
from gaussian_trimmer.trimming.scope import Scope, support_plane_of
from gaussian_trimmer.views import TrimmedView, to_reference

_LOW = 8.0
"""Pitch in degrees of the small views that look for what hangs below the object."""
_TINY = 160
"""Their size in pixels."""
Clock = Callable[[str], AbstractContextManager[None]]
"""Measures the time of the stage that it is given the name of."""


@dataclass(frozen=True, eq=False)
class Decomposition:
    """How the Gaussians of a scope are divided between object and background."""

    keep: BoolArray
    """Which ones belong to the object, whole or in part, (L,)."""
    split: IntArray
    """Rows of the scope of those that are cut in two, (S,)."""
    inner: Gaussians | None
    """Their parts inside the object."""
    outer: Gaussians | None
    """Their parts outside it."""


def decompose(
    scope: Scope, probability: FloatArray, accepted: Sequence[TrimmedView], renderer: Renderer, config: TrimConfig,
    clock: Clock,
) -> Decomposition:  # fmt: skip
    """Evidence from the views of the whole scene, evidence from the object in isolation, and splits."""
    with clock("weigh"):
        weights = to_reference(np.sum(_weigh(scope.local, accepted, renderer), axis=0), scope.cameras)
        openly, inside, hidden = weights.T
        outside = openly + hidden
        # Where something hides the object, what little shows of it there says nothing against it.
        told = np.where(scope.coarse, openly, outside) if config.evidence.excuse_hidden else outside
        keep = classify_gaussians(inside, told, probability, scope.coarse, config.evidence)
    rows = np.flatnonzero(keep)
    with clock("prune"):
        isolated = scope.local.select(rows)
        weights = _weigh_isolated(isolated, accepted, scope.bounds.radius, renderer) if len(rows) else []
        if config.evidence.second_evidence and len(rows):
            plane = support_plane_of(scope, keep, inside + outside, config)
            free = plane.above[rows] if plane else np.ones(len(rows), np.bool_)
            alone = to_reference(np.sum(weights, axis=0), scope.cameras)
            widths = np.exp(isolated.log_scales.max(axis=1) - np.log(scope.bounds.radius))
            wrong = find_halo(alone, inside[rows], outside[rows], free, config.evidence)
            wrong |= find_outsiders(alone, inside[rows], told[rows], probability[rows], widths)
            wrong |= find_large_halo(alone, inside[rows], widths)
            keep[rows[wrong]] = False
            if plane is not None:
                keep &= ~_underside(scope, keep, plane, renderer)
    if not keep.any():
        return Decomposition(keep, np.zeros(0, np.int64), None, None)
    with clock("split"):
        cut, inner, outer = _split(isolated, keep[rows], accepted, weights, renderer, config)
        parts = Decomposition(keep, rows[cut], inner, outer)
        if config.split.at_support_plane.enabled and config.evidence.recover:
            parts = _with_splits_at_support_plane(scope, parts, inside + outside, accepted, renderer, config)
    return parts


def _weigh(part: Gaussians, accepted: Sequence[TrimmedView], renderer: Renderer) -> list[FloatArray]:
    """Blend weights outside the mask, inside it, and outside it where something hides the object, (N, 3) each view."""
    weights = []
    for trimmed in accepted:
        labels = np.zeros(trimmed.mask.shape, np.uint8)
        if trimmed.view.hidden is not None:
            labels[trimmed.view.hidden] = 2
        labels[trimmed.mask] = 1
        weights.append(renderer.blend_weights(part, trimmed.view.camera, labels, 3))
    return weights


def _underside(scope: Scope, keep: BoolArray, plane: SupportPlane, renderer: Renderer) -> BoolArray:
    """What hangs below the object, as it is seen from just above the plane, (L,)."""
    cameras = small_views_from(scope.cameras, scope.bounds, _LOW, _TINY)
    in_ground = reaching_into_ground(scope.local, keep, scope.bounds, plane)
    return find_underside(scope.local, keep, in_ground, cameras, renderer)


def _with_splits_at_support_plane(
    scope: Scope, parts: Decomposition, seen: FloatArray, accepted: Sequence[TrimmedView], renderer: Renderer,
    config: TrimConfig,
) -> Decomposition:  # fmt: skip
    """The decomposition, with hidden Gaussians that cross the support plane below the object split there."""
    plane = support_plane_of(scope, parts.keep, seen, config)
    if plane is None:
        return parts
    rows, inner, outer = split_at_support_plane(
        scope.local, parts.keep, seen, plane, scope.bounds, accepted, renderer, config.split.at_support_plane
    )
    allowed = ~scope.excluded[rows]
    rows, inner, outer = rows[allowed], inner.select(allowed), outer.select(allowed)
    keep = parts.keep.copy()
    keep[rows] = True
    # These come first, since they have outer parts under every rule.
    return Decomposition(
        keep, np.concatenate([rows, parts.split]), _joined(inner, parts.inner), _joined(outer, parts.outer)
    )


def _joined(first: Gaussians, second: Gaussians | None) -> Gaussians:
    return first if second is None else concatenate([first, second])


def _weigh_isolated(
    isolated: Gaussians, accepted: Sequence[TrimmedView], radius: float, renderer: Renderer
) -> list[FloatArray]:
    """Blend weights of the object in isolation, (N, 3) for each view.

    The columns are pixels outside the mask, inside it, and outside it but hidden in the scene by something nearer.
    """
    weights = []
    for trimmed in accepted:
        camera, nearest_depth = trimmed.view.camera, trimmed.view.depth
        depth = renderer.render(isolated, camera).depth
        occluded = (nearest_depth > 0) & (nearest_depth < depth - OCCLUDER_DISTANCE * radius)
        labels = np.where(trimmed.mask, np.uint8(1), np.where(occluded, np.uint8(2), np.uint8(0)))
        weights.append(renderer.blend_weights(isolated, camera, labels, 3))
    return weights


def _split(
    isolated: Gaussians, keep: BoolArray, accepted: Sequence[TrimmedView], weights: Sequence[FloatArray],
    renderer: Renderer, config: TrimConfig,
) -> tuple[IntArray, Gaussians | None, Gaussians | None]:  # fmt: skip
    """Rows of Gaussians that straddle the boundary of the object in isolation, and their inner and outer parts."""
    if config.split.rule == "none":
        return np.zeros(0, np.int64), None, None
    sides = [weight[:, :2] for weight in weights]
    found = find_straddlers(isolated, accepted, sides, renderer, config.boundary)
    ours = keep[found.rows]
    rows = found.rows[ours]
    return rows, *SPLIT_RULES[config.split.rule](isolated.select(rows), found.normals[ours], found.offsets[ours])
