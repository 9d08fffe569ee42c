"""What blending is, in numbers that all kernels share, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gaussian_trimmer.gaussians import FloatArray

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
    """Colours, not clipped above one, (H, W, 3)."""
    alpha: FloatArray
    """Accumulated opacity in [0, 1], (H, W)."""
    depth: FloatArray
    """Blend-weighted mean depth of what is seen, sum(w z) / alpha; zero where alpha is zero, (H, W)."""
    weights: FloatArray = field(default_factory=lambda: np.zeros(0, np.float32))
    """Blend weight of each Gaussian, sum over pixels of alpha_i T_i, (N,); empty if it was not asked for."""
