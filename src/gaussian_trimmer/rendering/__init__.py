"""Renderers: the contract, and the table of those that exist."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import FloatArray, Gaussians, IntArray
from gaussian_trimmer.lazy_import import load
from gaussian_trimmer.parallel import is_thread_safe as is_thread_safe
from gaussian_trimmer.parallel import parallel_map as parallel_map

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


class Renderer(Protocol):
    """Rasterises Gaussians as the original implementation does: EWA splatting, front to back by centre depth.

    One that may be called from several threads at once says so by `thread_safe = True`, see `is_thread_safe`.
    """

    name: str

    def render(
        self, gaussians: Gaussians, camera: Camera, background: FloatArray | None = None, weights: bool = False
    ) -> Rendering:
        """Render colour, alpha and depth of a view and, in the same pass if asked for, the blend weights of Gaussians.

        `background` is an RGB colour (3,), black if not given.
        """
        ...

    def blend_values(self, gaussians: Gaussians, camera: Camera, values: FloatArray) -> FloatArray:
        """Sum over Gaussians of alpha_i T_i values_i at each pixel, for any values (N, C), as (H, W, C)."""
        ...

    def blend_weights(
        self, gaussians: Gaussians, camera: Camera, labels: NDArray[np.uint8], n_labels: int
    ) -> FloatArray:
        """Sum over pixels of alpha_i T_i, separately by the pixels' labels (H, W), as (N, n_labels).

        Pixels whose label is n_labels or more are left out.
        """
        ...

    def top_contributors(
        self, gaussians: Gaussians, camera: Camera, pixels: IntArray, k: int
    ) -> tuple[IntArray, FloatArray]:
        """Return the k Gaussians of largest blend weight at each asked pixel (x, y), by reverse alpha blending.

        Returns row numbers (P, k), -1 where fewer than k contribute, and weights (P, k) in falling order.
        """
        ...


def pixels_inside(pixels: IntArray, camera: Camera) -> IntArray:
    """Return pixels (x, y) as integers (P, 2).

    Raises:
        ValueError: a pixel lies outside the camera's image.
    """
    pixels = np.asarray(pixels, np.int64).reshape(-1, 2)
    if len(pixels) and not ((pixels >= 0).all() and (pixels < [camera.width, camera.height]).all()):
        raise ValueError(f"Pixels must lie in the image of {camera.width} x {camera.height}.")
    return pixels


def check_pairs(n_pairs: int, camera: Camera) -> None:
    """Refuse views that would be drawn for hours, as those of millions of Gaussians that each cover the picture.

    Raises:
        InputError: the pairs of a tile and a Gaussian that reaches it are more than `MOST_PAIRS`.
    """
    if n_pairs > MOST_PAIRS:
        raise InputError(
            f"A view of {camera.width} x {camera.height} pixels consists of {n_pairs:,} pairs of a tile and a Gaussian "
            f"that reaches it, and at most {MOST_PAIRS:,} can be drawn; take smaller views, or remove Gaussians that "
            "are as large as the whole picture."
        )


RENDERERS = {
    "numba": "gaussian_trimmer.rendering.numba_cpu:NumbaRenderer",
    "reference": "gaussian_trimmer.rendering.reference:ReferenceRenderer",
    "gsplat": "gaussian_trimmer.rendering.gsplat_cuda:GsplatRenderer",
}
RENDERER_CHOICES = ("auto", *RENDERERS)
"""What `get_renderer` takes."""
DEFAULT_RENDERER = "auto"


def get_renderer(name: str) -> Renderer:
    """Make the renderer of that name; `auto` is numba, since a trim gains nothing from gsplat; see docs/gpu.md.

    Raises:
        InputError: no renderer has that name, or what it needs is not installed.
    """
    if name == "auto":
        name = "numba"
    if name not in RENDERERS:
        raise InputError(f"Unknown renderer '{name}'; available: {', '.join(RENDERER_CHOICES)}.")
    return cast(Renderer, load(RENDERERS[name])())
