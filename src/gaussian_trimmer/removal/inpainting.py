"""Inpaint the surfaces behind an object: new Gaussians in the hole, and no shadow around it.

Nobody has seen the surface there, so what is new is a guess: it continues what is seen around it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import (
    SH_C0,
    BoolArray,
    Float64Array,
    FloatArray,
    Gaussians,
    concatenate,
    logit,
    quaternions_of,
)
from gaussian_trimmer.removal.relief import copy_relief
from gaussian_trimmer.removal.shift_map import inpaint_shift_map
from gaussian_trimmer.removal.surface_picture import PIXELS_A_RADIUS, SurfacePicture, take_picture
from gaussian_trimmer.removal.views import THICKNESS_RADII, RemovalViews, Surface
from gaussian_trimmer.views.view import HALF, grown

_RIM_PIXELS = 4
"""Pixels around a hole that are filled, too, since their colours are already those of the object."""
_MAX_VISIBLE_SHARE = 0.6
"""Blend weight in the scene, relative to that without the object, of Gaussians below the new ones that go."""
_DEPTH_RADII, _HEIGHT_RADII = 0.6, 0.1
"""How far below and above the surface they lie, in object radii."""
_SINK_RADII = 0.01
"""Depth of the new Gaussians below the surface: above it they would hide the object's foot."""
_OVERLAP, _FLATNESS = 0.75, 0.1
"""Standard deviations of new Gaussians along and across the surface, in widths of the squares that they stand for."""
_OPACITY = 0.95
_SQUARES = (4, 2, 1)
"""Widths of these squares in pixels, the largest first."""
_ALIKE = 0.02
"""Range of colours in a square that one Gaussian may stand for."""
_LEAST_RELIGHT_FACTOR = 1.02
"""Gaussians in a shadow that makes them less dark than this stay as they are."""


def inpaint_surfaces(
    views: RemovalViews, surfaces: Sequence[Surface], gone: BoolArray, unoccluded: FloatArray
) -> tuple[Gaussians, BoolArray, Float64Array]:
    """Return new Gaussians where the object hid the surfaces, those that they replace (N,), and relight factors (N,).

    The factors are how many times brighter each Gaussian is without the object's shadow, at least 1.

    Args:
        views: the object from all around.
        surfaces: what it stands on, hangs on or leans against.
        gone: what only the object hid, and fragments of it, (N,).
        unoccluded: blend weight of each Gaussian in the views without the object, (N,).
    """
    gaussians, background = views.gaussians, ~(views.removed | gone)
    visible = views.total_visible > _MAX_VISIBLE_SHARE * unoccluded
    replaced, factor = np.zeros(len(gaussians), np.bool_), np.ones(len(gaussians))
    new = [gaussians.select(slice(0))]
    for surface in surfaces:
        picture = take_picture(views, surface, surfaces, unoccluded, gone)
        if not picture.hole.any():
            continue
        hole = grown(picture.hole, _RIM_PIXELS) & ~picture.empty
        rgb, relight = inpaint_shift_map(picture.rgb, picture.known, hole)
        hole &= where_it_is(picture, hole)
        relief = copy_relief(gaussians, background & visible, picture, surfaces, hole, rgb, relight)
        copies, low, high = relief or (gaussians.select(slice(0)), -_SINK_RADII, 0.0)
        new.append(copies)
        new.append(_new_gaussians(picture, hole, rgb, -low, gaussians.sh_rest.shape[2]))
        (rows, columns), inside = picture.pixels_of(gaussians.means)
        inside &= background
        height = surface.heights(gaussians.means)
        there = inside & hole[rows, columns] & (height < max(high, _HEIGHT_RADII))
        replaced |= there & ((height > -_HEIGHT_RADII) | ((height > -_DEPTH_RADII) & ~visible))
        in_it = inside & (np.abs(height) < THICKNESS_RADII)
        factor = np.where(in_it, np.maximum(factor, relight[rows, columns]), factor)
    return concatenate(new), replaced, np.where(replaced | (factor < _LEAST_RELIGHT_FACTOR), 1, factor)


def where_it_is(picture: SurfacePicture, hole: BoolArray) -> BoolArray:
    """Return where in a hole (P, P) the surface goes on rather than ends, as most of what is around it does, (P, P)."""
    if not (grown(hole, 1) & picture.empty).any():
        return np.ones_like(hole)
    around = (picture.known | picture.empty) & ~hole
    return np.asarray(continued(picture.empty.astype(np.float64), around, hole) <= HALF)


def continued(image: Float64Array, known: BoolArray, hole: BoolArray) -> Float64Array:
    """Return an image (H, W) in which a hole is harmonic: each of its pixels is the mean of those beside it.

    Args:
        image: the values.
        known: pixels that count, (H, W); others than these and the hole are left out.
        hole: pixels to be filled, (H, W), none of them known. Zero where nothing known is beside it.
    """
    from scipy.sparse import csr_array, diags_array
    from scipy.sparse.linalg import spsolve

    n, number, inside = np.count_nonzero(hole), np.full(hole.shape, -1), known | hole
    number[hole] = np.arange(n)
    first, last, every = slice(None, -1), slice(1, None), slice(None)
    count, sums, links = np.full(n, 1e-9), np.zeros(n), []
    for here, there in [((first, every), (last, every)), ((every, first), (every, last))]:
        for one, other in [(here, there), (there, here)]:
            beside = hole[one] & inside[other]
            rows, others = number[one][beside], number[other][beside]
            rim = others < 0
            count += np.bincount(rows, minlength=n)
            sums += np.bincount(rows[rim], image[other][beside][rim], minlength=n)
            links.append([rows[~rim], others[~rim]])
    rows, columns = np.concatenate(links, axis=1)
    matrix = diags_array(count) - csr_array((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    filled = image.copy()
    filled[hole] = spsolve(matrix.tocsc(), sums)
    return filled


def _new_gaussians(picture: SurfacePicture, hole: BoolArray, rgb: FloatArray, sink: float, rest: int) -> Gaussians:
    """Return flat Gaussians below the surface, one for each square of the hole that has about one colour."""
    left, surface, everywhere = hole.copy(), picture.surface, picture.coordinates
    parts: list[tuple[Float64Array, FloatArray, Float64Array]] = []
    for width in _SQUARES:
        size = len(hole) // width
        whole = np.array(left.reshape(size, width, size, width).all(axis=(1, 3)))
        colours, places = (
            image.reshape(size, width, size, width, 3).swapaxes(1, 2)[whole].reshape(-1, width * width, 3)
            for image in (rgb, everywhere)
        )
        alike = np.ptp(colours, axis=1).max(axis=1) <= (_ALIKE if width > 1 else 1)
        whole[whole] = alike
        widths = np.full(np.count_nonzero(alike), width / PIXELS_A_RADIUS)
        parts.append((places[alike].mean(axis=1), colours[alike].mean(axis=1), widths))
        left &= ~np.repeat(np.repeat(whole, width, axis=0), width, axis=1)
    coordinates, colour, widths = (np.concatenate(column) for column in zip(*parts, strict=True))
    widths = widths[:, None] * surface.unit * np.array([1, 1, _FLATNESS])
    points, turn = surface.points(coordinates - [0, 0, sink]), quaternions_of(surface.axes.T[None])
    return made_up(points, widths, turn, colour, rest)


def made_up(points: Float64Array, widths: Float64Array, turn: NDArray[Any], rgb: FloatArray, rest: int) -> Gaussians:
    """Return nearly opaque Gaussians that stand for squares beside each other.

    Args:
        points: centres, (N, 3).
        widths: of the squares along the axes, in scene units, (N, 3).
        turn: quaternion of all of them, (1, 4).
        rgb: colours, the same from everywhere, (N, 3).
        rest: number of higher harmonics of a channel.
    """
    n = len(points)
    return Gaussians(
        points.astype(np.float32),
        np.log(_OVERLAP * widths).astype(np.float32),
        np.tile(turn.astype(np.float32), (n, 1)),
        np.full(n, logit(np.array(_OPACITY)), np.float32),
        ((rgb - 0.5) / SH_C0).astype(np.float32),
        np.zeros((n, 3, rest), np.float32),
    )


def scale_radiance(gaussians: Gaussians, factor: FloatArray | Float64Array) -> Gaussians:
    """Return the Gaussians with their radiance times a factor (N,), from wherever they are seen."""
    scale = factor.astype(np.float32)[:, None]
    sh_dc = ((0.5 + SH_C0 * gaussians.sh_dc) * scale - 0.5) / SH_C0
    return gaussians.replace(sh_dc=sh_dc.astype(np.float32), sh_rest=gaussians.sh_rest * scale[..., None])
