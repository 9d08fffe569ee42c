"""Clicks and boxes understood by a promptable model, such as the segmenter sam, and carried to the other sides.

The built-in ways find whole objects that stand on something, from all around; a model of pictures also knows what
stands on nothing, and parts that nothing separates from the rest. A lone click says little to it: of a leaf, a plant
and a table it takes any. So a click on what stands on something means that, and the model is asked about other clicks,
and about boxes. Where it sees what the built-in way found, the built-in selection is taken, since it knows the far
side. Otherwise the model's mask is carried on over the surface, and corrected in views around it, in each of which the
model is prompted with what is expected.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians
from gaussian_trimmer.planning.virtual_cameras import PlanConfig, plan_cameras
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.segmentation.segmenters.prompts import Prompt, expected_logits
from gaussian_trimmer.segmentation.segmenters.sam_onnx import Candidates
from gaussian_trimmer.selecting.clicks import NothingToldApartError, Pick, select_by_box, select_by_clicks
from gaussian_trimmer.selecting.lifting import lift_by_assignment
from gaussian_trimmer.selecting.propagation import propagate_mask
from gaussian_trimmer.views import HALF, Box, bounding_box

_SAME = 0.75
"""Intersection over union from which on the model and the built-in way mean the same."""
_MIN_AGREEMENT = 0.5
"""The same, of a mask in another view and what is expected there, below which the view is left out."""
_MIN_FILLED = 0.5
"""Intersection over union of the user's box and a mask's bounding box, below which the mask is of something else."""
_VIEWS = 4
"""Views around the object in which a part is corrected."""


class PromptableModel(Protocol):
    """What draws masks for prompts; `SamSegmenter` does."""

    def propose(self, rgb: FloatArray, prompt: Prompt) -> Candidates:
        """Masks for a prompt in a picture (H, W, 3)."""
        ...


def select_by_model(
    gaussians: Gaussians,
    camera: Camera,
    marks: Sequence[tuple[int, int]] | Box,
    up: Float64Array,
    renderer: Renderer,
    model: PromptableModel,
    seen_from: Sequence[Camera] = (),
) -> Pick:
    """What clicks, or a box, in a view mean to a model.

    Args:
        gaussians: the scene, N Gaussians.
        camera: the user's view.
        marks: a list of pixels (x, y) on one object, or a box (x0, y0, x1, y1), a tuple of four.
        up: the scene's up vector, (3,).
        renderer: draws the views.
        model: draws masks.
        seen_from: training cameras, if known.

    Raises:
        InputError: the marks are outside the picture, nothing is seen or can be told apart there, or the model cannot
            be run.
    """
    box, refused = _as_box(marks), None
    try:
        if box is not None:
            built_in = select_by_box(gaussians, camera, box, up, renderer, seen_from)
        else:
            built_in = select_by_clicks(gaussians, camera, list(marks), up, renderer, seen_from)  # type: ignore[arg-type]
            if set(built_in.ways) == {"piece"}:
                return built_in
    except NothingToldApartError as error:
        built_in, refused = Pick(np.zeros(len(gaussians), np.bool_), ("colour",)), error
    part = _part_seen(gaussians, camera, marks, built_in.selection, up, renderer, model, seen_from)
    if part is not None:
        return Pick(part, ("part",))
    if refused is not None:
        raise refused
    return built_in


def _part_seen(
    gaussians: Gaussians, camera: Camera, marks: Sequence[tuple[int, int]] | Box, built_in: BoolArray,
    up: Float64Array, renderer: Renderer, model: PromptableModel, seen_from: Sequence[Camera],
) -> BoolArray | None:  # fmt: skip
    """What the model sees at the marks, on all of its sides (N,), if that is something else than the built-in way found
    and shows better what is meant."""
    box, picture = _as_box(marks), renderer.render(gaussians, camera)
    silhouette = shown(gaussians, built_in, camera, renderer) > HALF
    mask = _mask_of(model.propose(picture.rgb, _prompt(marks, box)), box, silhouette)
    if not mask.any() or overlap(mask, silhouette) >= _SAME:
        return None
    whole = propagate_mask(gaussians, camera, picture, mask, up, renderer, seen_from)
    if not whole.any():
        return None
    part = _corrected(gaussians, whole, (camera, mask), up, renderer, model, seen_from)
    # What was carried around must still show the mask in the user's own view, and fill the box, and both better than
    # the built-in selection does.
    seen = shown(gaussians, part, camera, renderer) > HALF
    worse = overlap(seen, mask) <= overlap(silhouette, mask)
    if worse or (box is not None and _box_overlap(seen, box) <= _box_overlap(silhouette, box)):
        return None
    return part


def shown(gaussians: Gaussians, selection: BoolArray, camera: Camera, renderer: Renderer) -> FloatArray:
    """Share of the picture that the selected Gaussians contribute, (H, W)."""
    return renderer.blend_values(gaussians, camera, selection.astype(np.float32)[:, None])[..., 0]


def overlap(a: BoolArray, b: BoolArray) -> float:
    """Intersection over union of two masks (H, W); zero if both are empty."""
    return int(np.count_nonzero(a & b)) / max(int(np.count_nonzero(a | b)), 1)


def _as_box(marks: Sequence[tuple[int, int]] | Box) -> Box | None:
    return tuple(marks) if len(marks) == 4 and np.ndim(marks[0]) == 0 else None  # type: ignore[return-value]


def _prompt(marks: Sequence[tuple[int, int]] | Box, box: Box | None) -> Prompt:
    if box is not None:
        return Prompt(box)
    points = np.array(marks, np.float64).reshape(-1, 2) + 0.5
    return Prompt(points=points, inside=np.ones(len(points), np.bool_))


def _mask_of(found: Candidates, box: Box | None, silhouette: BoolArray) -> BoolArray:
    """Of the model's masks, the one that fills the box, or else the one that the built-in way agrees with; empty if no
    mask fills the box.

    Where none agrees well with the built-in way, the model's own scores decide.
    """
    masks = found.logits > 0
    if box is None:
        same = [overlap(mask, silhouette) for mask in masks]
        best = int(np.argmax(same))
        return np.asarray(masks[best if same[best] >= _SAME else int(np.argmax(found.scores))])
    fits = np.array([_box_overlap(mask, box) for mask in masks])
    best = int(np.argmax(fits * found.scores))
    return np.asarray(masks[best]) & bool(fits[best] >= _MIN_FILLED)


def _box_overlap(mask: BoolArray, box: Box) -> float:
    """Intersection over union of a mask's bounding box and a box; zero for an empty mask."""
    if not mask.any():
        return 0.0
    own = bounding_box(mask)
    width, height = (min(own[i + 2], box[i + 2]) - max(own[i], box[i]) for i in (0, 1))
    areas = [(b[2] - b[0]) * (b[3] - b[1]) for b in (own, box)]
    common = max(width, 0) * max(height, 0)
    return common / max(sum(areas) - common, 1)


def _corrected(
    gaussians: Gaussians, selection: BoolArray, own: tuple[Camera, BoolArray], up: Float64Array, renderer: Renderer,
    model: PromptableModel, seen_from: Sequence[Camera],
) -> BoolArray:  # fmt: skip
    """A selection (N,) by the model's masks in views around it, and by the mask of the user's own view."""
    around, _ = plan_cameras(gaussians.select(selection), up, PlanConfig(views=_VIEWS), list(seen_from))
    cameras, masks = [own[0]], [own[1]]
    for camera in around:
        expected = shown(gaussians, selection, camera, renderer)
        if not (expected > HALF).any():
            continue
        prompt = Prompt(bounding_box(expected > HALF), logits=expected_logits(expected))
        found = model.propose(renderer.render(gaussians, camera).rgb, prompt).logits > 0
        best = max(found, key=lambda mask: overlap(mask, expected > HALF))
        if overlap(best, expected > HALF) >= _MIN_AGREEMENT:
            cameras.append(camera)
            masks.append(best)
    lifted = lift_by_assignment(gaussians, cameras, masks, renderer)
    return lifted if lifted.any() else selection
