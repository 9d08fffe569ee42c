"""What blending is: numbers that all kernels share, the colours that it blends, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians
from gaussian_trimmer.geometry.harmonics import sh_basis

ALPHA_CAP = 0.99
"""Largest alpha that one Gaussian reaches at a pixel."""
ALPHA_CUTOFF = 1.0 / 255.0
"""Alphas below this are skipped."""
LOW_PASS_VARIANCE = 0.3
"""Added to both diagonal entries of the projected covariance, in square pixels."""
TRANSMITTANCE_STOP = 1e-4
"""A pixel is finished before a Gaussian would push its transmittance below this."""
FRUSTUM_MARGIN = 0.15
"""The projection's Jacobian is evaluated no farther outside the image than this share of its size."""
LARGEST_SPREAD = 1e6
"""Projected semi-axes longer than this many pixels are drawn as long as this: what they show in an image hardly
differs, and beyond it single precision no longer tells pixels apart."""
LARGEST_VALUE = 1e30
"""What lies farther away is not drawn and colours end here, so that sums of them are numbers in single precision."""
MOST_PAIRS = 1 << 30
"""Pairs of a tile and a Gaussian that reaches it of which a view may consist; so many take minutes to draw."""


@dataclass(frozen=True, eq=False)
class Rendering:
    """What a camera sees."""

    rgb: FloatArray
    """Colours, not clipped above one, (H, W, 3); empty if they were not asked for."""
    alpha: FloatArray
    """Accumulated opacity in [0, 1], (H, W)."""
    depth: FloatArray
    """Blend-weighted mean depth of what is seen, sum(w z) / alpha; zero where alpha is zero, (H, W)."""
    weights: FloatArray = field(default_factory=lambda: np.zeros(0, np.float32))
    """Blend weight of each Gaussian, sum over pixels of alpha_i T_i, (N,), or outside and inside a mask, (N, 2); empty
    if it was not asked for."""


def view_colours(gaussians: Gaussians, camera: Camera) -> Float64Array:
    """Return colours (N, 3), not negative, that the spherical harmonics show towards the camera."""
    directions = gaussians.means - camera.centre
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    directions = np.divide(directions, lengths, out=np.zeros_like(directions), where=lengths > 0)
    coefficients = np.concatenate([gaussians.sh_dc[:, :, None], gaussians.sh_rest], axis=2, dtype=np.float64)
    basis = sh_basis(directions)[:, : coefficients.shape[2]]
    return np.asarray(np.clip(np.einsum("nck,nk->nc", coefficients, basis) + 0.5, 0.0, LARGEST_VALUE))
