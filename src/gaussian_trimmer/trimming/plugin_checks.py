"""What renderers and segmenters give back is checked once, here, so that a plug-in's mistake is a sentence naming it.

N Gaussians, V views, H x W pixels. Shapes and types are checked, and of masks the values too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray
from gaussian_trimmer.rendering import Renderer, Rendering
from gaussian_trimmer.segmentation.segmenters import Segmenter
from gaussian_trimmer.views import HALF_COVERAGE, View

_RENDERER_METHODS = ("render", "blend_values", "blend_weights", "top_contributors")


class CheckedRenderer:
    """A renderer whose answers are checked each time before they are used; their values are not changed.

    Raises:
        InputError: the renderer lacks a method of `rendering.Renderer`.
    """

    def __init__(self, renderer: Renderer) -> None:
        self.name = _checked_name("renderer", renderer, _RENDERER_METHODS)
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
        if not isinstance(found, tuple) or len(found) != 2:
            raise InputError(f"The renderer '{self.name}' must give rows and weights from top_contributors.")
        rows, weights = found
        self._check("top_contributors, rows", rows, (len(pixels), k), np.integer, "whole numbers")
        self._check("top_contributors, weights", weights, (len(pixels), k))
        return rows, weights

    def _check(
        self, what: str, array: Any, shape: tuple[int, ...], kind: type[Any] = np.floating, kind_name: str = "floats"
    ) -> None:
        if isinstance(array, np.ndarray) and array.shape == shape and np.issubdtype(array.dtype, kind):
            return
        raise InputError(
            f"The renderer '{self.name}' gave {_described(array)} from {what}; a NumPy array of shape {shape} "
            f"of {kind_name} is needed."
        )


class CheckedSegmenter:
    """A segmenter whose masks are checked and become booleans before they are used.

    Booleans are taken as they are. Of whole numbers, 0 and 1 mean what they say, and 0 to 255 is coverage, cut at
    half: OpenCV's masks of 0 and 255 are such. Other types, floats among them, are refused: whether they are
    probabilities, logits or distances cannot be told.

    Raises:
        InputError: the segmenter has no method `segment`.
    """

    def __init__(self, segmenter: Segmenter) -> None:
        self.name = _checked_name("segmenter", segmenter, ("segment",))
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
        if not callable(together):
            return self.segment(views)
        return _checked_masks(self.name, views, together(views, gaussians, renderer))


def _checked_masks(name: str, views: Sequence[View], masks: Any) -> list[BoolArray]:
    try:
        arrays = [np.asarray(mask) for mask in masks]
    except (TypeError, ValueError, RuntimeError) as error:  # nothing to iterate over, or no array, or one on a device
        raise InputError(
            f"The segmenter '{name}' gave {type(masks).__name__}, which is no sequence of NumPy arrays ({error})."
        ) from error
    if len(arrays) != len(views):
        raise InputError(f"The segmenter '{name}' gave {len(arrays)} masks for {len(views)} views; one each is needed.")
    for number, (view, mask) in enumerate(zip(views, arrays, strict=True)):
        shape = (view.camera.height, view.camera.width)
        if mask.shape != shape:
            raise InputError(
                f"The segmenter '{name}' gave a mask of shape {mask.shape} for view {number}; {shape} is needed."
            )
        if not (mask.dtype == np.bool_ or np.issubdtype(mask.dtype, np.integer)):
            raise InputError(
                f"The segmenter '{name}' gave a mask of type {mask.dtype} for view {number}; booleans are needed "
                "(such as 'scores > 0.5'), or whole numbers: 0 and 1, or coverage from 0 to 255, cut at half."
            )
    return _as_booleans(name, arrays)


def _as_booleans(name: str, masks: Sequence[NDArray[Any]]) -> list[BoolArray]:
    """Masks of booleans or whole numbers as booleans; all masks together tell what the numbers mean."""
    numbers = [mask for mask in masks if mask.dtype != np.bool_]
    lowest = min((int(mask.min(initial=0)) for mask in numbers), default=0)
    highest = max((int(mask.max(initial=0)) for mask in numbers), default=0)
    if lowest < 0 or 1 < highest <= HALF_COVERAGE or highest > 255:
        raise InputError(
            f"The segmenter '{name}' gave masks of whole numbers from {lowest} to {highest}; 0 and 1, or coverage from "
            "0 to 255, are needed."
        )
    threshold = 0 if highest <= 1 else HALF_COVERAGE
    return [mask if mask.dtype == np.bool_ else np.asarray(mask > threshold) for mask in masks]


def _described(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape} and type {value.dtype}"
    return "nothing" if value is None else f"a {type(value).__name__}"


def _checked_name(kind: str, plug_in: Any, methods: Sequence[str]) -> str:
    """The name that a plug-in states, or that of its class; InputError if it lacks a method."""
    if isinstance(plug_in, type):
        raise InputError(f"The {kind} {plug_in.__name__} is a class; give an object of it, {plug_in.__name__}().")
    name = str(getattr(plug_in, "name", None) or type(plug_in).__name__)
    missing = [method for method in methods if not callable(getattr(plug_in, method, None))]
    if missing:
        raise InputError(f"The {kind} '{name}' has no method {' and no method '.join(missing)}.")
    return name
