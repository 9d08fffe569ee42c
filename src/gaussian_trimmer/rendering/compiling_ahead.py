"""Kernels that a first trim needs late, compiled in a process of their own while it compiles those that it needs first.

python -m gaussian_trimmer.rendering.compiling_ahead
"""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numba
from numba import boolean, float32, float64, int32, int64, uint8

from gaussian_trimmer.rendering import gradient_kernels
from gaussian_trimmer.rendering.projection_kernels import Ellipsoids, Pinhole, Tiles

types: Any = numba.types
_TABLE, _IMAGES = float32[:, ::1], float32[:, :, ::1]
_TILES = types.NamedTuple((int64, int64[::1], int32[::1], uint8[:, ::1], int64, int64), Tiles)
_ELLIPSOIDS = types.NamedTuple((_TABLE, _TABLE, _TABLE, float32[::1]), Ellipsoids)
_PINHOLE = types.NamedTuple((float64[:, ::1], float64[::1], float64[::1], float64[::1]), Pinhole)
_SHOWN, _SUMS = types.UniTuple(_IMAGES, 2), types.Tuple((_TABLE, boolean[::1]))


def start_compiling() -> None:
    """Compile in another process, which nothing waits for: its kernels are found in the cache when they are called."""
    command = [sys.executable, "-m", __name__]
    subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def compile_kernels() -> None:
    """Compile the derivatives' kernels by the types that they are called with."""
    kernels = gradient_kernels
    kernels.huber_gradient.compile((_IMAGES, _IMAGES, _IMAGES, float32))
    kernels.differentiate_tiles.compile((_TABLE, _TABLE, boolean[::1], _TILES, _SHOWN, _SUMS, types.UniTuple(int64, 2)))
    kernels.sum_moving_pairs.compile((_TABLE, int64[::1], int32[::1], boolean[::1], _TABLE))
    kernels.gather.compile((_ELLIPSOIDS, _PINHOLE, _TABLE, _TABLE, _TABLE, _TABLE))


if __name__ == "__main__":
    compile_kernels()
