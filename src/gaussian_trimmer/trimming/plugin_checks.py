"""Answers of renderers and segmenters of a caller's own, so that a mistake in one is a sentence naming it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.masks import Segmenter, name_of
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.views.view import HALF_COVERAGE, View

_PIXELS = 16


def check_renderer(renderer: Renderer) -> None:
    """Have a renderer that is not one of this package's draw two Gaussians, and check the answers of all its methods.

    Raises:
        InputError: an answer is not a NumPy array of the shape and type that `rendering.Renderer` asks for.
    """
    if type(renderer).__module__.startswith("gaussian_trimmer."):
        return
    name, shape = name_of(renderer), (_PIXELS, _PIXELS)

    def check(what: str, array: Any, shape: tuple[int, ...], kind: type[Any] = np.floating) -> None:
        if not isinstance(array, np.ndarray) or array.shape != shape or not np.issubdtype(array.dtype, kind):
            given = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
            raise InputError(
                f"The renderer '{name}' gave {given} from {what}; a NumPy array of {kind.__name__} {shape} is needed."
            )

    gaussians, camera = _two_gaussians()
    drawn = renderer.render(gaussians, camera, None, True)
    check("render(...).rgb", getattr(drawn, "rgb", None), (*shape, 3))
    check("render(...).alpha", getattr(drawn, "alpha", None), shape)
    check("render(...).depth", getattr(drawn, "depth", None), shape)
    check("render(..., weights=True).weights", getattr(drawn, "weights", None), (2,))
    check("blend_values", renderer.blend_values(gaussians, camera, np.ones((2, 4), np.float32)), (*shape, 4))
    check("blend_weights", renderer.blend_weights(gaussians, camera, np.zeros(shape, np.uint8), 3), (2, 3))
    pixels = np.array([[_PIXELS // 2] * 2] * 5)
    found: Any = renderer.top_contributors(gaussians, camera, pixels, 3)
    rows, weights = found if isinstance(found, tuple) and len(found) == 2 else (found, None)
    check("top_contributors (rows)", rows, (5, 3), np.integer)
    check("top_contributors (weights)", weights, (5, 3))


def _two_gaussians() -> tuple[Gaussians, Camera]:
    """Return two Gaussians, and a camera that sees them."""
    means = np.array([[0, 0, 2], [0.1, 0, 3]], np.float32)
    rotation = np.array([[1, 0, 0, 0]] * 2, np.float32)
    grey, no_rest = np.zeros((2, 3), np.float32), np.zeros((2, 3, 0), np.float32)
    gaussians = Gaussians(means, np.full((2, 3), -1, np.float32), rotation, np.zeros(2, np.float32), grey, no_rest)
    K = np.array([[_PIXELS, 0, _PIXELS / 2], [0, _PIXELS, _PIXELS / 2], [0, 0, 1.0]])
    return gaussians, Camera(np.eye(4), K, _PIXELS, _PIXELS)


def checked_masks(
    segmenter: Segmenter,
    views: Sequence[View],
    gaussians: Gaussians,
    renderer: Renderer,
    report: Callable[[str], None],
) -> list[BoolArray]:
    """Return a segmenter's mask of each view as booleans, (H, W), by `segment_together` if it has that.

    Booleans are taken as they are. Of whole numbers, 0 and 1 mean what they say, and 0 to 255 is coverage, cut at
    half: OpenCV's masks of 0 and 255 are such. Other types, floats among them, are refused: whether they are
    probabilities, logits or distances cannot be told.

    Args:
        segmenter: what segments.
        views: the views.
        gaussians: what the views show.
        renderer: draws them.
        report: called with the view that the segmenter is at, if it says so.

    Raises:
        InputError: there is not one mask for each view, of its size, of booleans or such whole numbers.
    """
    if hasattr(segmenter, "report_to"):
        segmenter.report_to(report)
    together = getattr(segmenter, "segment_together", None)
    masks = segmenter.segment(views) if together is None else together(views, gaussians, renderer)
    return _as_booleans(name_of(segmenter), views, masks)


def _as_booleans(name: str, views: Sequence[View], masks: Any) -> list[BoolArray]:
    try:
        arrays = [np.asarray(mask) for mask in masks]
    except (TypeError, ValueError, RuntimeError) as error:  # nothing to iterate over, ragged, or on a device
        raise InputError(f"The segmenter '{name}' gave masks that NumPy cannot read ({error}).") from error
    shapes = [(view.camera.height, view.camera.width) for view in views]
    if [array.shape for array in arrays] != shapes:
        given = ", ".join(str(array.shape) for array in arrays) or "none"
        raise InputError(f"The segmenter '{name}' gave masks of the shapes {given}; {len(views)} are needed: {shapes}.")
    numbers = [array for array in arrays if array.dtype != np.bool_]
    if any(array.dtype.kind not in "iu" for array in numbers):
        raise InputError(
            f"The segmenter '{name}' gave masks of {numbers[0].dtype}; booleans are needed (such as 'scores > 0.5'), "
            "or whole numbers: 0 and 1, or coverage from 0 to 255, cut at half."
        )
    # All masks together tell what whole numbers mean.
    lowest = min((int(array.min(initial=0)) for array in numbers), default=0)
    highest = max((int(array.max(initial=0)) for array in numbers), default=0)
    if lowest < 0 or 1 < highest <= HALF_COVERAGE or highest > 255:
        raise InputError(
            f"The segmenter '{name}' gave masks of whole numbers from {lowest} to {highest}; 0 and 1, or coverage from "
            "0 to 255, are needed."
        )
    threshold = 0 if highest <= 1 else HALF_COVERAGE
    return [array if array.dtype == np.bool_ else np.asarray(array > threshold) for array in arrays]
