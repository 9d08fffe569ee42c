"""Identity features compared with those of one Gaussian on the object, as in OmniSeg3D-GS's graphical interface."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.selection_files.classifier import features_and_rows
from gaussian_trimmer.selection_files.options import SelectionOptions, flag
from gaussian_trimmer.selection_files.selection_file import SelectionFile

OPTIONS = frozenset({"query_row", "threshold"})
SIMILARITY = 0.9
"""Default threshold on (cos + 1) / 2."""


def offers(file: SelectionFile, n: int, options: SelectionOptions) -> bool:
    """Whether the file holds features and a query Gaussian is given."""
    return file.has_features and options.query_row is not None


def select(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """The Gaussians for which (cos + 1) / 2 of their and the query's features is above the threshold, (N,).

    A feature of length zero has the cosine 0 with every other.

    Raises:
        InputError: there are no features, no query is given, or it is no row of the scene and of the file.
    """
    features, rows = features_and_rows(file, gaussians)
    if options.query_row is None:
        raise InputError(f"Name a Gaussian on the object by its row number with {flag('query_row')}.")
    at = np.flatnonzero(rows == options.query_row)
    if len(at) == 0:
        raise InputError(
            f"The query row {options.query_row} has no features in '{file.path.name}'; choose a row of the scene from "
            f"0 to {len(gaussians) - 1} that the file holds."
        )
    unit = features / np.maximum(np.linalg.norm(features, axis=1, keepdims=True), np.float32(1e-12))
    scores = (unit @ unit[at[0]] + 1) / 2
    mask = np.zeros(len(gaussians), bool)
    mask[rows[scores > (SIMILARITY if options.threshold is None else options.threshold)]] = True
    return mask
