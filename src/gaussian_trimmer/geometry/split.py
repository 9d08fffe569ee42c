"""Boundary Gaussian Decomposition, splitting: each Gaussian is cut by its own plane into two children.

A rule takes M Gaussians, the unit normals of their planes, which point to the inside (M, 3), and the signed distances d
of their centres from their planes in units of sigma_n = sqrt(n' Sigma n), positive inside (M,). It returns the inside
children and the outside children, row i from row i; colours and extra columns are inherited. `docs/paper.md`
derives the rules and compares them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from gaussian_trimmer.gaussians import Float64Array, Gaussians, logit, quaternions_of, rotation_matrices

MAX_OFFSET = 6.0
"""Planes farther from the centre, in sigma_n, are moved to this distance: nothing visible lies beyond."""

PROFILE_POWER = 1.5
"""A child takes the moments of the cut profile to this power: 1 keeps mean and variance, more closes the seam."""

MAX_OPACITY = 0.99
"""Rasterisers cap alpha here; children are more opaque only if their parent was."""

AXIS_LENGTH = 3.0
"""Length of the segment that represents the longest axis, in standard deviations along it."""

MIN_SHARE = 0.05
"""Smallest share of the segment that a child gets if the plane crosses it, so that no child is degenerate."""

SAGD_SHRINKAGE = 0.8
"""Factor by which SAGD's published code shrinks its child beyond the share of the axis."""

_MAX_SWEEPS = 12
"""Sweeps of Jacobi turns over the three pairs of columns; four are usual."""

_ORTHOGONAL_COSINE = 1e-13
"""Cosine between two columns up to which they count as orthogonal."""

SplitRule = Callable[[Gaussians, Float64Array, Float64Array], tuple[Gaussians, Gaussians | None]]


def split_plane(gaussians: Gaussians, normals: Float64Array, offsets: Float64Array) -> tuple[Gaussians, Gaussians]:
    """Return children that follow the profile of their parent on either side of the plane, and together all of it.

    Centres move along u = Sigma n / sigma_n and variances shrink along u alone, so what the plane does not cut stays.

    Args:
        gaussians: the M parents.
        normals: unit normals of the planes, towards the inside, (M, 3).
        offsets: signed distances of the centres from the planes in sigma_n, positive inside, (M,); clipped to +-6.

    Returns:
        The inside and the outside children.

    >>> from gaussian_trimmer.gaussians import Gaussians
    >>> one = np.float32([[1, 0, 0, 0]])
    >>> ball = Gaussians(one[:, 1:], one[:, 1:], one, one[:, 1], one[:, 1:], np.zeros((1, 3, 0), np.float32))
    >>> inside, outside = split_plane(ball, np.array([[0.0, 0.0, 1.0]]), np.array([0.0]))
    >>> bool(inside.means[0, 2] > 0.5), bool(np.allclose(inside.means, -outside.means))
    (True, True)
    """
    d = np.clip(np.asarray(offsets, np.float64), -MAX_OFFSET, MAX_OFFSET)
    shift_in, variance_in = _half_moments(d)
    shift_out, variance_out = _half_moments(-d)
    shift_out = -shift_out
    amplitude_in, amplitude_out = _amplitudes(d, shift_in, variance_in, shift_out, variance_out)
    inside = _compress(gaussians, normals, shift_in, variance_in, amplitude_in)
    outside = _compress(gaussians, normals, shift_out, variance_out, amplitude_out)
    return inside, outside


def split_principal_axis(
    gaussians: Gaussians, normals: Float64Array, offsets: Float64Array
) -> tuple[Gaussians, Gaussians | None]:
    """Return children that share the longest axis in the ratio in which the plane cuts it, of the parent's opacity.

    Eqs. 8 and 9 of GaussianTrimmer with the complement as second child: l' = lambda l, x' = x + (l - l') / 2 e. Where
    the plane crosses the axis, lambda is kept in [0.05, 0.95]. Where it does not, the parent stays whole on the side of
    its centre and its child on the other side is transparent.

    Args:
        gaussians: the M parents.
        normals: unit normals of the planes, towards the inside, (M, 3).
        offsets: signed distances of the centres from the planes in sigma_n, positive inside, (M,).

    Returns:
        The inside and the outside children.
    """
    return _halves(gaussians, *_cut_axes(gaussians, normals, offsets))


def split_at_centroid(
    gaussians: Gaussians, normals: Float64Array, offsets: Float64Array
) -> tuple[Gaussians, Gaussians | None]:
    """Return children as `split_principal_axis` does, with a lambda of 1/2: "at its centroid", as the paper says."""
    axes, lengths, shares = _cut_axes(gaussians, normals, offsets)
    return _halves(gaussians, axes, lengths, np.where((shares > 0) & (shares < 1), 0.5, shares))


def _halves(
    gaussians: Gaussians, axes: Float64Array, lengths: Float64Array, shares: Float64Array
) -> tuple[Gaussians, Gaussians]:
    """Return what lies on both sides of a cut through the longest axes, as `_cut_axes` describes it."""
    longest = np.arange(3) == np.argmax(gaussians.log_scales, axis=1)[:, None]  # (M, 3)
    inside = _shorten(gaussians, axes, lengths, shares, np.where(longest, shares[:, None], 1.0))
    outside = _shorten(gaussians, -axes, lengths, 1 - shares, np.where(longest, 1 - shares[:, None], 1.0))
    return inside, outside


def split_sagd(
    gaussians: Gaussians, normals: Float64Array, offsets: Float64Array
) -> tuple[Gaussians, Gaussians | None]:
    """Return the one child of SAGD's published code, for comparison: moved by eq. 9, all three scales times 0.8 lambda.

    It leaves a hole where the outside child would be. Arguments and lambda as in `split_principal_axis`; whole parents
    keep their size.

    Returns:
        The inside children, and None for the outside ones.
    """
    axes, lengths, shares = _cut_axes(gaussians, normals, offsets)
    factors = np.where(shares < 1, SAGD_SHRINKAGE * shares, 1.0)
    return _shorten(gaussians, axes, lengths, shares, np.repeat(factors[:, None], 3, axis=1)), None


SPLIT_RULES: Mapping[str, SplitRule] = {
    "plane": split_plane,
    "principal_axis": split_principal_axis,
    "centroid": split_at_centroid,
    "sagd": split_sagd,
}
"""Every rule by the name that the command line uses."""


def _half_moments(d: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return centres (M,) and variances (M,) of the children that stand for exp(-t^2 / 2) on t > -d.

    The profile to the power p is a normal density of variance 1 / p: its truncated moments, and the variance times p.
    """
    from scipy.special import ndtr  # takes longer to import than a command to start, and only splits need it

    root = math.sqrt(PROFILE_POWER)
    x = root * d
    mean = np.exp(-0.5 * x * x) / (math.sqrt(2.0 * math.pi) * ndtr(x))
    return mean / root, 1.0 - mean * (mean + x)


def _overlap(m1: Float64Array, v1: Float64Array, m2: Float64Array | float, v2: Float64Array | float) -> Float64Array:
    """Return the integral of exp(-(t - m1)^2 / 2 v1) exp(-(t - m2)^2 / 2 v2) over the line, (M,)."""
    total = v1 + v2
    return np.asarray(np.sqrt(2.0 * math.pi * v1 * v2 / total) * np.exp(-0.5 * (m1 - m2) ** 2 / total))


def _amplitudes(
    d: Float64Array, m1: Float64Array, v1: Float64Array, m2: Float64Array, v2: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return heights of the inside (M,) and outside (M,) children over the parent's, by least squares.

    The three residuals, of equal weight: either child against its part of the profile, and their sum against all of it.
    """
    from scipy.special import ndtr

    whole1, whole2 = _overlap(m1, v1, 0.0, 1.0), _overlap(m2, v2, 0.0, 1.0)
    # A child times the parent is a Gaussian of mean m / (1 + v) and variance v / (1 + v); this much of it is inside.
    inside1 = whole1 * ndtr((m1 / (1 + v1) + d) / np.sqrt(v1 / (1 + v1)))
    outside2 = whole2 * ndtr(-(m2 / (1 + v2) + d) / np.sqrt(v2 / (1 + v2)))
    a11, a22, a12 = 2.0 * _overlap(m1, v1, m1, v1), 2.0 * _overlap(m2, v2, m2, v2), _overlap(m1, v1, m2, v2)
    b1, b2 = inside1 + whole1, outside2 + whole2
    determinant = a11 * a22 - a12 * a12  # At least 3/4 of a11 a22, by Cauchy and Schwarz.
    return (a22 * b1 - a12 * b2) / determinant, (a11 * b2 - a12 * b1) / determinant


def _compress(
    gaussians: Gaussians, normals: Float64Array, shifts: Float64Array, variances: Float64Array, amplitudes: Float64Array
) -> Gaussians:
    """Return Gaussians moved by `shifts` u, with covariance Sigma - (1 - variance) u u' and opacity times `amplitudes`.

    With Sigma = F F' and the unit vector w = F' n / sigma_n, u = F w and the new factor is F (I - (1 - sqrt(v)) w w').
    Its singular values are the scales, to a relative accuracy that the eigenvalues of Sigma would not have.
    """
    factors = gaussians.factors()
    directions = np.einsum("nij,ni->nj", factors, normals)
    spreads = np.linalg.norm(directions, axis=1, keepdims=True)  # sigma_n, (M, 1)
    directions = np.divide(directions, spreads, out=np.zeros_like(directions), where=spreads > 0)
    displacements = np.einsum("nij,nj->ni", factors, directions)
    loss = (1.0 - np.sqrt(variances))[:, None, None]
    axes, scales = _principal_axes(factors - loss * displacements[:, :, None] * directions[:, None, :])
    parents = gaussians.opacities.astype(np.float64)
    opacities = np.clip(amplitudes * parents, 0.0, np.maximum(parents, MAX_OPACITY))
    return gaussians.replace(
        means=(gaussians.means + shifts[:, None] * displacements).astype(np.float32),
        log_scales=np.log(np.maximum(scales, np.finfo(np.float32).tiny)).astype(np.float32),
        quaternions=quaternions_of(axes),
        opacity_logits=logit(opacities).astype(np.float32),
    )


def _principal_axes(factors: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return right-handed left singular vectors (M, 3, 3), in columns, and singular values (M, 3) of factors (M, 3, 3).

    One-sided Jacobi (Demmel and Veselic 1992): columns are turned in pairs until they are orthogonal. It starts from
    the factor's own columns and turns no pair that is orthogonal but for rounding. Where singular values are equal, as
    a round Gaussian's are, the axes therefore hang on the last bits of the input no more than elsewhere; LAPACK's do.
    """
    columns = [factors[:, :, i].copy() for i in range(3)]
    for _ in range(_MAX_SWEEPS):
        turned = False
        for i, j in ((0, 1), (0, 2), (1, 2)):
            a, b = columns[i], columns[j]
            alpha, beta, gamma = (np.sum(x * y, axis=1) for x, y in ((a, a), (b, b), (a, b)))
            skew = np.abs(gamma) > _ORTHOGONAL_COSINE * np.sqrt(alpha * beta)
            if not skew.any():
                continue
            turned = True
            zeta = np.divide(beta - alpha, 2 * gamma, out=np.zeros_like(gamma), where=skew)
            sign = np.where(zeta < 0, -1.0, 1.0)
            tangent = np.where(skew, sign / (np.abs(zeta) + np.hypot(1.0, zeta)), 0.0)
            cosine = (1 / np.hypot(1.0, tangent))[:, None]
            sine = cosine * tangent[:, None]
            columns[i], columns[j] = cosine * a - sine * b, sine * a + cosine * b
        if not turned:
            break
    scales = np.stack([np.linalg.norm(column, axis=1) for column in columns], axis=1)
    axes = np.stack(columns, axis=2) / np.maximum(scales, np.finfo(np.float64).tiny)[:, None, :]
    left_handed = np.sum(np.cross(axes[:, :, 0], axes[:, :, 1]) * axes[:, :, 2], axis=1) < 0
    axes[left_handed, :, 2] *= -1
    return axes, scales


def _cut_axes(
    gaussians: Gaussians, normals: Float64Array, offsets: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return longest axes, turned inside (M, 3), lengths of their segments, and shares of these inside, (M,) each.

    A share is 0 or 1 where the plane does not cross the segment.
    """
    rows = np.arange(len(gaussians))
    rotations = rotation_matrices(gaussians.quaternions)
    scales = np.exp(gaussians.log_scales.astype(np.float64))
    spreads = np.linalg.norm(np.einsum("nij,ni->nj", rotations, normals) * scales, axis=1)  # sigma_n
    longest = np.argmax(gaussians.log_scales, axis=1)
    axes = rotations[rows, :, longest]
    cosines = np.einsum("ni,ni->n", axes, normals)
    axes = axes * np.where(cosines < 0, -1.0, 1.0)[:, None]
    lengths = AXIS_LENGTH * scales[rows, longest]
    reach = np.maximum(np.abs(cosines) * lengths, np.finfo(np.float32).tiny)  # Of the segment, along the normal.
    shares = np.clip(0.5 + offsets * spreads / reach, 0.0, 1.0)
    crossed = (shares > 0) & (shares < 1)
    return axes, lengths, np.where(crossed, np.clip(shares, MIN_SHARE, 1 - MIN_SHARE), shares)


def _shorten(
    gaussians: Gaussians, axes: Float64Array, lengths: Float64Array, shares: Float64Array, factors: Float64Array
) -> Gaussians:
    """Return Gaussians with segments cut to `shares` at the end of `axes`, and scales times `factors` (M, 3).

    Where the share is zero, the Gaussian keeps place and shape and becomes transparent.
    """
    empty = shares == 0
    moves = np.where(empty, 0.0, 0.5 * (1.0 - shares) * lengths)
    logits = np.where(empty, logit(np.zeros(len(gaussians))), gaussians.opacity_logits)
    return gaussians.replace(
        means=(gaussians.means + moves[:, None] * axes).astype(np.float32),
        log_scales=(gaussians.log_scales + np.log(np.where(empty[:, None], 1.0, factors))).astype(np.float32),
        opacity_logits=logits.astype(np.float32),
    )
