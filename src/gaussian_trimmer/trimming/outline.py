"""Small views of an object's outline, in which it is pruned and fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gaussian_trimmer.cameras import training_cameras
from gaussian_trimmer.decomposition.alpha_targets import OutlineViews, resized_mask
from gaussian_trimmer.geometry.support_plane import SupportPlane
from gaussian_trimmer.planning.outline_views import close_up_of, views_at_heights
from gaussian_trimmer.scene_crop import SceneCrop
from gaussian_trimmer.segmentation.segmenters import knows_outlines
from gaussian_trimmer.trimming.setup import Setup
from gaussian_trimmer.views import TrimmedView


def outline_views(
    setup: Setup, crop: SceneCrop, accepted: Sequence[TrimmedView], plane: SupportPlane | None
) -> OutlineViews:
    """Small views of an object: from several heights, or cut out of the views of given cameras.

    The masks of given cameras are known if they know more of the object's outline than the scene does.
    """
    settings, bounds, masks = setup.config.refinement, crop.bounds, None
    if setup.view_cameras:
        close = [close_up_of(trimmed.view.camera, bounds, settings.size) for trimmed in accepted]
        cameras = [camera for camera, _ in close]
        if knows_outlines(setup.segmenter):
            masks = [resized_mask(v.mask[part], camera) for v, (camera, part) in zip(accepted, close, strict=True)]
    else:
        known = training_cameras(setup.cameras)
        cameras = views_at_heights(bounds, crop.cameras, known, settings.views, settings.size)
    # What lies deeper below the middle of the plane's layer than the layer is thick is below the ground.
    ground = None if plane is None else replace(plane.plane, offset=plane.plane.offset - 2 * plane.thickness)
    return OutlineViews(cameras, masks, bounds.radius, ground, crop.occluders)
