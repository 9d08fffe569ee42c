"""Which scene row a Gaussian of another file is.

Exporters reorder rows, drop normals and cut spherical harmonics, but they copy the numbers they keep. So rows are
compared by 64-bit hashes of all attributes that both files have. Equal rows pair off in file order. What has no partner
so may have been moved, rounded or split, and is matched by what stays the same or near.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Gaussians, IntArray
from gaussian_trimmer.selection_files.splat_rows import Columns, SplatRows, gaussian_columns

_POSITION = ("x", "y", "z")
_CHANGED_BY_MOVING = (*_POSITION, "scale_0", "scale_1", "scale_2")
_ROWS_PER_CHUNK = 1 << 16
_UNMATCHED = -1
_MAX_LOST = 0.5
"""Largest share of rows that may match nothing."""


def match_rows(rows: Columns, gaussians: Gaussians, path: Path) -> IntArray:
    """Scene row of every row of a file, (M,), all different, by the attributes that the file has.

    Raises:
        InputError: rows match no scene row.
    """
    scene = gaussian_columns(gaussians)
    found = _pair(rows, scene, [name for name in scene if name in rows])
    lost = np.flatnonzero(found == _UNMATCHED)
    if len(lost):
        raise InputError(
            f"{len(lost)} of the {len(found)} rows of '{path.name}' match no row of the scene exactly (the first is "
            f"row {lost[0]}); give the scene of the same training iteration, that the file was made from."
        )
    return found


def match_changed_rows(rows: SplatRows, gaussians: Gaussians, path: Path) -> tuple[IntArray, list[str]]:
    """Scene row of the rows of a file whose Gaussians may have been changed, (M,), -1 for none, and notes on that.

    Rows that equal no scene row are matched by colour, opacity and rotation, which a method that moves and rescales
    Gaussians leaves as they are; the rest by what is nearest, and by what they may be parts of.

    Raises:
        InputError: half of the rows or more match no scene row even so.
    """
    scene = gaussian_columns(gaussians)
    names = [name for name in scene if name in rows.attributes]
    found, notes = _pair(rows.attributes, scene, names), []
    lost, free = _lost_and_free(found, gaussians)
    names = [name for name in names if name not in _CHANGED_BY_MOVING]
    if len(lost) and len(free) and names:
        wanted, offered = ({name: columns[name][part] for name in names}
                           for columns, part in ((rows.attributes, lost), (scene, free)))  # fmt: skip
        local = _pair(wanted, offered, names, only_clear=True)
        found[lost] = np.where(local == _UNMATCHED, _UNMATCHED, free[local])
        lost, free = _lost_and_free(found, gaussians)
    if len(lost):
        # Late, since it compiles, and most files match exactly.
        from gaussian_trimmer.selection_files.nearest_rows import match_children, match_nearest

        for match, said in ((match_nearest, f"of {len(rows)} rows by the nearest Gaussian"),
                            (match_children, "as parts of split Gaussians")):  # fmt: skip
            found[lost] = match(rows, lost, gaussians, free)
            if matched := int(np.count_nonzero(found[lost] != _UNMATCHED)):
                notes.append(f"{matched} {said}")
            lost, free = _lost_and_free(found, gaussians)
    if len(lost):
        notes.append(f"{len(lost)} match nothing")
    if len(lost) > _MAX_LOST * len(rows):
        raise InputError(
            f"{len(lost)} of the {len(rows)} rows of '{path.name}' match no row of the scene, neither exactly nor by "
            f"colour, opacity and rotation, nor nearly (the first is row {lost[0]}); give the scene that they were cut "
            "from, and export the cut-out without moving or scaling it."
        )
    return found, notes


def _lost_and_free(found: IntArray, gaussians: Gaussians) -> tuple[IntArray, IntArray]:
    """Rows that are not yet found, and scene rows that no row has taken."""
    return np.flatnonzero(found == _UNMATCHED), np.setdiff1d(np.arange(len(gaussians)), found)


def _pair(rows: Columns, scene: Columns, names: list[str], *, only_clear: bool = False) -> IntArray:
    """Row of the scene that equals each row in the named columns, (M,), -1 for none; no scene row is used twice.

    With `only_clear`, rows for which more scene rows are equal than are asked for have none.
    """
    row_hashes, scene_hashes = _hashes(rows, names), _hashes(scene, names)
    row_order, scene_order = np.argsort(row_hashes, kind="stable"), np.argsort(scene_hashes, kind="stable")
    sorted_rows, sorted_scene = row_hashes[row_order], scene_hashes[scene_order]
    # The j-th of several equal rows takes the j-th of the equal scene rows.
    first, after = (np.searchsorted(sorted_rows, sorted_rows, side) for side in ("left", "right"))
    first_equal, after_equal = (np.searchsorted(sorted_scene, sorted_rows, side) for side in ("left", "right"))
    place = first_equal + np.arange(len(sorted_rows)) - first
    taken = place < after_equal
    if only_clear:
        taken &= after_equal - first_equal <= after - first
    found = np.full(len(row_hashes), _UNMATCHED, np.int64)
    found[row_order[taken]] = scene_order[place[taken]]
    return found


def _hashes(columns: Columns, names: list[str]) -> NDArray[np.uint64]:
    """A 64-bit hash of each row's named columns as float32, (M,)."""
    hashes = np.zeros(len(columns[names[0]]), np.uint64)
    for start in range(0, len(hashes), _ROWS_PER_CHUNK):
        chunk = hashes[start : start + _ROWS_PER_CHUNK]
        for name in names:
            # Adding zero turns -0 into 0, which is equal to it but has other bits.
            values = np.asarray(columns[name][start : start + _ROWS_PER_CHUNK], np.float32) + np.float32(0)
            chunk ^= values.view(np.uint32)
            chunk *= np.uint64(0x9E3779B97F4A7C15)  # 2^64 / golden ratio, odd: mixes upwards
            chunk ^= chunk >> np.uint64(32)  # mixes downwards
    return hashes
