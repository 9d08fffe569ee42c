"""What a selection file can mean, told by its content, the scene's size and the options."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.selection_files import array_kinds, feature_kinds, splat_kinds, trimmed
from gaussian_trimmer.selection_files.options import SelectionOptions
from gaussian_trimmer.selection_files.selection_file import SelectionFile

Select = Callable[[SelectionFile, Gaussians, SelectionOptions], BoolArray]

KINDS: dict[str, tuple[Select, tuple[str, ...]]] = {
    "mask": (array_kinds.select_mask, ("property", "threshold")),
    "labels": (array_kinds.select_labels, ("object_id", "property")),
    "indices": (array_kinds.select_indices, ("property",)),
    "subset": (splat_kinds.select_subset, ()),
    "property": (splat_kinds.select_property, ("property", "threshold", "object_id")),
    "classifier": (feature_kinds.select_classifier, ("classifier", "object_id", "threshold")),
    "similarity": (feature_kinds.select_similarity, ("query_row", "threshold")),
    "checkpoint": (feature_kinds.select_checkpoint, ("threshold",)),
    "flashsplat": (array_kinds.select_flashsplat, ("object_id", "gamma")),
    "trimmed": (trimmed.select_trimmed, ("object_id",)),
}
"""Kind -> the function that finds the selection (N,), and names of the options that it understands."""


def offered_kinds(file: SelectionFile, n: int, options: SelectionOptions) -> list[str]:
    """The kinds that a file can be of, for a scene of n Gaussians; what the program wrote is that and nothing else."""
    if trimmed.is_trimmed(file) and options.property is None:
        return ["trimmed"]
    by_features = options.classifier is not None or options.query_row is not None
    with_mask = file.rows is not None and splat_kinds.MASK in file.rows.columns
    weights = array_kinds.flashsplat_weights(file)
    offered = {
        "mask": _may_be_mask(file.vector(options, *array_kinds.MASK_NAMES), n, options),
        "labels": _may_be_labels(file, n, options),
        "indices": _may_be_indices(file.vector(options, *array_kinds.INDEX_NAMES), n, file.is_list),
        "subset": file.rows is not None and not (by_features or options.property is not None or with_mask),
        "property": file.rows is not None and not by_features and (options.property is not None or with_mask),
        "classifier": feature_kinds.classifier_of(file) is not None
        or (file.has_features and options.classifier is not None),
        "similarity": file.has_features and options.query_row is not None,
        "checkpoint": file.checkpoint is not None and not by_features,
        "flashsplat": weights is not None and weights.shape[1] == n,
    }
    return [name for name, possible in offered.items() if possible]


def _may_be_mask(values: NDArray[Any] | None, n: int, options: SelectionOptions) -> bool:
    """Booleans, scores, or integers of two values that can only be a mask."""
    if values is None or values.dtype.kind in "bf":
        return values is not None
    # Two-valued integers of another length are a mask of another scene, unless they may be the row numbers 0 and 1.
    return array_kinds.is_two_valued(values) and not options.object_id and (len(values) == n or len(values) > 2)


def _may_be_labels(file: SelectionFile, n: int, options: SelectionOptions) -> bool:
    """OpenGaussian's clusters, or N integers that are more than a mask, or of which an id is asked for."""
    values = file.vector(options, *array_kinds.LABEL_NAMES)
    if values is None or len(values) != n or array_kinds.CLUSTERS in file.arrays:
        return values is not None and len(values) == n
    return values.dtype.kind in "iu" and (bool(options.object_id) or not array_kinds.is_two_valued(values))


def _may_be_indices(values: NDArray[Any] | None, n: int, is_list: bool) -> bool:
    """Integers whose number is not N, and which are not a two-valued mask."""
    if values is None or values.dtype.kind not in "iu" or (len(values) == n and not is_list):
        return False
    return not array_kinds.is_two_valued(values) or len(values) <= 2
