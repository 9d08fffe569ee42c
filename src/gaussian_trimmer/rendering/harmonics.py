"""Spherical harmonics: the colours that Gaussians show towards a camera."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import Float64Array, Gaussians
from gaussian_trimmer.rendering.blending import LARGEST_VALUE


def view_colours(gaussians: Gaussians, camera: Camera) -> Float64Array:
    """Return colours (N, 3), not negative, that the spherical harmonics show towards the camera."""
    directions = gaussians.means - camera.centre
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    directions = np.divide(directions, lengths, out=np.zeros_like(directions), where=lengths > 0)
    coefficients = np.concatenate([gaussians.sh_dc[:, :, None], gaussians.sh_rest], axis=2, dtype=np.float64)
    basis = sh_basis(directions)[:, : coefficients.shape[2]]
    return np.asarray(np.clip(np.einsum("nck,nk->nc", coefficients, basis) + 0.5, 0.0, LARGEST_VALUE))


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
