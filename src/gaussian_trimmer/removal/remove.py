"""The scene without an object: find what it hid and what it stood on, take out the one and inpaint the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians
from gaussian_trimmer.removal.hidden import find_hidden
from gaussian_trimmer.removal.inpainting import inpaint_surfaces
from gaussian_trimmer.removal.surfaces import find_surfaces
from gaussian_trimmer.removal.views import RemovalViews

NO_SURFACE = "no flat surface that the object stands on or leans against was found, so nothing was made up where it was"
NOT_SEEN = "too little is seen of the surfaces around the object, so nothing was made up where it was"


@dataclass(frozen=True, eq=False)
class Removal:
    """What changes when an object leaves a scene, for the N Gaussians of its views."""

    occluded_interior: BoolArray
    """Gaussians of nobody that only the object hid, (N,)."""
    fragments_of_object: BoolArray
    """Gaussians that belong to the object without changing how it looks, (N,)."""
    inpainted: Gaussians
    """New Gaussians, which continue the surfaces that the object stood on or leaned against."""
    replaced: BoolArray
    """Gaussians that these take the place of, (N,)."""
    relight_factor: Float64Array
    """How many times brighter each Gaussian is without the object's shadow, at least 1, (N,)."""
    not_filled: str | None
    """Why nothing was inpainted; None if something was, or was not asked for."""


def remove(views: RemovalViews, *, fill: bool) -> Removal:
    """Return what changes when an object leaves its scene.

    Args:
        views: the object from all around.
        fill: inpaint the surfaces that the object stood on or leaned against.
    """
    surfaces = find_surfaces(views.gaussians.means, views.removed, views.total_visible, views.bounds)
    interior, fragments, isolated = find_hidden(views, surfaces)
    found = inpaint_surfaces(views, surfaces, interior | fragments, isolated) if fill and surfaces else None
    not_filled = None if found or not fill else NOT_SEEN if surfaces else NO_SURFACE
    n = len(views.gaussians)
    inpainted, replaced, factor = found or (views.gaussians.select(slice(0)), np.zeros(n, np.bool_), np.ones(n))
    return Removal(interior, fragments, inpainted, replaced, factor, not_filled)
