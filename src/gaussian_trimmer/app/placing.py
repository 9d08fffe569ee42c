"""Gaussians moved to where other programs want them: standing on the origin, y up. M Gaussians."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians, quaternions_of, rotation_matrices
from gaussian_trimmer.geometry.bounds import up_frame
from gaussian_trimmer.rendering.reference import sh_basis

_Z_UP_TO_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
_FOOT_QUANTILE = 0.01
"""Share of the Gaussians that may lie below the foot: those that stick out of it."""
_DIRECTIONS = 200


def stood_upright(gaussians: Gaussians, up: Float64Array) -> Gaussians:
    """The Gaussians with their foot at the origin and y up, as large as they were."""
    turn = _Z_UP_TO_Y_UP @ up_frame(up)
    means = gaussians.means.astype(np.float64) @ turn.T
    foot = np.median(means, axis=0)
    foot[1] = np.quantile(means[:, 1], _FOOT_QUANTILE)
    rotations = turn @ rotation_matrices(gaussians.quaternions)
    return gaussians.replace(
        means=(means - foot).astype(np.float32),
        quaternions=quaternions_of(rotations),
        sh_rest=turned_harmonics(gaussians.sh_rest, turn),
    )


def turned_harmonics(sh_rest: FloatArray, turn: Float64Array) -> FloatArray:
    """Coefficients (M, 3, K) of colours that have been turned by a rotation, (3, 3)."""
    turned = sh_rest.copy()
    directions = np.random.default_rng(0).normal(size=(_DIRECTIONS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    here, there = sh_basis(directions), sh_basis(directions @ turn)  # row vectors: R^-1 d
    for degree in (1, 2, 3):
        columns = slice(degree**2, (degree + 1) ** 2)  # a degree's harmonics stay among themselves
        rest = slice(columns.start - 1, columns.stop - 1)
        if rest.stop <= sh_rest.shape[2]:
            change = np.linalg.lstsq(here[:, columns], there[:, columns], rcond=None)[0]
            turned[:, :, rest] = sh_rest[:, :, rest] @ change.T.astype(np.float32)
    return turned
