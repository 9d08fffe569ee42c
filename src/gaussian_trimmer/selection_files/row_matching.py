"""Which scene row a Gaussian of another file is, found by equal attributes.

Exporters reorder rows, drop normals and cut spherical harmonics, but they copy the numbers they keep. So rows are
compared by 64-bit hashes of all attributes that both files have. Equal rows pair off in file order.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray
from gaussian_trimmer.selection_files.splat_rows import Columns, SplatRows, gaussian_columns

_POSITION = ("x", "y", "z")
_CHANGED_BY_MOVING = (*_POSITION, "scale_0", "scale_1", "scale_2")
_ROWS_PER_CHUNK = 1 << 16
_UNMATCHED = -1
_MAX_LOST = 0.5
"""Largest share of rows that may match nothing."""


def match_rows(rows: SplatRows, gaussians: Gaussians, path: Path) -> IntArray:
    """Scene row of every row of a file, (M,), all different.

    Raises:
        InputError: rows match no scene row.
    """
    found = _match_exactly(rows, gaussians)
    lost = np.flatnonzero(found == _UNMATCHED)
    if len(lost):
        raise InputError(
            f"{len(lost)} of the {len(rows)} rows of '{path.name}' match no row of the scene exactly (the first is row "
            f"{lost[0]}); give the scene that the file was made from."
        )
    return found


def match_changed_rows(rows: SplatRows, gaussians: Gaussians, path: Path) -> tuple[IntArray, list[str]]:
    """Scene row of the rows of a file whose Gaussians may have been changed, (M,), -1 for none, and notes on that.

    Rows that equal no scene row are matched by colour, opacity and rotation, which a method that moves and rescales
    Gaussians leaves as they are; the rest by what is nearest, and by what they may be parts of.

    Raises:
        InputError: half of the rows or more match no scene row even so, or several of which any could be meant.
    """
    found, ambiguous = _match_exactly(rows, gaussians), 0
    lost = np.flatnonzero(found == _UNMATCHED)
    scene = gaussian_columns(gaussians)
    names = [name for name in scene if name in rows.attributes and name not in _CHANGED_BY_MOVING]
    free = np.setdiff1d(np.arange(len(gaussians)), found)
    if len(lost) and len(free) and names:
        wanted = {name: rows.attributes[name][lost] for name in names}
        offered = {name: scene[name][free] for name in names}
        unclear = _ambiguous(wanted, offered, names)
        local = np.where(unclear, _UNMATCHED, _pair(wanted, offered, names))
        found[lost] = np.where(local == _UNMATCHED, _UNMATCHED, free[local])
        ambiguous = int(np.count_nonzero(unclear))
    notes = _match_roughly(rows, gaussians, found)
    lost = np.flatnonzero(found == _UNMATCHED)
    if ambiguous and len(lost):
        raise InputError(
            f"{ambiguous} moved rows of '{path.name}' have the colour, opacity and rotation of several scene rows; "
            "give the rows as they were before they were moved."
        )
    if len(lost) > _MAX_LOST * len(rows):
        raise InputError(
            f"{len(lost)} of the {len(rows)} rows of '{path.name}' match no row of the scene, neither exactly nor by "
            f"colour, opacity and rotation, nor nearly (the first is row {lost[0]}); give the scene that they were cut "
            "from, and export the cut-out without moving or scaling it."
        )
    return found, notes


def _match_roughly(rows: SplatRows, gaussians: Gaussians, found: IntArray) -> list[str]:
    """Match the rows that are not yet found by what is nearest, in place; returns notes on how many were."""
    notes: list[str] = []
    lost = np.flatnonzero(found == _UNMATCHED)
    if not len(lost):
        return notes
    # Late, since it compiles, and most files match exactly.
    from gaussian_trimmer.selection_files.nearest_rows import match_children, match_nearest

    free = np.setdiff1d(np.arange(len(gaussians)), found)
    found[lost] = match_nearest(rows, lost, gaussians, free)
    near = int(np.count_nonzero(found[lost] != _UNMATCHED))
    if near:
        notes.append(f"{near} of {len(rows)} rows by the nearest Gaussian")
    lost = np.flatnonzero(found == _UNMATCHED)
    if len(lost):
        found[lost] = match_children(rows, lost, gaussians)
        if parts := int(np.count_nonzero(found[lost] != _UNMATCHED)):
            notes.append(f"{parts} as parts of split Gaussians")
    if missing := int(np.count_nonzero(found == _UNMATCHED)):
        notes.append(f"{missing} match nothing")
    return notes


def match_centres(means: NDArray[Any], gaussians: Gaussians, path: Path) -> IntArray:
    """Scene row of every centre (M, 3) of a checkpoint, (M,), all different.

    Raises:
        InputError: centres match no scene row.
    """
    centres = {axis: means[:, i] for i, axis in enumerate(_POSITION)}
    found = _pair(centres, gaussian_columns(gaussians), list(_POSITION))
    if lost := int((found == _UNMATCHED).sum()):
        raise InputError(
            f"{lost} of the {len(means)} Gaussians of '{path.name}' are not among the scene's {len(gaussians)}; give "
            "the scene of the same training iteration."
        )
    return found


def _match_exactly(rows: SplatRows, gaussians: Gaussians) -> IntArray:
    scene = gaussian_columns(gaussians)
    return _pair(rows.attributes, scene, [name for name in scene if name in rows.attributes])


def _ambiguous(wanted: Columns, offered: Columns, names: list[str]) -> BoolArray:
    """Rows (W,) for which more scene rows are equal than are asked for."""
    wanted_hashes, offered_hashes = _hashes(wanted, names), np.sort(_hashes(offered, names))
    copies = np.searchsorted(offered_hashes, wanted_hashes, "right") - np.searchsorted(offered_hashes, wanted_hashes)
    _, inverse, asked = np.unique(wanted_hashes, return_inverse=True, return_counts=True)
    return np.asarray(copies > asked[inverse])


def _pair(rows: Columns, scene: Columns, names: list[str]) -> IntArray:
    """Row of the scene that equals each row in the named columns, (M,), -1 for none; no scene row is used twice."""
    row_hashes, scene_hashes = _hashes(rows, names), _hashes(scene, names)
    row_order, scene_order = np.argsort(row_hashes, kind="stable"), np.argsort(scene_hashes, kind="stable")
    sorted_rows, sorted_scene = row_hashes[row_order], scene_hashes[scene_order]
    # The j-th of several equal rows takes the j-th of the equal scene rows.
    copy = np.arange(len(sorted_rows)) - np.searchsorted(sorted_rows, sorted_rows)
    place = np.searchsorted(sorted_scene, sorted_rows) + copy
    equal = place < len(sorted_scene)
    equal[equal] = sorted_scene[place[equal]] == sorted_rows[equal]
    found = np.full(len(row_hashes), _UNMATCHED, np.int64)
    found[row_order[equal]] = scene_order[place[equal]]
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
