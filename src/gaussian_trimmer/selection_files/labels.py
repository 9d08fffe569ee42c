"""Labels of Gaussians: made from blend weights, chosen by their ids, and listed for those who did not choose."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.selection_files.selection_file import flag

_LISTED = 24
_LISTED_IN_MESSAGES = 8
_OBJECTS_AT_ONCE = 16


def list_ids(ids: Sequence[int], counts: Sequence[int], most: int = _LISTED) -> str:
    """Return ids with their numbers of Gaussians; if there are many, those with most of them, in this order.

    >>> list_ids([0, 3], [10, 90])
    '0 (10), 3 (90)'
    >>> list_ids([1, 2, 3], [5, 10, 90], most=2)
    '3 (90), 2 (10) and 1 more, with fewer'
    """
    listed = range(len(ids)) if len(ids) <= most else sorted(range(len(ids)), key=lambda i: -counts[i])[:most]
    left_out = f" and {len(ids) - most} more, with fewer" if len(ids) > most else ""
    return ", ".join(f"{ids[i]} ({counts[i]})" for i in listed) + left_out


def list_names(names: Iterable[str]) -> str:
    """Names of columns from a file, the first ones if there are many; runs that differ in their last number are one.

    >>> list_names(["mask", "obj_dc_0", "obj_dc_1", "obj_dc_2"])
    'mask, obj_dc_0 to obj_dc_2'
    """
    runs: dict[str, list[str]] = {}
    for name in names:
        runs.setdefault(re.sub(r"\d+$", "#", name), []).append(name)
    listed = [
        clip_name(run[0]) if len(run) == 1 else f"{clip_name(run[0])} to {clip_name(run[-1])}" for run in runs.values()
    ]
    left_out = f" and {len(listed) - _LISTED} more" if len(listed) > _LISTED else ""
    return ", ".join(listed[:_LISTED]) + left_out


def count_ids(labels: NDArray[Any]) -> tuple[list[int], list[int]]:
    """Return the ids among labels (N,) and how many entries have each."""
    ids, counts = np.unique(labels, return_counts=True)
    return ids.tolist(), counts.tolist()


def select_ids(labels: NDArray[Any], wanted: Sequence[int], path: Path) -> BoolArray:
    """Return which labels (M,) are among the wanted ids.

    Raises:
        InputError: no id is wanted, or one does not occur.
    """
    check_ids(wanted, *count_ids(labels), path)
    return np.isin(labels, wanted)


def check_ids(wanted: Sequence[int], ids: Sequence[int], counts: Sequence[int], path: Path) -> None:
    """Refuse a choice of nothing, or of ids that no Gaussian has; the message lists the objects that there are.

    Raises:
        InputError: no id is wanted, or one does not occur.
    """
    present = {i: count for i, count in zip(ids, counts, strict=True) if count}
    objects = {i: n for i, n in present.items() if i > 0 or len(present) <= _LISTED_IN_MESSAGES}  # 0 is mostly none
    listing = list_ids(list(objects), list(objects.values()), _LISTED_IN_MESSAGES) or "none"
    if not wanted:
        raise InputError(
            f"'{path.name}' holds several objects; choose with {flag('object_id')}, or trim several with --labels, "
            f"among these ids (Gaussians): {listing}."
        )
    if absent := sorted(set(wanted) - present.keys()):
        raise InputError(
            f"'{path.name}' has no Gaussians of object {', '.join(map(str, absent))}; its ids (Gaussians): {listing}."
        )


def assign_labels(
    n: int, numbers: NDArray[Any], weights_of: Callable[[NDArray[Any]], NDArray[Any]], gamma: float = 0.0
) -> NDArray[Any]:
    """Return the number of the object of the largest weight, (N,), 0 for the background, in the type of the numbers.

    The optimal assignment of "FlashSplat: 2D to 3D Gaussian Splatting Segmentation Solved Optimally" (Shen et al.,
    ECCV 2024), section 3: the weights of a Gaussian are scaled to unit length first.

    Args:
        n: number of Gaussians.
        numbers: of the objects, rising, (L,).
        weights_of: gives the blend weights under the background and under some objects, (N, 1 + P), for their numbers
            (P,). It is called with a few at a time: all columns together would not fit into memory.
        gamma: background bias in [-1, 1]: positive values select less, negative ones more.

    Ties go to the background, or to the lower number. Gaussians that no view saw are background whatever gamma is.

    >>> weights = np.array([[3.0, 4.0], [4.0, 3.0], [0.0, 0.0]])
    >>> assign_labels(3, np.array([1]), lambda part: weights).tolist()
    [1, 0, 0]
    >>> assign_labels(3, np.array([1]), lambda part: weights, gamma=-0.3).tolist()
    [1, 1, 0]
    """
    largest, squared_length, winner = np.zeros(n), np.zeros(n), np.zeros(n, numbers.dtype)
    for part in np.array_split(numbers, -(-len(numbers) // _OBJECTS_AT_ONCE)):
        weights = np.asarray(weights_of(part), np.float64)
        background, objects = weights[:, 0], weights[:, 1:]
        squared_length += np.square(objects).sum(axis=1)
        best, most = objects.argmax(axis=1), objects.max(axis=1)
        ahead = most > largest
        winner[ahead], largest[ahead] = part[best[ahead]], most[ahead]
    length = np.sqrt(squared_length + np.square(background))
    length[length == 0] = 1.0
    return np.where(largest / length > background / length + gamma, winner, 0)
