"""OpenGaussian's `cluster_lang.npz`: `leaf_ind` (N,) is the cluster of every Gaussian."""

from __future__ import annotations

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.selection_files.object_ids import select_ids
from gaussian_trimmer.selection_files.options import SelectionOptions
from gaussian_trimmer.selection_files.selection_file import SelectionFile

OPTIONS = frozenset({"object_id"})
LEAF = "leaf_ind"
"""The array of cluster ids."""


def offers(file: SelectionFile, n: int, options: SelectionOptions) -> bool:
    """Whether the file has the array of cluster ids beside others."""
    return LEAF in file.arrays and len(file.arrays) > 1 and options.property is None


def select(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """The Gaussians of the chosen clusters, (N,).

    Raises:
        InputError: there is no such array, its length is not N, or the clusters are not chosen or do not occur.
    """
    leaves = file.arrays.get(LEAF)
    if leaves is None:
        raise InputError(f"'{file.path.name}' has no array {LEAF}; give OpenGaussian's cluster_lang.npz.")
    if leaves.size != len(gaussians):
        raise InputError(
            f"'{file.path.name}' holds {leaves.size} cluster ids, but the scene has {len(gaussians)} Gaussians; give "
            "the point cloud of the same training."
        )
    return select_ids(leaves.reshape(-1), options.object_id, file.path)
