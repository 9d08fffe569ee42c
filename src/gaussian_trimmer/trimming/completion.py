"""What follows once it is decided what belongs to the object: fit its outline."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.cameras import training_cameras
from gaussian_trimmer.decomposition.fit_target import resized_mask
from gaussian_trimmer.decomposition.refinement import refine
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.planning.outline_views import close_up_of, views_at_heights
from gaussian_trimmer.scope import Scope
from gaussian_trimmer.segmentation.segmenters import knows_outlines
from gaussian_trimmer.trimming.assembly import Assembly
from gaussian_trimmer.trimming.task import Task
from gaussian_trimmer.views import TrimmedView


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
