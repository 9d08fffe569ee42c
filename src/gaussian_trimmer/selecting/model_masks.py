"""Clicks and boxes understood by a promptable model, such as the segmenter sam, and carried to the other sides.

The built-in ways find whole objects that stand on something, from all around; a model of pictures also knows what
stands on nothing, and parts that nothing separates from the rest. A lone click says little to it: of a leaf, a plant
and a table it takes any. So a click on what stands on something means that, and the model is asked about other clicks,
and about boxes. Where it sees what the built-in way found, the built-in selection is taken, since it knows the far
side. Otherwise the model's mask is carried on over the surface, and corrected in views around it, in each of which the
model is prompted with what is expected.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.masks.prompts import Prompt, expected_logits
from gaussian_trimmer.masks.sam_onnx import Candidates
from gaussian_trimmer.rendering import render
from gaussian_trimmer.selecting.clicks import NothingFoundError, Pick, select_by_box, select_by_click
from gaussian_trimmer.selecting.lifting import lift_by_assignment
from gaussian_trimmer.selecting.propagation import propagate_mask
from gaussian_trimmer.selecting.segment_in_box import fills
from gaussian_trimmer.surface.viewed_scene import ViewedScene
from gaussian_trimmer.views.view import HALF, Box, bounding_box, mask_overlap
from gaussian_trimmer.views.virtual_cameras import PlanConfig, plan_cameras

_SAME_OVERLAP = 0.75
"""Intersection over union from which on the model and the built-in way mean the same."""
_MIN_AGREEMENT_OVERLAP = 0.5
"""The same, of a mask in another view and what is expected there, below which the view is left out."""
_MIN_BOX_OVERLAP = 0.5
"""Intersection over union of the user's box and a mask's bounding box, below which the mask is of something else."""
_CORRECTION_VIEWS = 4
"""Views around the object in which a part is corrected."""


class PromptableModel(Protocol):
    """What draws masks for prompts; `SamSegmenter` does."""

    def propose(self, rgb: FloatArray, prompt: Prompt) -> Candidates:
        """Return masks for a prompt in a picture (H, W, 3)."""
        ...


def select_by_model(scene: ViewedScene, mark: tuple[int, int] | Box, model: PromptableModel) -> Pick:
    """Return what a pixel (x, y), or a box (x0, y0, x1, y1), of a view means to a model.

    Raises:
        InputError: the mark is outside the picture, nothing is seen or can be told apart there, or the model cannot be
            run.
    """
    built_in = _built_in(scene, mark)
    if built_in is not None and len(mark) == 2:
        return built_in
    nothing = np.zeros(len(scene.gaussians), np.bool_)
    part = _part_seen(scene, mark, nothing if built_in is None else built_in.selection, model)
    if part is not None:
        return Pick(part, "part")
    if built_in is None:
        raise NothingFoundError(
            "Neither the surface nor the model tells what is meant there; mark it in another view, or draw the box "
            "close around it."
        )
    return built_in


def _built_in(scene: ViewedScene, mark: tuple[int, int] | Box) -> Pick | None:
    """Return what is found without the model, if anything."""
    try:
        return select_by_click(scene, *mark) if len(mark) == 2 else select_by_box(scene, mark)
    except NothingFoundError:
        return None


def _part_seen(
    scene: ViewedScene, mark: tuple[int, int] | Box, built_in: BoolArray, model: PromptableModel
) -> BoolArray | None:
    """Return what the model sees at the mark, on all of its sides, (N,).

    None if the built-in way found the same, or shows better what is meant.
    """
    box = mark if len(mark) == 4 else None
    picture, silhouette = render(scene.gaussians, scene.camera), scene.coverage(built_in) > HALF
    mask = _mask_of(model.propose(picture.rgb, _prompt(mark)), box)
    if not mask.any() or mask_overlap(mask, silhouette) >= _SAME_OVERLAP:
        return None
    whole = propagate_mask(scene, picture, mask)
    if not whole.any():
        return None
    part = _corrected(scene, whole, mask, model)
    # What was carried around must still show the mask in the user's own view, and fill the box, and both better than
    # the built-in selection does.
    seen = scene.coverage(part) > HALF
    worse = mask_overlap(seen, mask) <= mask_overlap(silhouette, mask)
    if worse or (box is not None and fills(seen, box) <= fills(silhouette, box)):
        return None
    return part


def _prompt(mark: tuple[int, int] | Box) -> Prompt:
    if len(mark) == 4:
        return Prompt(mark)
    return Prompt(points=np.array([mark], np.float64) + 0.5, inside=np.ones(1, np.bool_))


def _mask_of(found: Candidates, box: Box | None) -> BoolArray:
    """Choose the one of the model's masks that fills the box, empty if none does; without a box the best one."""
    masks = found.logits > 0
    if box is None:
        return np.asarray(masks[int(np.argmax(found.scores))])
    fits = np.array([fills(mask, box) for mask in masks])
    best = int(np.argmax(fits * found.scores))
    return np.asarray(masks[best]) & bool(fits[best] >= _MIN_BOX_OVERLAP)


def _corrected(scene: ViewedScene, selection: BoolArray, mask: BoolArray, model: PromptableModel) -> BoolArray:
    """Correct a selection (N,) by the model's masks in views around it, and by that of the user's own view, (H, W)."""
    gaussians = scene.gaussians
    plan = PlanConfig(views=_CORRECTION_VIEWS)
    around, _ = plan_cameras(gaussians.select(selection), scene.up, plan, list(scene.seen_from))
    cameras, masks = [scene.camera], [mask]
    for camera in around:
        expected = replace(scene, camera=camera).coverage(selection)
        if not (expected > HALF).any():
            continue
        prompt = Prompt(bounding_box(expected > HALF), logits=expected_logits(expected))
        found = model.propose(render(gaussians, camera).rgb, prompt).logits > 0
        best = max(found, key=lambda mask: mask_overlap(mask, expected > HALF))
        if mask_overlap(best, expected > HALF) >= _MIN_AGREEMENT_OVERLAP:
            cameras.append(camera)
            masks.append(best)
    lifted = lift_by_assignment(gaussians, cameras, masks)
    return lifted if lifted.any() else selection
