"""Shapes and types of what renderers and segmenters give back, so that a plug-in's mistake is a sentence naming it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray
from gaussian_trimmer.rendering import Renderer, Rendering, is_thread_safe
from gaussian_trimmer.segmentation.segmenters import Segmenter
from gaussian_trimmer.views import HALF_COVERAGE, View


class CheckedRenderer:
    """A renderer whose answers are checked each time before they are used; their values are not changed."""

    def __init__(self, renderer: Renderer) -> None:
        self.name = _name_of(renderer)
        self.thread_safe = is_thread_safe(renderer)
        self._renderer = renderer

    def render(
        self, gaussians: Gaussians, camera: Camera, background: FloatArray | None = None, weights: bool = False
    ) -> Rendering:
        """See `rendering.Renderer.render`."""
        rendering = self._renderer.render(gaussians, camera, background, weights)
        shape = (camera.height, camera.width)
        self._check("render(...).rgb", getattr(rendering, "rgb", None), (*shape, 3))
        self._check("render(...).alpha", getattr(rendering, "alpha", None), shape)
        self._check("render(...).depth", getattr(rendering, "depth", None), shape)
        if weights:
            self._check("render(..., weights=True).weights", getattr(rendering, "weights", None), (len(gaussians),))
        return rendering

    def blend_values(self, gaussians: Gaussians, camera: Camera, values: FloatArray) -> FloatArray:
        """See `rendering.Renderer.blend_values`."""
        blended = self._renderer.blend_values(gaussians, camera, values)
        self._check("blend_values", blended, (camera.height, camera.width, values.shape[1]))
        return blended

    def blend_weights(
        self, gaussians: Gaussians, camera: Camera, labels: NDArray[np.uint8], n_labels: int
    ) -> FloatArray:
        """See `rendering.Renderer.blend_weights`."""
        weights = self._renderer.blend_weights(gaussians, camera, labels, n_labels)
        self._check("blend_weights", weights, (len(gaussians), n_labels))
        return weights

    def top_contributors(
        self, gaussians: Gaussians, camera: Camera, pixels: IntArray, k: int
    ) -> tuple[IntArray, FloatArray]:
        """See `rendering.Renderer.top_contributors`."""
        found = self._renderer.top_contributors(gaussians, camera, pixels, k)
        rows, weights = found if isinstance(found, tuple) and len(found) == 2 else (found, None)
        self._check("top_contributors (rows)", rows, (len(pixels), k), np.integer)
        self._check("top_contributors (weights)", weights, (len(pixels), k))
        return rows, weights

    def _check(self, what: str, array: Any, shape: tuple[int, ...], kind: type[Any] = np.floating) -> None:
        if not isinstance(array, np.ndarray) or array.shape != shape or not np.issubdtype(array.dtype, kind):
            given = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
            raise InputError(
                f"The renderer '{self.name}' gave {given} from {what}; a NumPy array of {kind.__name__} {shape} is "
                "needed."
            )


class CheckedSegmenter:
    """A segmenter whose masks are checked and become booleans before they are used.

    Booleans are taken as they are. Of whole numbers, 0 and 1 mean what they say, and 0 to 255 is coverage, cut at
    half: OpenCV's masks of 0 and 255 are such. Other types, floats among them, are refused: whether they are
    probabilities, logits or distances cannot be told.
    """

    def __init__(self, segmenter: Segmenter) -> None:
        self.name = _name_of(segmenter)
        self._segmenter = segmenter

    def segment(self, views: Sequence[View]) -> list[BoolArray]:
        """One mask (H, W) for each view, see `segmenters.Segmenter.segment`.

        Raises:
            InputError: there is not one mask for each view, of its size, of booleans or such whole numbers.
        """
        return _checked_masks(self.name, views, self._segmenter.segment(views))

    def segment_with(self, views: Sequence[View], gaussians: Gaussians, renderer: Renderer) -> list[BoolArray]:
        """The same by the segmenter's `segment_together`, if it has this method.

        Raises:
            InputError: as above.
        """
        together = getattr(self._segmenter, "segment_together", None)
        if together is None:
            return self.segment(views)
        return _checked_masks(self.name, views, together(views, gaussians, renderer))


def _checked_masks(name: str, views: Sequence[View], masks: Any) -> list[BoolArray]:
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


def _name_of(plug_in: Any) -> str:
    """The name that a plug-in states, or that of its class."""
    return str(getattr(plug_in, "name", None) or type(plug_in).__name__)
