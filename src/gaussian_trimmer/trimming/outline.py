"""Views of an object's outline, and the outline fitted in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.cameras import training_cameras
from gaussian_trimmer.decomposition.coverage import Ground, OutlineViews, resized_mask
from gaussian_trimmer.decomposition.refinement import refine
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.support_plane import SupportPlane
from gaussian_trimmer.planning.outline_views import close_up_of, views_at_heights
from gaussian_trimmer.scope import Scope
from gaussian_trimmer.segmentation.segmenters import knows_outlines
from gaussian_trimmer.trimming.assembly import Assembly
from gaussian_trimmer.trimming.task import Task
from gaussian_trimmer.views import TrimmedView


def outline_views(
    task: Task, scope: Scope, accepted: Sequence[TrimmedView], plane: SupportPlane | None
) -> OutlineViews:
    """Small views of an object: from several heights, or cut out of the views of given cameras.

    The masks of given cameras are known if they know more of the object's outline than the scene does.
    """
    settings, bounds, masks = task.config.refinement, scope.bounds, None
    if task.view_cameras:
        close = [close_up_of(trimmed.view.camera, bounds, settings.size) for trimmed in accepted]
        cameras = [camera for camera, _ in close]
        if knows_outlines(task.plug_ins.given_segmenter):
            masks = [resized_mask(v.mask[part], camera) for v, (camera, part) in zip(accepted, close, strict=True)]
    else:
        known = training_cameras(task.cameras)
        cameras = views_at_heights(bounds, scope.cameras, known, settings.views, settings.size)
    ground = None if plane is None else _ground(bounds, plane)
    return OutlineViews(cameras, masks, bounds.radius, ground, scope.occluders)


def _ground(bounds: Bounds, plane: SupportPlane) -> Ground:
    """What lies deeper below the middle of the plane's layer than the layer is thick."""
    up, top = bounds.axes[2], plane.height - 2 * plane.thickness
    return Ground(up, float(up @ bounds.centre + top * bounds.radius))


def fit_outline(task: Task, scope: Scope, assembly: Assembly, views: OutlineViews) -> Assembly:
    """The same object with its outline fitted to its masks or labels, unless the views forbid it."""
    n = len(assembly.object)
    others = ~np.isin(scope.rows, assembly.source_index[:n]) & ~np.isin(scope.rows, assembly.dropped)
    around = concatenate([scope.local.select(others), assembly.outside_parts])
    return assembly.with_fit(refine(assembly.object, around, views, task.config.refinement))
