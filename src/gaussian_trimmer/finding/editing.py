"""Corrections of what was found: objects that are one, and objects that are several."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.finding.found import FoundObjects
from gaussian_trimmer.gaussians import BoolArray, IntArray
from gaussian_trimmer.surface.regions import split_region
from gaussian_trimmer.surface.visible_surface import find_visible_surface, views_of, with_hidden


def chosen_objects(
    found: FoundObjects,
    *,
    keep: Sequence[int] | None = None,
    merge: Iterable[Sequence[int]] = (),
    split: Iterable[int] = (),
    names: Mapping[int, str] | None = None,
) -> dict[str, BoolArray]:
    """Return rough selections (N,) of the objects that are wanted, by their names, as `trim_objects` takes them.

    Args:
        found: the objects.
        keep: numbers of those that are wanted; without it, the sure ones.
        merge: numbers of objects that are one.
        split: numbers of objects that are several; each falls apart into its main parts, named 3a, 3b and so on.
        names: what to call objects; else by their numbers.

    Raises:
        InputError: a number is none of an object, or two objects have the same name, or none is left.
    """
    names = names or {}
    kept = list(keep) if keep is not None else [one.id for one in found if one.sure and one.kind == "object"]
    masks = {number: found.mask(number) for number in kept}
    for group in merge:
        together = np.any([found.mask(number) for number in group], axis=0)
        first = next((number for number in group if number in masks), group[0])
        for number in group:
            masks.pop(number, None)
        masks[first] = together
    selections: dict[str, BoolArray] = {}
    several = set(split)
    for number in sorted(masks):
        name, mask = names.get(number, str(number)), masks[number]
        parts = _parts(found, mask) if number in several else [mask]
        if number in several and len(parts) == 1:
            raise InputError(f"Object {number} does not fall apart; select its parts by clicks or boxes: select SCENE.")
        for place, part in enumerate(parts):
            key = name + (chr(ord("a") + place) if len(parts) > 1 else "")
            if key in selections:
                raise InputError(f"Two objects are called '{key}'; give each another name.")
            selections[key] = part
    if not selections:
        raise InputError("No object is left; name those to keep, as in --keep 1 or keep=[1].")
    return selections


def _parts(found: FoundObjects, mask: BoolArray) -> list[BoolArray]:
    """Return the main parts of an object, (N,) each; an object of a large capture is looked at by itself for that."""
    surface, scene, rows = found.surface, found.scene, np.arange(len(mask))
    if surface is None:
        rows = np.flatnonzero(mask)
        scene = found.scene.select(rows)
        up = found.up.direction
        surface = find_visible_surface(scene, views_of(scene, None, up), up)
    numbers: IntArray = split_region(surface, mask[rows[surface.rows]])
    labels = np.zeros(len(mask), np.int64)
    labels[rows] = with_hidden(surface, numbers + 1, np.inf, np.arange(len(scene)))
    return [mask & (labels == number) for number in range(1, int(numbers.max()) + 2)]
