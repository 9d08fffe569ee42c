"""The scene without an object: find what it hid and what it stood on, take out the one and inpaint the other."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians, IntArray, concatenate
from gaussian_trimmer.removal.gaps import close_gaps
from gaussian_trimmer.removal.hidden import find_hanging, find_hidden
from gaussian_trimmer.removal.inpainting import inpaint_surfaces, scale_radiance
from gaussian_trimmer.removal.surfaces import find_surfaces
from gaussian_trimmer.removal.views import RemovalViews

NO_SURFACE = "there is no flat surface that is seen to go on under or behind the object"
CLOSED = "No flat surface is seen to go on behind the object; what it hid is a guess that goes on from around it."


@dataclass(frozen=True, eq=False)
class Removal:
    """What changes when an object leaves a scene, for the N Gaussians of its views."""

    discarded: BoolArray
    """Gaussians of nobody that only the object hid or held, and fragments and remnants of it, (N,)."""
    inpainted: Gaussians
    """New Gaussians, which continue the surfaces that the object stood on or leaned against."""
    replaced: BoolArray
    """Gaussians that these take the place of, (N,)."""
    relight_factor: Float64Array
    """How many times brighter each Gaussian is without the object's shadow, at least 1, (N,)."""
    not_filled: str | None
    """Why nothing was inpainted; None if something was, or was not asked for."""
    warnings: tuple[str, ...] = ()
    """What a look at the scene without the object should know, a sentence each."""


def remove(views: RemovalViews, *, fill: bool, with_standing: bool = False) -> Removal:
    """Return what changes when an object leaves its scene.

    Args:
        views: the object from all around.
        fill: inpaint the surfaces that the object stood on or leaned against, and close what gapes all the same.
        with_standing: the things that stand on the object leave with it.
    """
    surfaces, leaving = find_surfaces(views), np.zeros(len(views.gaussians), np.bool_)
    while True:
        gone, unoccluded = find_hidden(views, surfaces)
        things, remnants, splinters = find_hanging(views, gone, surfaces)
        more = remnants | (things > 0) if with_standing else remnants
        if not more.any():
            break
        leaving |= more
        views = replace(views, of_object=views.of_object | more, removed=views.removed | more)
    gone |= splinters
    found = inpaint_surfaces(views, surfaces, gone, unoccluded) if fill and surfaces else None
    n = len(views.gaussians)
    inpainted, replaced, factor = found or (views.gaussians.select(slice(0)), np.zeros(n, np.bool_), np.ones(n))
    stays, warnings = ~(views.removed | gone | replaced), _what_stays(things)
    if fill:
        background = concatenate([scale_radiance(views.gaussians.select(stays), factor[stays]), inpainted])
        closing = close_gaps(views, background)
        inpainted = concatenate([inpainted, closing])
        warnings += (CLOSED,) if len(closing) and not surfaces else ()
    not_filled = NO_SURFACE if fill and not len(inpainted) else None
    return Removal(gone | leaving, inpainted, replaced, factor, not_filled, warnings)


def _what_stays(things: IntArray) -> tuple[str, ...]:
    """Return the warning that numbered things (N,) stay where nothing holds them, if there are any."""
    count = int(things.max(initial=0))
    sizes = ", ".join(f"{size:,}" for size in sorted(np.bincount(things)[1:], reverse=True))
    some = "1 thing" if count == 1 else f"{count} things"
    cure = f"--with-what-stands-on-it discards {'it' if count == 1 else 'them'}, too"
    return (f"{some} that only the object holds ({sizes} Gaussians) will hang in the air; {cure}.",) if count else ()
