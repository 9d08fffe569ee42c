"""The scene without an object: find what it hid and what it stood on, leave out the one and let the other go on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians
from gaussian_trimmer.removal.continuation import Continuation, continue_surfaces
from gaussian_trimmer.removal.ghosts import find_hidden
from gaussian_trimmer.removal.place import Place
from gaussian_trimmer.removal.surfaces import find_surfaces

NO_SURFACE = "no flat surface that the object stands on or leans against was found, so nothing was made up where it was"
NOT_SEEN = "too little is seen of the surfaces around the object, so nothing was made up where it was"


@dataclass(frozen=True, eq=False)
class Removal:
    """What the scene is without an object, for the N Gaussians of its place."""

    to_object: BoolArray
    """Gaussians that belong to the object without changing how it looks, (N,)."""
    ghosts: BoolArray
    """Gaussians that only the object hid, (N,)."""
    filled: Gaussians
    """New Gaussians, which continue the surfaces that the object stood on or leaned against."""
    replaced: BoolArray
    """Gaussians that these take the place of, (N,)."""
    gain: Float64Array
    """How many times brighter each Gaussian is without the object's shadow, at least 1, (N,)."""
    not_filled: str | None
    """Why nothing was made up; None if something was, or was not to be."""


def remove(place: Place, *, fill: bool) -> Removal:
    """The scene without an object.

    Args:
        place: the object in views from all around.
        fill: let the surfaces that the object stood on or leaned against go on where it hid them.
    """
    surfaces = find_surfaces(place.gaussians.means, place.removed, place.seen.sum(axis=1), place.bounds)
    hidden = find_hidden(place, surfaces)
    going_on = continue_surfaces(place, surfaces, hidden) if fill and surfaces else None
    not_filled = None
    if fill and going_on is None:
        not_filled = NOT_SEEN if surfaces else NO_SURFACE
    n, none = len(place.gaussians), place.gaussians.select(slice(0))
    going_on = going_on or Continuation(none, np.zeros(n, np.bool_), np.ones(n))
    return Removal(
        to_object=hidden.to_object,
        ghosts=hidden.ghosts,
        filled=going_on.filled,
        replaced=going_on.replaced,
        gain=going_on.gain,
        not_filled=not_filled,
    )
