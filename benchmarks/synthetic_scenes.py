"""Scenes to measure speed on: large ones made from a real one, dense objects, and a random view of a given load."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.cameras import Camera, intrinsics
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.rendering.tile_renderer import project_view

KERNEL_GAUSSIANS = 50_000
KERNEL_PAIRS = 271_000
KERNEL_SIZE = 512
FULL_SH = 15


def tiled(scene: Gaussians, selection: BoolArray, n: int) -> tuple[Gaussians, BoolArray]:
    """A scene of n Gaussians with SH degree 3: the scene, and copies of it beside it, none of which is the object."""
    return copied(_with_full_sh(scene), selection, n)


def copied(scene: Gaussians, selection: BoolArray, n: int) -> tuple[Gaussians, BoolArray]:
    """A scene of n Gaussians: the scene, and copies of it beside it; the selection is of the first alone.

    Copies stand half an extent apart, so nothing changes near the object. Rows of the copies follow each row of the
    original, as the rows of an object are spread over the file of any large scene. The last copies lack rows.
    """
    tiles = -(-n // len(scene))
    if tiles <= 1:
        return scene, selection
    across = int(np.ceil(np.sqrt(tiles)))
    row, tile = np.divmod(np.arange(tiles * len(scene)), tiles)
    surplus = np.random.default_rng(0).choice(np.flatnonzero(tile > 0), len(row) - n, replace=False)
    row, tile = np.delete(row, surplus), np.delete(tile, surplus)
    extents = np.ptp(scene.means, axis=0)
    first, second = np.argsort(extents)[:0:-1]
    shift = np.zeros((n, 3), np.float32)
    shift[:, first], shift[:, second] = 1.5 * extents[first] * (tile % across), 1.5 * extents[second] * (tile // across)
    made = scene.select(row)
    return made.replace(means=made.means + shift), selection[row] & (tile == 0)


def _with_full_sh(gaussians: Gaussians) -> Gaussians:
    missing = FULL_SH - gaussians.sh_rest.shape[2]
    return gaussians.replace(sh_rest=np.pad(gaussians.sh_rest, ((0, 0), (0, 0), (0, missing))), extras={})


def kernel_view() -> tuple[Gaussians, Camera, int]:
    """Random Gaussians of SH degree 0 that fill a view, and the number of pairs of a Gaussian and a tile it reaches.

    Their size is found by bisection, so that the pairs are as many as asked for within one per cent.
    """
    rng = np.random.default_rng(0)
    n = KERNEL_GAUSSIANS
    camera = Camera(np.eye(4), intrinsics(np.radians(60), KERNEL_SIZE, KERNEL_SIZE), KERNEL_SIZE, KERNEL_SIZE)
    depth = rng.uniform(2, 6, n)
    means = np.column_stack([*(np.tan(np.radians(30)) * rng.uniform(-1, 1, (2, n)) * depth), depth])
    sizes = rng.normal(0, 0.5, (n, 3)) + np.log(depth)[:, None]
    gaussians = Gaussians(
        means.astype(np.float32),
        sizes.astype(np.float32),
        rng.normal(size=(n, 4)).astype(np.float32),
        rng.uniform(-3, 3, n).astype(np.float32),
        rng.normal(0, 1, (n, 3)).astype(np.float32),
        np.zeros((n, 3, 0), np.float32),
    )
    low, high = np.log(1e-4), np.log(1e-1)
    while True:
        middle = (low + high) / 2
        scaled = gaussians.replace(log_scales=gaussians.log_scales + np.float32(middle))
        pairs = int(project_view(scaled, camera).tile_starts[-1])
        if abs(pairs - KERNEL_PAIRS) < 0.01 * KERNEL_PAIRS:
            return scaled, camera, pairs
        low, high = (middle, high) if pairs < KERNEL_PAIRS else (low, middle)
