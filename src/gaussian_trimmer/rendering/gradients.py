"""Derivatives of a view by the parameters of its Gaussians, on the CPU: what a fit by gradients needs."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numba
import numpy as np
from numba import boolean, float32, float64, int32, int64, uint8

from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.parallel import for_each, parallel_for
from gaussian_trimmer.rendering import gradient_kernels as kernels
from gaussian_trimmer.rendering.numba_kernels import sum_pairs
from gaussian_trimmer.rendering.projection import ellipsoids_of, pinhole_of
from gaussian_trimmer.rendering.projection_kernels import Ellipsoids, Pinhole, Tiles
from gaussian_trimmer.rendering.tile_renderer import Drawing, sum_over_tiles

types: Any = numba.types
_TABLE, _IMAGES = float32[:, ::1], float32[:, :, ::1]
_TILES = types.NamedTuple((int64, int64[::1], int32[::1], uint8[:, ::1], int64[:, ::1]), Tiles)
_ELLIPSOIDS = types.NamedTuple((_TABLE, _TABLE, _TABLE, float32[::1]), Ellipsoids)
_PINHOLE = types.NamedTuple((float64[:, ::1], float64[::1], float64[::1], float64[::1]), Pinhole)
_SHOWN, _SUMS = types.UniTuple(_IMAGES, 2), types.Tuple((_TABLE, boolean[::1]))


def loss_gradient(drawing: Drawing, picture: FloatArray, weight: FloatArray, delta: float) -> FloatArray:
    """Return derivatives of the weighted sum of sqrt(d^2 + delta^2) by what views show, d their errors.

    Args:
        drawing: the views, in colour.
        picture, weight: colour and alpha that they should have, and how much each counts, as pictures (4, T, A).
        delta: Huber delta, the difference beyond which it counts in proportion rather than by its square.

    Returns:
        For colour and alpha of all pixels, (4, T, A).
    """
    return np.asarray(kernels.huber_gradient(drawing.tiled, picture, weight, np.float32(delta)))


def gradients(drawing: Drawing, slopes: FloatArray, moving: BoolArray) -> FloatArray:
    """Return derivatives of a loss by the parameters of K Gaussians, for each of V views, (V, K, 13).

    The columns are: mean in scene units (3), log-scales (3), turn about the Gaussian's own axes in radians (3), opacity
    logit, sh_dc (3). That a colour changes with the direction of view is left out, since fitted Gaussians move by
    fractions of their size.

    Args:
        drawing: the views, in colour.
        slopes: derivatives of the loss by colour and alpha of each pixel, (4, T, A).
        moving: which Gaussians are asked for, (N,), K of them.
    """
    gaussians, projection = drawing.gaussians, drawing.projection
    moves = moving[projection.rows]
    sums = np.zeros((len(projection.rows), kernels.N_SUMS), np.float32)
    for tiles in projection.parts(kernels.N_SUMS):
        pairs = np.zeros((len(tiles.lists), kernels.N_SUMS), np.float32)
        busy = np.zeros(len(tiles.starts) - 1, np.bool_)
        images, out = (drawing.tiled, slopes), (pairs, busy)
        parallel_for(
            lambda first, last, tiles=tiles, images=images, out=out: kernels.differentiate_tiles(  # type: ignore[misc]
                projection.splats, projection.colours, moves, tiles, images, out, (first, last)
            ),
            len(busy),
        )
        sum_over_tiles(projection, tiles, pairs, busy, sums)
    place = np.cumsum(moving) - 1
    derivatives = np.zeros((len(drawing.cameras), np.count_nonzero(moving), kernels.N_PARAMETERS), np.float32)

    def gather(view: int) -> None:
        drawn, camera = projection.drawn(view), drawing.cameras[view]
        chosen = drawn.start + np.flatnonzero(moves[drawn])
        rows = projection.rows[chosen]
        found = np.empty((len(rows), kernels.N_PARAMETERS), np.float32)
        pinhole, ellipsoids = pinhole_of(camera, gaussians.antialiased), ellipsoids_of(gaussians, rows)
        kernels.gather(ellipsoids, pinhole, projection.splats[chosen], projection.colours[chosen], sums[chosen], found)
        derivatives[view, place[rows]] = found

    for_each(gather, range(len(drawing.cameras)))
    return derivatives


def start_compiling() -> None:
    """Compile the derivatives' kernels, which a first trim needs late, in a process that nothing waits for.

    They are found in the cache when they are called.
    """
    command = [sys.executable, "-c", f"import {__name__} as gradients; gradients.compile_kernels()"]
    subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def compile_kernels() -> None:
    """Compile these kernels by the types that they are called with."""
    kernels.huber_gradient.compile((_IMAGES, _IMAGES, _IMAGES, float32))
    kernels.differentiate_tiles.compile((_TABLE, _TABLE, boolean[::1], _TILES, _SHOWN, _SUMS, types.UniTuple(int64, 2)))
    sum_pairs.compile((_TABLE, int64[::1], int32[::1], boolean[::1], _TABLE))
    kernels.gather.compile((_ELLIPSOIDS, _PINHOLE, _TABLE, _TABLE, _TABLE, _TABLE))
