"""What follows once it is decided what belongs to the object: clean the background, fit the outline, fill the hole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gaussian_trimmer.cameras import training_cameras
from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.decomposition.filling import fill_hole, without_what_shows
from gaussian_trimmer.decomposition.fit_target import resized_mask
from gaussian_trimmer.decomposition.ghosts import clean_background
from gaussian_trimmer.decomposition.refinement import refine
from gaussian_trimmer.decomposition.splitting import Decomposition
from gaussian_trimmer.gaussians import FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.planning.outline_views import close_up_of, views_at_heights
from gaussian_trimmer.planning.place_views import views_of_place
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.scope import Scope
from gaussian_trimmer.segmentation.segmenters import knows_outlines
from gaussian_trimmer.trimming.assembly import Assembly
from gaussian_trimmer.trimming.task import Task
from gaussian_trimmer.views import TrimmedView

_MIN_SURFACE_WEIGHT = 0.5
"""Blend weight in pixels of the default views from which on a Gaussian of a surface counts as seen."""


def clean(
    scope: Scope, parts: Decomposition, visible: FloatArray, renderer: Renderer, config: TrimConfig
) -> tuple[Decomposition, IntArray]:
    """The decomposition with what the background must not have, and the rows of the scene that nobody gets."""
    plane = scope.support_plane(parts.members, visible, config.label_crf.support_plane)
    cameras = views_of_place(scope.bounds)
    cleaning = clean_background(scope.local, parts.members, scope.bounds, plane, cameras, renderer)
    joins = cleaning.to_object if config.evidence.recover else cleaning.to_object & scope.selected
    return replace(parts, members=parts.members | (joins & ~scope.excluded)), scope.rows[cleaning.dropped]


def fit_outline(task: Task, scope: Scope, assembly: Assembly, accepted: Sequence[TrimmedView]) -> Assembly:
    """The same object with its outline fitted, unless the views forbid it.

    Views from given cameras are fitted to their masks if these know more of the outline than the scene does, and else
    to what the labels show there. Without given cameras small views from several heights are fitted to the labels.
    """
    settings, n, masks = task.config.refinement, len(assembly.object), None
    if task.view_cameras:
        some = accepted[:: max(1, len(accepted) // settings.views)]
        close = [close_up_of(trimmed.view.camera, scope.bounds, settings.size) for trimmed in some]
        cameras = [camera for camera, _ in close]
        if knows_outlines(task.plug_ins.given_segmenter):
            masks = [resized_mask(v.mask[part], camera) for v, (camera, part) in zip(some, close, strict=True)]
    else:
        known = training_cameras(task.cameras)
        cameras = views_at_heights(scope.bounds, scope.cameras, known, settings.views, settings.size)
    others = ~np.isin(scope.rows, assembly.source_index[:n]) & ~np.isin(scope.rows, assembly.dropped)
    around = concatenate([scope.local.select(others), assembly.outside_parts])
    return assembly.with_fit(refine(assembly.object, around, cameras, masks, scope.bounds.radius, settings))


def fill(
    scope: Scope, parts: Decomposition, dropped: IntArray, visible: FloatArray, renderer: Renderer, config: TrimConfig
) -> Gaussians:
    """New Gaussians that close the hole which the object leaves in the plane that it stands on; perhaps none."""
    plane = scope.support_plane(parts.members, visible, config.label_crf.support_plane)
    if plane is None:
        return scope.local.select(np.zeros(0, np.int64))
    left = ~np.isin(scope.rows, dropped)
    surface = plane.on_surface & ~parts.members & left & (visible > _MIN_SURFACE_WEIGHT)
    filled = fill_hole(scope.local, parts.members, surface, scope.bounds, plane, renderer)
    cameras = views_of_place(scope.bounds)
    return without_what_shows(filled, scope.local.select(left), parts.members[left], cameras, renderer)
