"""What follows once it is decided what belongs to the object: clean, fit, fill, and put the parts together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.decomposition.filling import fill_hole, without_what_shows
from gaussian_trimmer.decomposition.ghosts import clean_background
from gaussian_trimmer.decomposition.refinement import refine
from gaussian_trimmer.decomposition.soft_coverage import resized_mask
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.planning.outline_views import close_up_of, views_at_heights
from gaussian_trimmer.planning.virtual_cameras import small_views_around
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.result import RowLabel
from gaussian_trimmer.trimming.boundary import Decomposition
from gaussian_trimmer.trimming.scope import Scope, support_plane_of
from gaussian_trimmer.views import TrimmedView

_HEIGHTS = (12.0, 45.0)
"""Pitches in degrees of the small views that look for what stands in the object's place."""
_AROUND, _SMALL = 5, 256
"""Their number at each pitch, and their size in pixels."""
_VISIBLE = 0.5
"""Blend weight in pixels of the default views from which on a Gaussian of a surface counts as seen."""
Rows = tuple[Gaussians, Gaussians, IntArray, NDArray[np.uint8]]
"""Object, outer parts, and source row and label of every output row."""


def clean(
    scope: Scope, parts: Decomposition, visible: FloatArray, renderer: Renderer, config: TrimConfig
) -> tuple[Decomposition, IntArray]:
    """The decomposition with what the background must not have, and the rows of the scene that nobody gets."""
    plane = support_plane_of(scope, parts.keep, visible, config)
    cameras = small_views(scope.bounds)
    cleaning = clean_background(scope.local, parts.keep, scope.bounds, plane, cameras, renderer)
    joins = cleaning.to_object if config.evidence.recover else cleaning.to_object & scope.coarse
    return replace(parts, keep=parts.keep | (joins & ~scope.excluded)), scope.rows[cleaning.dropped]


def small_views(bounds: Bounds) -> list[Camera]:
    """Views from all sides that look for what stands in an object's place."""
    return small_views_around(bounds, _AROUND, _HEIGHTS, _SMALL)


def refine_boundary(
    scope: Scope, rows: Rows, dropped: IntArray, seen: Sequence[TrimmedView], trust: bool, known: Sequence[Camera],
    config: TrimConfig,
) -> tuple[Rows, IntArray, str]:  # fmt: skip
    """All rows, with the object's boundary fitted, the object's rows that are, and why none is, if the views forbid it.

    Views from given cameras that were `seen` are fitted to their masks if these can be trusted to know more than the
    labels show. Else small views from several heights are fitted to what the labels show.
    """
    inner, outer, source, label = rows
    how, n = config.refinement, len(inner)
    masks = None
    if seen:
        some = seen[:: max(1, len(seen) // how.views)]
        close = [close_up_of(trimmed.view.camera, scope.bounds, how.size) for trimmed in some]
        cameras = [camera for camera, _ in close]
        if trust:
            masks = [resized_mask(v.mask[part], camera) for v, (camera, part) in zip(some, close, strict=True)]
    else:
        cameras = views_at_heights(scope.bounds, scope.cameras, known, how.views, how.size)
    others = ~np.isin(scope.rows, source[:n]) & ~np.isin(scope.rows, dropped)
    around = concatenate([scope.local.select(others), outer])
    refined = refine(inner, around, cameras, masks, scope.bounds.radius, how)
    ours = np.where(refined.part, RowLabel.SPLIT_INSIDE, label[refined.parent]).astype(np.uint8)
    source = np.concatenate([source[refined.parent], source[n:]])
    labels = np.concatenate([ours, label[n:]])
    return (refined.object, outer, source, labels), np.flatnonzero(refined.fitted), refined.left


def fill(
    scope: Scope, parts: Decomposition, dropped: IntArray, visible: FloatArray, renderer: Renderer,
    config: TrimConfig,
) -> Gaussians:  # fmt: skip
    """New Gaussians that close the hole which the object leaves in the plane that it stands on; perhaps none."""
    plane = support_plane_of(scope, parts.keep, visible, config)
    if plane is None:
        return scope.local.select(np.zeros(0, np.int64))
    left = ~np.isin(scope.rows, dropped)
    surface = plane.on_surface & ~parts.keep & left & (visible > _VISIBLE)
    filled = fill_hole(scope.local, parts.keep, surface, scope.bounds, plane, renderer)
    cameras = small_views(scope.bounds)
    return without_what_shows(filled, scope.local.select(left), parts.keep[left], cameras, renderer)


def with_filled(source: IntArray, label: NDArray[np.uint8], count: int) -> tuple[IntArray, NDArray[np.uint8]]:
    """Source rows and labels of all output rows, those of filled Gaussians at the end."""
    new = np.full(count, RowLabel.FILLED, np.uint8)
    return np.concatenate([source, np.full(count, -1, np.int64)]), np.concatenate([label, new])


def assemble(
    scene: Gaussians, selection: BoolArray, rows: IntArray, parts: Decomposition | None, dropped: IntArray
) -> Rows:
    """Object, outer parts, and source row and label of every output row.

    Without a decomposition the object is the selection as it was. The dropped rows of the scene are in no part.
    """
    final = selection.copy() if parts is None else np.zeros(len(scene), np.bool_)
    nothing = scene.select(np.zeros(0, np.int64))
    split, inner, outer = np.zeros(0, np.int64), nothing, nothing
    if parts is not None:
        final[rows] = parts.keep
        split, inner, outer = rows[parts.split], parts.inner or nothing, parts.outer or nothing
    whole = final.copy()
    whole[split] = False
    final[dropped] = True
    inside, outside = np.flatnonzero(whole), np.flatnonzero(~final)
    source = np.concatenate([inside, split, outside, split[: len(outer)]])
    label = np.concatenate([
        np.where(selection[inside], RowLabel.KEPT, RowLabel.RECOVERED), np.full(len(split), RowLabel.SPLIT_INSIDE),
        np.where(selection[outside], RowLabel.PRUNED, RowLabel.KEPT), np.full(len(outer), RowLabel.SPLIT_OUTSIDE),
    ]).astype(np.uint8)  # fmt: skip
    return concatenate([scene.select(inside), inner]), outer, source, label
