"""Find the scene row that each Gaussian of another file is.

Exporters reorder rows, drop normals and cut spherical harmonics, but copy the numbers that they keep: rows are compared
by 64-bit hashes of all attributes that both files have, and equal rows pair off in file order. Methods that move and
rescale Gaussians leave colour, opacity and rotation. Editors and compressed formats change the last digits, so what is
left is matched with the nearest Gaussian in place, size, colour and opacity together, within tolerances:

- place: half the scene Gaussian's largest standard deviation, or a two-thousandth of the scene's extent if that is more
- size: a factor of 1.3 in each of the sorted standard deviations
- colour and opacity: 0.08 of their range from 0 to 1

The rest may be parts of split Gaussians, as in a trim's own objects: a part lies within two standard deviations of its
parent, is no larger than it, and has its colour within 0.08.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator, Mapping
from functools import partial
from itertools import count, takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.packing import finite_log_scales, finite_opacity_logits
from gaussian_trimmer.formats.ply import read_header, read_table
from gaussian_trimmer.gaussians import SH_C0, Float64Array, FloatArray, Gaussians, IntArray, sigmoid

_CHANGED_BY_MOVING = ("x", "y", "z", "scale_0", "scale_1", "scale_2")
_COMPARED_NEARBY = (*(f"scale_{i}" for i in range(3)), *(f"f_dc_{i}" for i in range(3)), "opacity")
_ROWS_PER_CHUNK = 1 << 15
MATCH_NOTHING = "match nothing"
"""What a note says of rows that are not in the scene."""
_UNMATCHED = -1
_MAX_LOST = 0.5
"""Largest share of rows that may match nothing."""
_PLACE, _EXTENT, _SIZE, _COLOUR, _PARENT_REACH = 0.5, 1 / 2000, np.log(1.3), 0.08, 2.0
"""Tolerances as above."""
_CANDIDATES = 24
_ENDS = (0.01, 0.99)
Columns = Mapping[str, NDArray[Any]]
"""Columns by name, each (M,). Spherical harmonics above degree 0 are `sh_<coefficient>_<channel>` in attributes."""
_ATTRIBUTE = re.compile(r"[xyz]|f_dc_[012]|opacity|scale_[012]|rot_[0123]|sh_\d+_[012]")


def match_rows(rows: Columns, gaussians: Gaussians, path: Path) -> IntArray:
    """Return the scene row of every row of a file, (M,), all different, by the attributes that the file has.

    Raises:
        InputError: rows match no scene row.
    """
    found = _match_equal(rows, np.arange(len(rows["x"])), gaussians, np.arange(len(gaussians)))
    lost = np.flatnonzero(found == _UNMATCHED)
    if len(lost):
        raise InputError(
            f"{len(lost)} of the {len(found)} rows of '{path.name}' match no row of the scene exactly (the first is "
            f"row {lost[0]}); give the scene of the same training iteration, that the file was made from."
        )
    return found


def match_changed_rows(rows: Columns, gaussians: Gaussians, path: Path) -> tuple[IntArray, list[str]]:
    """Return the scene row of rows whose Gaussians may have been changed, (M,), -1 for none, and notes on that.

    Raises:
        InputError: half of the rows or more match no scene row even so.
    """
    n = len(rows["x"])
    found, notes = np.full(n, _UNMATCHED), list[str]()
    for match, said in (
        (_match_equal, ""),
        (partial(_match_equal, moved=True), ""),
        (_match_nearest, f"of {n} rows by the nearest Gaussian"),
        (_match_parents, "as parts of split Gaussians"),
    ):
        lost, free = np.flatnonzero(found == _UNMATCHED), np.setdiff1d(np.arange(len(gaussians)), found)
        if len(lost):
            found[lost] = match(rows, lost, gaussians, free)
            if said and (matched := int(np.count_nonzero(found[lost] != _UNMATCHED))):
                notes.append(f"{matched} {said}")
    if len(lost := np.flatnonzero(found == _UNMATCHED)):
        notes.append(f"{len(lost)} {MATCH_NOTHING}")
    if len(lost) > _MAX_LOST * n:
        raise InputError(
            f"{len(lost)} of the {n} rows of '{path.name}' match no row of the scene, neither exactly nor by "
            f"colour, opacity and rotation, nor nearly (the first is row {lost[0]}); give the scene that they were cut "
            "from, and export the cut-out without moving or scaling it."
        )
    return found, notes


def _match_equal(
    rows: Columns, wanted: IntArray, gaussians: Gaussians, free: IntArray, *, moved: bool = False
) -> IntArray:
    """Return the scene row that equals each wanted row, (W,), -1 for none.

    Args:
        rows: the file's rows.
        wanted: numbers of the rows that are to be matched, (W,).
        gaussians: the scene.
        free: scene rows that may be used, each once at most, (F,).
        moved: leave places and sizes out; a row for which more scene rows are equal than are asked for has none then.
    """
    scene, found = gaussian_columns(gaussians), np.full(len(wanted), _UNMATCHED)
    names = [name for name in scene if name in rows and not (moved and name in _CHANGED_BY_MOVING)]
    if not names:
        return found
    row_hashes, scene_hashes = _hashes(rows, names)[wanted], _hashes(scene, names)[free]
    row_order, scene_order = np.argsort(row_hashes, kind="stable"), np.argsort(scene_hashes, kind="stable")
    sorted_rows, sorted_scene = row_hashes[row_order], scene_hashes[scene_order]
    # The j-th of several equal rows takes the j-th of the equal scene rows.
    first, after = (np.searchsorted(sorted_rows, sorted_rows, side) for side in ("left", "right"))
    first_equal, after_equal = (np.searchsorted(sorted_scene, sorted_rows, side) for side in ("left", "right"))
    place = first_equal + np.arange(len(sorted_rows)) - first
    taken = place < after_equal
    if moved:
        taken &= after_equal - first_equal <= after - first
    found[row_order[taken]] = free[scene_order[place[taken]]]
    return found


def _hashes(columns: Columns, names: list[str]) -> NDArray[np.uint64]:
    """Return a 64-bit hash of each row's named columns as float32, (M,)."""
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


def _match_nearest(rows: Columns, wanted: IntArray, gaussians: Gaussians, free: IntArray) -> IntArray:
    """Return the nearest scene row within the tolerances, (W,), -1 for none; arguments as of `_match_equal`."""
    found, scene = np.full(len(wanted), _UNMATCHED), gaussians.select(free)
    low, high = np.quantile(gaussians.means, _ENDS, axis=0)
    reach = np.maximum(_PLACE * np.exp(scene.largest_log_scales), _EXTENT * float(np.linalg.norm(high - low)))
    pairs, costs = [np.zeros((0, 2), np.int64)], [np.zeros(0)]
    for part, beside, distances, differences in _neighbours(rows, wanted, scene):
        apart, different = distances / reach[beside], np.abs(differences).max(axis=2)
        row, place = np.nonzero(np.maximum(apart, different) <= 1)
        pairs.append(np.column_stack([row + part.start, beside[row, place]]))
        costs.append(apart[row, place] ** 2 + different[row, place] ** 2)
    candidates, cost = np.concatenate(pairs), np.concatenate(costs)
    taken = np.zeros(len(free), np.bool_)
    for row, place in candidates[np.lexsort((candidates[:, 1], candidates[:, 0], cost))].tolist():
        if found[row] == _UNMATCHED and not taken[place]:  # the cheapest pairs come first
            found[row], taken[place] = free[place], True
    return found


def _match_parents(rows: Columns, wanted: IntArray, gaussians: Gaussians, free: IntArray) -> IntArray:
    """Return the scene row that each row may be a part of, (W,), -1 for none; one of several parts takes none."""
    found, largest = np.full(len(wanted), _UNMATCHED), np.exp(gaussians.largest_log_scales)
    for part, beside, distances, differences in _neighbours(rows, wanted, gaussians):
        apart = distances / (_PARENT_REACH * largest[beside])
        colour, larger = np.abs(differences[..., 3:6]).max(axis=2), differences[..., :3].max(axis=2)
        cost = np.where((apart <= 1) & (colour <= 1) & (larger <= 1), apart + colour, np.inf)
        best = cost.argmin(axis=1)[:, None]
        fits = np.isfinite(np.take_along_axis(cost, best, axis=1))
        found[part] = np.where(fits, np.take_along_axis(beside, best, axis=1), _UNMATCHED)[:, 0]
    return found


def _neighbours(
    rows: Columns, wanted: IntArray, scene: Gaussians
) -> Iterator[tuple[slice, IntArray, Float64Array, FloatArray]]:
    """Give, of a part of the wanted rows at a time, (C,): the nearest rows of the scene, (C, K), their distances,
    (C, K), and by how much sizes, colours and opacity exceed theirs, in tolerances, (C, K, 7).

    Nothing where the file lacks an attribute.
    """
    if not len(wanted) or not len(scene) or any(name not in rows for name in _COMPARED_NEARBY):
        return
    from gaussian_trimmer.geometry.graphs import nearest  # late, since most files match exactly

    mine, theirs = _features(rows, wanted), _features(gaussian_columns(scene), slice(None))
    places = np.column_stack([np.asarray(rows[axis][wanted], np.float32) for axis in "xyz"])
    places = np.nan_to_num(places, nan=1e15, posinf=1e15, neginf=-1e15)
    for start in range(0, len(wanted), _ROWS_PER_CHUNK):
        part = slice(start, start + _ROWS_PER_CHUNK)
        squared, beside = nearest(scene.means, places[part], min(_CANDIDATES, len(scene)))
        yield part, beside.astype(np.int64), np.sqrt(squared), mine[part][:, None] - theirs[beside]


def _features(columns: Columns, rows: IntArray | slice) -> FloatArray:
    """Return sorted sizes, colour and opacity of some rows, each in units of its tolerance, (R, 7)."""
    table = np.column_stack([np.asarray(columns[name][rows], np.float32) for name in _COMPARED_NEARBY])
    table = np.nan_to_num(table, nan=1e6, posinf=1e6, neginf=-1e6)
    sizes = np.sort(np.clip(table[:, :3], -30, 30), axis=1) / _SIZE
    colours = np.clip(0.5 + SH_C0 * table[:, 3:6], 0, 1) / _COLOUR
    opacities = sigmoid(table[:, 6])[:, None] / _COLOUR
    return np.asarray(np.concatenate([sizes, colours, opacities], axis=1), np.float32)


def read_splat_columns(path: Path) -> Columns:
    """Return all columns of a PLY with at least x, y and z, or of any other splat file.

    Raises:
        InputError: the file cannot be read, or has no positions.
    """
    if path.suffix.lower() == ".ply":
        header = read_header(path)
        names = header.names("vertex")
        if "x" in names and formats.FILTER not in names:
            if missing := {"y", "z"} - {*names}:
                raise InputError(f"'{path}' has no property {min(missing)}, so its rows cannot be told apart.")
            table = read_table(path, header)
            return {name: table[name] for name in names}
    gaussians = formats.read(path)
    return {**gaussian_columns(gaussians), **gaussians.extras}


def gaussian_columns(gaussians: Gaussians) -> dict[str, NDArray[Any]]:
    """Return the attributes of Gaussians as named columns, each a view (N,)."""
    columns = {"xyz"[i]: gaussians.means[:, i] for i in range(3)}
    columns |= {f"f_dc_{i}": gaussians.sh_dc[:, i] for i in range(3)}
    columns |= {"opacity": gaussians.opacity_logits}
    columns |= {f"scale_{i}": gaussians.log_scales[:, i] for i in range(3)}
    columns |= {f"rot_{i}": gaussians.quaternions[:, i] for i in range(4)}
    _, channels, coefficients = gaussians.sh_rest.shape
    columns |= {f"sh_{k}_{c}": gaussians.sh_rest[:, c, k] for k in range(coefficients) for c in range(channels)}
    return columns


def has_identity_features(columns: Container[str]) -> bool:
    """Return whether the columns are those of a method that adds identity features."""
    return "obj_dc_0" in columns


def identity_features(columns: Columns) -> FloatArray | None:
    """Return the columns obj_dc_0, obj_dc_1, ... side by side, (M, D), or None if there are none."""
    if not has_identity_features(columns):
        return None
    names = takewhile(columns.__contains__, (f"obj_dc_{i}" for i in count()))
    return np.column_stack([np.asarray(columns[name], np.float32) for name in names])


def attributes_of(columns: Columns) -> Columns:
    """Return what is drawn among the columns of a file, by which rows are matched with those of the scene.

    f_rest is channel-major, so its numbering depends on the degree.
    """
    renamed = dict(columns)
    n_rest = sum(name.startswith("f_rest_") for name in columns)
    if n_rest % 3 == 0 and all(f"f_rest_{i}" in columns for i in range(n_rest)):
        per_channel = n_rest // 3
        renamed |= {f"sh_{i % per_channel}_{i // per_channel}": columns[f"f_rest_{i}"] for i in range(n_rest)}
    attributes = {name: column for name, column in renamed.items() if _ATTRIBUTE.fullmatch(name)}
    # What has no finite value in the file has one in the scene that was read from such a file.
    for name in attributes.keys() & {"opacity", "scale_0", "scale_1", "scale_2"}:
        values = np.asarray(attributes[name], np.float32)
        attributes[name] = finite_opacity_logits(values) if name == "opacity" else finite_log_scales(values)
    return attributes
