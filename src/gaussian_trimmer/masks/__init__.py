"""Masks of an object in pictures: read from files, or drawn in the views that a trim would look from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.masks.grabcut import grabcut_masks
from gaussian_trimmer.masks.sam import SamModel, load_sam, sam_masks
from gaussian_trimmer.trimming.clock import Progress
from gaussian_trimmer.trimming.trim import views_to_segment
from gaussian_trimmer.views.view import ViewMasks


def draw_masks(
    scene: Gaussians,
    selection: Any,
    *,
    sam: SamModel | Path | None = None,
    paper: bool = False,
    progress: Progress = lambda stage: None,
    **given: Any,
) -> ViewMasks | None:
    """Draw the masks of an object that a trim is to use; None if it takes the silhouettes of its own labels.

    Args:
        scene: all N Gaussians.
        selection: the object, roughly, as `trim` takes it.
        sam: a model of the SAM family, or its folder, which draws them.
        paper: whether masks are drawn as in the paper: by the model, followed from the first view, or else by GrabCut.
        progress: called with "segment 2 of 5" when a view begins, if a model draws the masks.
        given: config, cameras, views, view_cameras, up and excluded, as the trim gets them.

    Raises:
        InputError: as for `trim`, or the model cannot be loaded or run.
    """
    if sam is None and not paper:
        return None
    model = load_sam(sam) if isinstance(sam, Path) else sam
    views, shown = views_to_segment(scene, selection, **given)
    if not views:  # the trim says what is wrong with the selection
        return None
    return grabcut_masks(views) if model is None else sam_masks(model, views, shown, paper=paper, progress=progress)
