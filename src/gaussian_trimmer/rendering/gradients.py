"""Derivatives of a view by the parameters of its Gaussians, on the CPU: what a fit by gradients needs."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numba import boolean, float32, float64, int32, int64, uint8

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.parallel import WORTH_A_THREAD, parallel_for
from gaussian_trimmer.rendering import gradient_kernels as kernels
from gaussian_trimmer.rendering.projection_kernels import Ellipsoids, Pinhole, Tiles
from gaussian_trimmer.rendering.tile_renderer import (
    Projection,
    blend_view,
    ellipsoids_of,
    pinhole_of,
    project_view,
    whole_tiles,
)

types: Any = numba.types
_TABLE, _IMAGES = float32[:, ::1], float32[:, :, ::1]
_TILES = types.NamedTuple((int64, int64[::1], int32[::1], uint8[:, ::1], int64, int64), Tiles)
_ELLIPSOIDS = types.NamedTuple((_TABLE, _TABLE, _TABLE, float32[::1]), Ellipsoids)
_PINHOLE = types.NamedTuple((float64[:, ::1], float64[::1], float64[::1], float64[::1]), Pinhole)
_SHOWN, _SUMS = types.UniTuple(_IMAGES, 2), types.Tuple((_TABLE, boolean[::1]))


@dataclass(frozen=True, eq=False)
class Drawing:
    """A view that was drawn, and what is needed to differentiate it."""

    gaussians: Gaussians
    camera: Camera
    projection: Projection
    padded: FloatArray
    """Colour, depth and alpha, (5, H', W'), with H' and W' rounded up to whole tiles."""

    @property
    def image(self) -> FloatArray:
        """Colour and alpha, (4, H, W)."""
        return self.padded[[0, 1, 2, 4], : self.camera.height, : self.camera.width]

    @property
    def depth(self) -> FloatArray:
        """Depth as in `Rendering`, (H, W)."""
        depth, alpha = self.padded[3:, : self.camera.height, : self.camera.width]
        return np.asarray(np.divide(depth, alpha, out=np.zeros_like(depth), where=alpha > 0))

    @property
    def reached(self) -> BoolArray:
        """Which tiles any Gaussian reaches, (T,)."""
        return np.diff(self.projection.tile_starts) > 0

    def weigh(self, images: FloatArray) -> FloatArray:
        """Sum over pixels of each Gaussian's blend weight times each of the images (L, H, W), (N, L)."""
        nothing = np.zeros((len(self.projection.rows), 0), np.float32)
        sums = blend_view(self.projection, nothing, self.camera, images)[1]
        return self.projection.scattered(sums, len(self.gaussians))


def draw(gaussians: Gaussians, camera: Camera) -> Drawing:
    """Draw a view as `rendering.render` does, without keeping anything for later calls."""
    projection = project_view(gaussians, camera)
    return Drawing(gaussians, camera, projection, blend_view(projection, projection.colours, camera)[0])


def draw_with(
    gaussians: Gaussians, camera: Camera, values: FloatArray, wanted: BoolArray | None = None
) -> tuple[Drawing, FloatArray]:
    """Draw a view, and with it values of the Gaussians that are blended like colours.

    Args:
        gaussians: N Gaussians.
        camera: the view.
        values: of the Gaussians, (N, C).
        wanted: tiles to draw, (T,), as `Drawing.reached` gives them; others stay empty. None: all.

    Returns:
        The view, and the sum over Gaussians of blend weight times values at each pixel, (C, H, W).
    """
    projection = project_view(gaussians, camera, wanted)
    blended = blend_view(projection, np.concatenate([projection.colours, values[projection.rows]], axis=1), camera)[0]
    drawing = Drawing(gaussians, camera, projection, np.concatenate([blended[:4], blended[-1:]]))
    return drawing, blended[4:-1, : camera.height, : camera.width]


def loss_gradient(drawing: Drawing, picture: FloatArray, weight: FloatArray, delta: float) -> FloatArray:
    """Return derivatives of the weighted sum of sqrt(d^2 + delta^2) by what a view shows, d its error.

    Args:
        drawing: the view.
        picture, weight: colour and alpha that it should have, and how much each counts, (4, H, W).
        delta: Huber delta, the difference beyond which it counts in proportion rather than by its square.

    Returns:
        For colour and alpha of all pixels of whole tiles, (4, H', W').
    """
    return np.asarray(kernels.huber_gradient(drawing.padded, picture, weight, np.float32(delta)))


def gradients(drawing: Drawing, slopes: FloatArray, moving: BoolArray) -> FloatArray:
    """Return derivatives of a loss by the parameters of Gaussians, (N, 13).

    The columns are: mean in scene units (3), log-scales (3), turn about the Gaussian's own axes in radians (3), opacity
    logit, sh_dc (3). That a colour changes with the direction of view is left out, since fitted Gaussians move by
    fractions of their size.

    Args:
        drawing: the view.
        slopes: derivatives of the loss by colour and alpha of each pixel, (4, H, W), or of whole tiles.
        moving: which Gaussians are asked for, (N,); the rows of the others are zero.
    """
    camera, gaussians, projection = drawing.camera, drawing.gaussians, drawing.projection
    padded = whole_tiles(np.asarray(slopes, np.float32))
    moves = moving[projection.rows]
    sums = np.zeros((len(projection.rows), kernels.N_SUMS), np.float32)
    for tiles in projection.parts(camera, kernels.N_SUMS):
        pairs = np.zeros((len(tiles.lists), kernels.N_SUMS), np.float32)
        busy = np.zeros(len(tiles.starts) - 1, np.bool_)
        images, out = (drawing.padded, padded), (pairs, busy)
        parallel_for(
            lambda first, last, tiles=tiles, images=images, out=out: kernels.differentiate_tiles(  # type: ignore[misc]
                projection.splats, projection.colours, moves, tiles, images, out, (first, last)
            ),
            len(busy),
        )
        kernels.sum_moving_pairs(pairs, tiles.starts, tiles.lists, busy, sums)
    chosen = np.flatnonzero(moves)
    rows = projection.rows[chosen]
    found = np.empty((len(rows), kernels.N_PARAMETERS), np.float32)
    pinhole = pinhole_of(camera, gaussians.antialiased)
    splats, colours, sums = projection.splats[chosen], projection.colours[chosen], sums[chosen]

    def gather(first: int, last: int) -> None:
        part = slice(first, last)
        ellipsoids = ellipsoids_of(gaussians, rows[part])
        kernels.gather(ellipsoids, pinhole, splats[part], colours[part], sums[part], found[part])

    parallel_for(gather, len(rows), at_least=WORTH_A_THREAD)
    derivatives = np.zeros((len(gaussians), kernels.N_PARAMETERS), np.float32)
    derivatives[rows] = found
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
    kernels.sum_moving_pairs.compile((_TABLE, int64[::1], int32[::1], boolean[::1], _TABLE))
    kernels.gather.compile((_ELLIPSOIDS, _PINHOLE, _TABLE, _TABLE, _TABLE, _TABLE))
