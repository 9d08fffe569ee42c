"""The readable renderer: EWA splatting in float64 NumPy, written like its equations.

It is slow and stands alone on purpose: the fast renderer, and the rules for splitting, are tested against it.
Equations are those of "EWA Splatting" (Zwicker et al., 2002) as used by "3D Gaussian Splatting" (Kerbl et al., 2023).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, IntArray, rotation_matrices
from gaussian_trimmer.geometry.limits import LARGEST_LOG_SCALE
from gaussian_trimmer.rendering.blending import (
    ALPHA_CAP,
    ALPHA_CUTOFF,
    FRUSTUM_MARGIN,
    LARGEST_SPREAD,
    LARGEST_VALUE,
    LOW_PASS_VARIANCE,
    TRANSMITTANCE_STOP,
    Rendering,
    view_colours,
)

Box = tuple[slice, slice]


@dataclass(frozen=True, eq=False)
class _Splat:
    """One Gaussian as the image plane sees it."""

    row: int
    """Its number in the scene."""
    mean: Float64Array
    """Projected centre in pixels, (2,)."""
    covariance: Float64Array
    """Projected and low-pass filtered covariance in square pixels, (2, 2)."""
    inverse: Float64Array
    """Its inverse, (2, 2)."""
    opacity: float


def render(
    gaussians: Gaussians, camera: Camera, background: FloatArray | None = None, weights: bool = False
) -> Rendering:
    """Render colour, alpha and depth, and the Gaussians' blend weights if asked for."""
    with _some_not_finite():
        depths = camera.to_camera(gaussians.means.astype(np.float64))[:, 2]
        seen = np.column_stack([view_colours(gaussians, camera), depths, np.ones(len(gaussians))])
    rgb, weighted_depth, alpha = np.split(_blended(gaussians, camera, seen), [3, 4], axis=2)
    if background is not None:
        rgb = rgb + (1.0 - alpha) * background
    depth = np.divide(weighted_depth, alpha, out=np.zeros_like(alpha), where=alpha > 0)
    everywhere = np.zeros((camera.height, camera.width), np.uint8)
    return Rendering(
        rgb.astype(np.float32),
        alpha[..., 0].astype(np.float32),
        depth[..., 0].astype(np.float32),
        blend_weights(gaussians, camera, everywhere, 1)[:, 0] if weights else np.zeros(0, np.float32),
    )


def blend_values(gaussians: Gaussians, camera: Camera, values: FloatArray) -> FloatArray:
    """Sum over Gaussians of alpha_i T_i values_i at each pixel, for any values (N, C), as (H, W, C)."""
    return _blended(gaussians, camera, values.astype(np.float64)).astype(np.float32)


def blend_weights(gaussians: Gaussians, camera: Camera, labels: NDArray[np.uint8], n_labels: int) -> FloatArray:
    """Sum over pixels of alpha_i T_i, separately by the pixels' labels (H, W), as (N, n_labels).

    Pixels whose label is n_labels or more are left out.
    """
    sums = np.zeros((len(gaussians), n_labels))
    for splat, box, weights in _blend(gaussians, camera):
        for label in range(n_labels):
            sums[splat.row, label] = weights[labels[box] == label].sum()
    return sums.astype(np.float32)


def top_contributors(gaussians: Gaussians, camera: Camera, pixels: IntArray, k: int) -> tuple[IntArray, FloatArray]:
    """Find the k Gaussians of largest weight at each asked pixel (x, y), nearest first where weights are equal.

    Returns row numbers (P, k), -1 where fewer than k contribute, and weights (P, k) in falling order.
    """
    x, y = pixels[:, 0], pixels[:, 1]
    ids = np.full((len(pixels), k), -1, np.int64)
    best = np.zeros((len(pixels), k))
    for splat, (rows, columns), weights in _blend(gaussians, camera):
        met = (rows.start <= y) & (y < rows.stop) & (columns.start <= x) & (x < columns.stop)
        weight = weights[y[met] - rows.start, x[met] - columns.start]
        candidates = np.column_stack([best[met], weight])
        candidate_ids = np.column_stack([ids[met], np.full(len(weight), splat.row)])
        # The stable sort leaves earlier, that is nearer, Gaussians and empty places before the newcomer.
        order = np.argsort(-candidates, axis=1, kind="stable")[:, :k]
        best[met] = np.take_along_axis(candidates, order, axis=1)
        ids[met] = np.take_along_axis(candidate_ids, order, axis=1)
    return ids, best.astype(np.float32)


def projected_covariances(gaussians: Gaussians, camera: Camera) -> Float64Array:
    """Return covariances in the image, J W Sigma W^T J^T plus the low-pass filter, in square pixels, (N, 2, 2).

    All Gaussians must be in front of the camera. J is the Jacobian of the perspective projection at the centre, or,
    for centres far outside the image, where the linear approximation breaks down, at the margin around it.

    Eqs. 5 and 6 of "3D Gaussian Splatting".
    """
    axes = _projected_axes(gaussians, camera)
    return np.asarray(axes @ axes.transpose(0, 2, 1) + LOW_PASS_VARIANCE * np.eye(2))


def _projected_axes(gaussians: Gaussians, camera: Camera) -> Float64Array:
    """Return J W R S: its columns are the semi-axes as the image shows them, in pixels, (N, 2, 3); Sigma = R S S^T R^T.

    Those longer than `LARGEST_SPREAD` are shortened to it.
    """
    size = np.array([camera.width, camera.height])
    focal, principal = camera.K[[0, 1], [0, 1]], camera.K[:2, 2]
    pixels, z = camera.project(gaussians.means.astype(np.float64))
    clamped = np.clip(pixels, -FRUSTUM_MARGIN * size, (1.0 + FRUSTUM_MARGIN) * size)
    slopes = (clamped - principal) / focal  # x / z and y / z, (N, 2)

    J = np.zeros((len(gaussians), 2, 3))
    J[:, 0, 0] = focal[0] / z
    J[:, 1, 1] = focal[1] / z
    J[:, :, 2] = -focal * slopes / z[:, None]
    scales = np.exp(np.minimum(gaussians.log_scales.astype(np.float64), LARGEST_LOG_SCALE))
    axes = J @ camera.rotation @ rotation_matrices(gaussians.quaternions) * scales[:, None, :]
    lengths = np.hypot(axes[:, 0], axes[:, 1])  # (N, 3)
    shortened = np.divide(LARGEST_SPREAD, lengths, out=np.ones_like(lengths), where=lengths > LARGEST_SPREAD)
    return np.asarray(axes * shortened[:, None, :])


def _determinants(axes: Float64Array, low_pass: float = LOW_PASS_VARIANCE) -> Float64Array:
    """Return determinants of the covariances with these semi-axes (N, 2, 3), (N,).

    By the formula of Cauchy and Binet, which is a sum of squares. The difference of products loses all digits of a
    long needle's.
    """
    areas = [axes[:, 0, i] * axes[:, 1, j] - axes[:, 1, i] * axes[:, 0, j] for i, j in ((0, 1), (0, 2), (1, 2))]
    return np.asarray(low_pass**2 + low_pass * (axes**2).sum(axis=(1, 2)) + np.square(areas).sum(axis=0))


def _some_not_finite() -> np.errstate:
    """Let operations fail at Gaussians that are not finite, since these are not drawn."""
    return np.errstate(over="ignore", invalid="ignore", divide="ignore")


def _blended(gaussians: Gaussians, camera: Camera, values: Float64Array) -> Float64Array:
    """Return the image (H, W, C) of values (N, C)."""
    image = np.zeros((camera.height, camera.width, values.shape[1]))
    for splat, box, weights in _blend(gaussians, camera):
        image[box] += weights[..., None] * values[splat.row]
    return image


def _front_to_back(gaussians: Gaussians, camera: Camera) -> Iterator[_Splat]:
    """Yield the visible Gaussians by rising centre depth, and by row number where depths are equal."""
    with _some_not_finite():
        depths = camera.to_camera(gaussians.means.astype(np.float64))[:, 2]
        opacities = gaussians.opacities.astype(np.float64)
        near_enough = (depths >= camera.near) & (depths > 0) & (depths <= LARGEST_VALUE)
        rows = np.flatnonzero(near_enough & (opacities >= ALPHA_CUTOFF))
        rows = rows[np.argsort(depths[rows], kind="stable")]
        visible = gaussians.select(rows)
        means, _ = camera.project(visible.means.astype(np.float64))
        axes, covariances = _projected_axes(visible, camera), projected_covariances(visible, camera)
        determinants = _determinants(axes)
        adjugates = covariances[:, ::-1, ::-1] * np.array([[1, -1], [-1, 1]])
        inverses = adjugates / determinants[:, None, None]
        if gaussians.antialiased:
            # Mip-Splatting's 2D filter: what the low-pass filter enlarges gets fainter.
            opacities[rows] *= np.sqrt(_determinants(axes, 0.0) / determinants)
    drawable = np.isfinite(means).all(axis=1) & np.isfinite(determinants) & (opacities[rows] >= ALPHA_CUTOFF)
    for i in np.flatnonzero(drawable):
        yield _Splat(int(rows[i]), means[i], covariances[i], inverses[i], float(opacities[rows[i]]))


def _blend(gaussians: Gaussians, camera: Camera) -> Iterator[tuple[_Splat, Box, Float64Array]]:
    """Blend front to back: yield every visible Gaussian with its box of pixels and its weights alpha_i T_i there.

    Eq. 3 of "3D Gaussian Splatting", with T_i the product of 1 - alpha_j over all nearer j.
    """
    transmittance = np.ones((camera.height, camera.width))
    finished: BoolArray = np.zeros((camera.height, camera.width), np.bool_)
    for splat in _front_to_back(gaussians, camera):
        box = _box(splat, camera)
        alpha = _alpha(splat, box)
        drawn = (alpha >= ALPHA_CUTOFF) & ~finished[box]
        # The Gaussian that would exhaust a pixel is itself no longer drawn there.
        exhausts = drawn & (transmittance[box] * (1.0 - alpha) < TRANSMITTANCE_STOP)
        finished[box] |= exhausts
        alpha = np.where(drawn & ~exhausts, alpha, 0.0)
        yield splat, box, alpha * transmittance[box]
        transmittance[box] *= 1.0 - alpha


def _alpha(splat: _Splat, box: Box) -> Float64Array:
    """Return min(cap, o exp(-d^T Sigma^-1 d / 2)) at pixel centres of a box, d being their offsets from the mean."""
    rows, columns = box
    y, x = np.mgrid[rows, columns] + 0.5
    d = np.stack([x, y], axis=-1) - splat.mean  # (h, w, 2)
    squared_distance = np.einsum("hwi,ij,hwj->hw", d, splat.inverse, d)
    return np.asarray(np.minimum(ALPHA_CAP, splat.opacity * np.exp(-0.5 * squared_distance)))


def _box(splat: _Splat, camera: Camera) -> Box:
    """Return rows and columns of the image outside which the Gaussian's alpha is below the cut-off; may be empty."""
    # o exp(-q / 2) = cutoff gives the ellipse d^T Sigma^-1 d = q, which reaches sqrt(q Sigma_ii) along axis i.
    q = 2.0 * np.log(splat.opacity / ALPHA_CUTOFF)
    reach = np.sqrt(q * np.diag(splat.covariance))
    size = (camera.width, camera.height)
    first = np.clip(np.floor(splat.mean - reach), 0, size).astype(np.int64)
    beyond = np.clip(np.ceil(splat.mean + reach), 0, size).astype(np.int64)
    return slice(int(first[1]), int(beyond[1])), slice(int(first[0]), int(beyond[0]))
