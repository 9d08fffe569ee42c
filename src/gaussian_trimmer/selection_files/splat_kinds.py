"""Selections in splat files: some rows of the scene, or all with a property that tells them apart.

Editors such as SuperSplat, and the interfaces of OmniSeg3D-GS and others, save the object's rows as they are. SAGD
also saves `point_cloud_seg_gd.ply`, in which boundary Gaussians have been moved and shrunk. Compressed formats round,
and the program's own objects have children of split Gaussians: such rows are matched with what is nearest. SA3D-GS
writes `seg_point_cloud.ply`, some rows of the scene with a float property `mask` that is positive on the object.
"""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.gaussians import BoolArray, Gaussians, mask_of_rows
from gaussian_trimmer.selection_files.object_ids import list_names, select_ids
from gaussian_trimmer.selection_files.row_matching import match_changed_rows
from gaussian_trimmer.selection_files.selection_file import SelectionFile, SelectionOptions, flag

MASK = "mask"
"""The property that SA3D-GS adds."""
_LARGEST_ID = 2**53


def select_subset(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """Return the scene rows that the file holds, (N,).

    Raises:
        InputError: the file holds no splats, as many as the scene or more, or mostly rows that are not in the scene.
    """
    if file.rows is None:
        raise InputError(f"'{file.path.name}' holds no splats.")
    if len(file.rows) >= len(gaussians):
        hint = f"{flag('classifier')} or {flag('query_row')}" if file.has_features else flag("property")
        raise InputError(
            f"'{file.path.name}' holds {len(file.rows)} Gaussians and the scene {len(gaussians)}, so it is not a part "
            f"of the scene; to select by what its Gaussians carry, use {hint}."
        )
    found, notes = match_changed_rows(file.rows, gaussians, file.path)
    file.notes.extend(notes)
    return mask_of_rows(found[found >= 0], len(gaussians))


def select_property(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """Return the scene rows whose property is above the threshold (default 0), or one of the chosen ids, (N,).

    Raises:
        InputError: the file has no such property, rows that are not the scene's, or no Gaussians of an id.
    """
    if file.rows is None:
        raise InputError(f"'{file.path.name}' holds no splats, so it has no properties.")
    name = options.property or MASK
    if name not in file.rows.columns:
        raise InputError(
            f"'{file.path.name}' has no property '{clip_name(name)}'; choose with {flag('property')} among: "
            f"{list_names(file.rows.columns)}."
        )
    values = np.asarray(file.rows.columns[name])
    if options.object_id:
        if not ((values == np.rint(values)) & (np.abs(values) <= _LARGEST_ID)).all():
            raise InputError(
                f"The property '{name}' of '{file.path.name}' is not an id: it has values that are not whole, or huge; "
                f"use {flag('threshold')} instead of {flag('object_id')}."
            )
        chosen = select_ids(values.astype(np.int64), options.object_id, file.path)
    else:
        chosen = values > (options.threshold or 0.0)
    return mask_of_rows(file.scene_rows(gaussians)[chosen], len(gaussians))
