"""Answers of segmenters of a caller's own, so that a mistake in one is a sentence naming it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.masks import Segmenter, name_of
from gaussian_trimmer.views.view import HALF_COVERAGE, View


def checked_masks(
    segmenter: Segmenter,
    views: Sequence[View],
    gaussians: Gaussians,
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
        report: called with the view that the segmenter is at, if it says so.

    Raises:
        InputError: there is not one mask for each view, of its size, of booleans or such whole numbers.
    """
    if hasattr(segmenter, "report_to"):
        segmenter.report_to(report)
    together = getattr(segmenter, "segment_together", None)
    masks = segmenter.segment(views) if together is None else together(views, gaussians)
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
