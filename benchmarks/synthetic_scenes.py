"""Scenes to measure speed on: large ones made from a real one."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Gaussians

FULL_SH = 15


def tiled(scene: Gaussians, selection: BoolArray, n: int) -> tuple[Gaussians, BoolArray]:
    """A scene of n Gaussians with SH degree 3: the scene, and copies of it beside it, none of which is the object."""
    return copied(_with_full_sh(scene), selection, n)


def copied(scene: Gaussians, selection: BoolArray, n: int) -> tuple[Gaussians, BoolArray]:
    """A scene of n Gaussians: the scene, and copies of it beside it; the selection is of the first alone.

    Copies stand half an extent apart, so nothing changes near the object. Rows of the copies follow each row of the
    original, as the rows of an object are spread over the file of any large scene. The last copies lack rows. Each copy
    has a tint that nobody sees, since no Gaussians of a capture are alike.
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
    tint = 1 + 1e-5 * tile.astype(np.float32)
    return made.replace(means=made.means + shift, sh_dc=made.sh_dc * tint[:, None]), selection[row] & (tile == 0)


def _with_full_sh(gaussians: Gaussians) -> Gaussians:
    missing = FULL_SH - gaussians.sh_rest.shape[2]
    return gaussians.replace(sh_rest=np.pad(gaussians.sh_rest, ((0, 0), (0, 0), (0, missing))), extras={})
