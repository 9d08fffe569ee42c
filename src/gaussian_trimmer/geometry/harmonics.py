"""Spherical harmonics of view-dependent colour, and turning Gaussians with them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians, quaternions_of, rotation_matrices

_BAND_ENDS = (0, 3, 8, 15)
"""Where the coefficients of degrees 1, 2 and 3 begin and end."""
_ROWS_AT_ONCE = 1 << 18


def sh_basis(directions: Float64Array) -> Float64Array:
    """Return real spherical harmonics of degrees 0 to 3 at unit directions (N, 3), as (N, 16).

    Ordered by degree l, then by m from -l to l; odd m carry the Condon-Shortley sign, as trained models expect.
    """
    x, y, z = directions.T
    xx, yy, zz = x * x, y * y, z * z
    polynomials = [
        (1 / 4, np.ones_like(x)),
        (3 / 4, -y),
        (3 / 4, z),
        (3 / 4, -x),
        (15 / 4, x * y),
        (15 / 4, -y * z),
        (5 / 16, 2 * zz - xx - yy),
        (15 / 4, -x * z),
        (15 / 16, xx - yy),
        (35 / 32, -y * (3 * xx - yy)),
        (105 / 4, x * y * z),
        (21 / 32, -y * (4 * zz - xx - yy)),
        (7 / 16, z * (2 * zz - 3 * xx - 3 * yy)),
        (21 / 32, -x * (4 * zz - xx - yy)),
        (105 / 16, z * (xx - yy)),
        (35 / 32, -x * (xx - 3 * yy)),
    ]
    return np.column_stack([np.sqrt(factor / np.pi) * polynomial for factor, polynomial in polynomials])


def turned(gaussians: Gaussians, rotation: Float64Array) -> Gaussians:
    """Gaussians turned about the origin: centres, shapes and view-dependent colours.

    Args:
        gaussians: N Gaussians.
        rotation: from old to new coordinates, (3, 3).
    """
    if np.allclose(rotation, np.eye(3), atol=1e-12):
        return gaussians
    quaternions = np.empty_like(gaussians.quaternions)
    for start in range(0, len(gaussians), _ROWS_AT_ONCE):
        rows = slice(start, start + _ROWS_AT_ONCE)
        quaternions[rows] = quaternions_of(rotation @ rotation_matrices(gaussians.quaternions[rows]))
    sh_rest = gaussians.sh_rest.copy()
    for first, end in pairwise(_BAND_ENDS):
        if end <= sh_rest.shape[2]:
            sh_rest[:, :, first:end] = gaussians.sh_rest[:, :, first:end] @ _turn_of_band(rotation, first, end)
    means = (gaussians.means.astype(np.float64) @ rotation.T).astype(np.float32)
    return gaussians.replace(means=means, quaternions=quaternions, sh_rest=sh_rest)


def _turn_of_band(rotation: Float64Array, first: int, end: int) -> FloatArray:
    """What a rotation does to the coefficients of one degree, to be multiplied from the right.

    A turned harmonic is a sum of harmonics of its own degree, so values in a few directions determine it.
    """
    directions = np.random.default_rng(0).normal(size=(64, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    before = sh_basis(directions @ rotation)[:, first + 1 : end + 1]
    after = sh_basis(directions)[:, first + 1 : end + 1]
    return np.asarray(np.linalg.lstsq(after, before, rcond=None)[0].T, np.float32)
