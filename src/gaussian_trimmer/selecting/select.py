"""From a list of marks to a selection."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gaussian_trimmer.cameras import CameraSet, Viewpoint
from gaussian_trimmer.gaussians import Gaussians, check_gaussians
from gaussian_trimmer.geometry.limits import check_places
from gaussian_trimmer.selecting.interpretation import apply_marks
from gaussian_trimmer.selecting.marks import Mark, Marks
from gaussian_trimmer.selecting.marks_file import read_marks
from gaussian_trimmer.selecting.model_masks import PromptableModel
from gaussian_trimmer.selecting.selection_result import SelectionResult
from gaussian_trimmer.selecting.view_lookup import resolve_views


def select(
    scene: Gaussians,
    marks: Sequence[Mark] | Marks | str | Path,
    *,
    cameras: CameraSet | None = None,
    up: Any = None,
    views: Sequence[Viewpoint] | None = None,
    model: PromptableModel | None = None,
) -> SelectionResult:
    """Select Gaussians by marks: clicks and boxes in views, volumes, files and masks, in order.

    Args:
        scene: all N Gaussians.
        marks: a list of marks; or marks that were saved, or their file: then `cameras` and `up` are known.
        cameras: the cameras that the scene was trained with, if known. Marks name their views.
        up: the up vector in the scene's coordinates, if known: three numbers, or an axis, "z" or "-y".
        views: the views that marks can name, in place of those of `cameras`, or of planned ones.
        model: draws masks for boxes, and for first clicks where nothing stands on a surface.

    Raises:
        InputError: the coordinates are as large as a map's, a mark is not possible, a view is not known, nothing is
            seen at a pixel, or nothing is selected.
    """
    check_gaussians(scene)
    check_places(scene)
    if isinstance(marks, str | Path):
        marks = read_marks(marks)
    if not isinstance(marks, Marks):
        marks = resolve_views(scene, marks, cameras=cameras, up=up, views=views)
    state = apply_marks(scene, marks, cameras=cameras, model=model)
    return SelectionResult(state.mask, marks, state.interpretations, state.excluded, state.cuts)
