"""One object id a Gaussian, for scenes segmented into several objects."""

from __future__ import annotations

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.selection_files.mask import is_two_valued
from gaussian_trimmer.selection_files.object_ids import select_ids
from gaussian_trimmer.selection_files.options import SelectionOptions
from gaussian_trimmer.selection_files.selection_file import SelectionFile

OPTIONS = frozenset({"object_id", "property"})
_NAMES = ("labels", "label", "ids", "instance", "instances")


def offers(file: SelectionFile, n: int, options: SelectionOptions) -> bool:
    """Whether the file holds n integers that are more than a mask, or an id is asked for."""
    labels = file.vector(options, *_NAMES)
    if labels is None or labels.dtype.kind not in "iu" or len(labels) != n:
        return False
    return bool(options.object_id) or not is_two_valued(labels)


def select(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """The Gaussians of the chosen ids, (N,).

    Raises:
        InputError: there is no such array, its length is not N, or the ids are not chosen or do not occur.
    """
    labels = file.vector(options, *_NAMES)
    if labels is None or labels.dtype.kind not in "biu":
        raise InputError(f"'{file.path.name}' holds no one-dimensional array of integers that could be labels.")
    if len(labels) != len(gaussians):
        raise InputError(
            f"'{file.path.name}' holds {len(labels)} labels, but the scene has {len(gaussians)} Gaussians; give the "
            "scene that the labels were made for."
        )
    return select_ids(labels, options.object_id, file.path)
