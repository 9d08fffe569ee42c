"""A property of a splat file's rows, above a threshold or equal to an id.

SA3D-GS writes `seg_point_cloud.ply`, some rows of the scene with a float property `mask` that is positive on the
object. Other methods and editors write a label or a score under a name of their own.
"""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.selection_files.object_ids import list_names, select_ids
from gaussian_trimmer.selection_files.options import SelectionOptions, flag
from gaussian_trimmer.selection_files.selection_file import SelectionFile

OPTIONS = frozenset({"property", "threshold", "object_id"})
_LARGEST_ID = 2**53
MASK = "mask"
"""The property that SA3D-GS adds."""


def offers(file: SelectionFile, n: int, options: SelectionOptions) -> bool:
    """Whether a property of a splat file is asked for, or the file has SA3D-GS's."""
    if file.rows is None or options.classifier is not None or options.query_row is not None:
        return False
    return options.property is not None or MASK in file.rows.columns


def select(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """The scene rows whose property is above the threshold (default 0), or one of the chosen ids, (N,).

    Raises:
        InputError: the file has no such property, rows that are not the scene's, or no Gaussians of an id.
    """
    if file.rows is None:
        raise InputError(f"'{file.path.name}' holds no splats, so it has no properties.")
    name = options.property or MASK
    if name not in file.rows.columns:
        raise InputError(
            f"'{file.path.name}' has no property '{shown(name)}'; choose with {flag('property')} among: "
            f"{list_names(file.rows.columns)}."
        )
    values = np.asarray(file.rows.columns[name])
    if options.object_id:
        if not ((values == np.rint(values)) & (np.abs(values) <= _LARGEST_ID)).all():
            raise InputError(
                f"The property '{name}' of '{file.path.name}' is no id: it has values that are not whole, or huge; use "
                f"{flag('threshold')} instead of {flag('object_id')}."
            )
        chosen = select_ids(values.astype(np.int64), options.object_id, file.path)
    else:
        chosen = values > (options.threshold or 0.0)
    mask = np.zeros(len(gaussians), bool)
    mask[file.scene_rows(gaussians)[chosen]] = True
    return mask
