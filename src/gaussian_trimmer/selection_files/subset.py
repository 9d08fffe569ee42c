"""A splat file that holds the object's Gaussians alone.

Editors such as SuperSplat, and the graphical interfaces of OmniSeg3D-GS and others, save the rows as they are. SAGD
also saves `point_cloud_seg_gd.ply`, in which boundary Gaussians have been moved and shrunk. Compressed formats round,
and the program's own objects have children of split Gaussians: such rows are matched with what is nearest.
"""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.selection_files.options import SelectionOptions, flag
from gaussian_trimmer.selection_files.row_matching import match_changed_rows
from gaussian_trimmer.selection_files.selection_file import SelectionFile
from gaussian_trimmer.selection_files.splat_property import MASK

OPTIONS: frozenset[str] = frozenset()


def offers(file: SelectionFile, n: int, options: SelectionOptions) -> bool:
    """Whether the file holds splats and nothing says that they are to be selected by a property or by features."""
    if file.rows is None or options.given() & {"property", "classifier", "query_row"}:
        return False
    return MASK not in file.rows.columns


def select(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """The scene rows that the file holds, (N,).

    Raises:
        InputError: the file holds no splats, as many as the scene or more, or mostly rows that are not in the scene.
    """
    if file.rows is None:
        raise InputError(f"'{file.path.name}' holds no splats.")
    if len(file.rows) >= len(gaussians):
        hint = f"{flag('classifier')} or {flag('query_row')}" if file.has_features else flag("property")
        raise InputError(
            f"'{file.path.name}' holds {len(file.rows)} Gaussians and the scene {len(gaussians)}, so it is no part of "
            f"the scene; to select by what its Gaussians carry, use {hint}."
        )
    mask = np.zeros(len(gaussians), bool)
    found, notes = match_changed_rows(file.rows, gaussians, file.path)
    file.notes.extend(notes)
    mask[found[found >= 0]] = True
    return mask
