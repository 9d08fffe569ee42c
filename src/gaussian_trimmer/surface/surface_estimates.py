"""A surface of Gaussians as it is around each of them: colour, normal, and how much neighbours belong together."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import SH_C0, Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.geometry.graphs import nearest
from gaussian_trimmer.parallel import in_shares

_EDGE_NEIGHBOURS, _ESTIMATE_NEIGHBOURS = 10, 17
"""Number of neighbours on edges, and of Gaussians that colour and normal are estimated from."""
_MAX_WEIGHT = 20.0
"""Visible weight beyond which a Gaussian counts no more in these estimates."""
_COLOUR_SIGMA = 10.0
"""Standard deviation of edge weights over Lab colours."""
_COLOUR_FACTOR = np.float32(-0.5 / (2 * _COLOUR_SIGMA) ** 2)
_LAB_WEIGHTS = np.array([0.5**0.5, 1, 1])
"""Weights of the channels in distances between Lab colours: lightness changes with shading."""
_CONCAVITY_SCALE = 0.3
"""Concavity at which an edge weighs 1/e: the difference of the normals along the edge."""
_UNEVEN_WEIGHT = 0.5
"""Weight of edges where the surface is too uneven to have a normal, relative to those of a convex surface."""
_MIN_EDGE_WEIGHT = 0.05
"""Smallest relative weight of an edge: small spots of another colour stay with what surrounds them."""
_COLOUR_BINS, _BIN_OFFSET, _BIN_SIZE = (20, 26, 26), np.array([0, 128, 128]), np.array([6.25, 10, 10])
"""Bins of the colour histograms over L, a and b: their number, and where and how wide they are."""
COLOURS = int(np.prod(_COLOUR_BINS))
_MAX_LOG_RATIO = 2.0
"""Log-ratio at which colour evidence is clipped."""


@dataclass(frozen=True, eq=False)
class SurfaceEstimates:
    """What is known around each of S Gaussians of a surface, and on the E edges between neighbours."""

    colours: FloatArray
    """Lab colours, smoothed along the surface, (S, 3)."""
    normals: FloatArray
    """Unit normals on the side that is seen, (S, 3)."""
    flatness: FloatArray
    """How flat the surface is, 0 to 1, (S,)."""
    spacing: FloatArray
    """Distance to the near neighbours, (S,)."""
    edges: IntArray
    """Pairs of neighbours, each once, the smaller first, in order, (E, 2)."""
    lengths: Float64Array
    """Length of boundary that passes between both, (E,)."""
    affinity: Float64Array
    """How much both belong together by colour and convexity, 0 to 1, (E,)."""


def estimate_surface(gaussians: Gaussians, visible: FloatArray, facing: FloatArray) -> SurfaceEstimates:
    """Measure the surface that some Gaussians make up.

    Args:
        gaussians: S visible ones.
        visible: visible weight of each, (S,).
        facing: a vector towards the sides from which each is seen, (S, 3).
    """
    means = gaussians.means
    squared, beside = nearest(means, means, min(_ESTIMATE_NEIGHBOURS, len(means)))
    sigmas = np.maximum(squared[:, [squared.shape[1] // 2]], 1e-30)
    shares = np.minimum(visible, _MAX_WEIGHT)[beside] * np.exp(-0.5 * squared / sigmas)
    colours = _smoothed(np.clip(0.5 + SH_C0 * gaussians.sh_dc, 0, 1), beside, shares)
    normals, flatness = _normals(means, beside, shares, facing)
    spacing = np.sqrt(squared[:, squared.shape[1] // 4])
    edges, lengths = _edges(beside, np.sqrt(squared), spacing)
    alike = _likeness(edges, colours) * _convexity(edges, means, normals, flatness)
    affinity = _MIN_EDGE_WEIGHT + (1 - _MIN_EDGE_WEIGHT) * alike
    return SurfaceEstimates(colours, normals, flatness, spacing, edges, lengths, affinity)


def directions_to(points: NDArray[np.floating], target: Float64Array) -> FloatArray:
    """Return unit vectors from points (P, 3) to a target (3,), (P, 3)."""
    offset = np.asarray(target - points, np.float32)
    return np.asarray(offset / np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), 1e-30))


def colour_bins(colours: FloatArray) -> IntArray:
    """Return the number of the histogram's bin that each Lab colour (S, 3) lies in, (S,)."""
    bins = np.clip((colours + _BIN_OFFSET) / _BIN_SIZE, 0, np.array(_COLOUR_BINS) - 1).astype(np.int64)
    return np.asarray(np.ravel_multi_index(tuple(bins.T), _COLOUR_BINS))


def colour_evidence(bins: IntArray, inside: Float64Array, outside: Float64Array) -> tuple[Float64Array, float]:
    """Return the clipped log-likelihood ratio of each colour in one part of a surface against another, (S,).

    The second value is the balanced accuracy of the ratio's sign, 0.5 for colours that tell nothing.

    Args:
        bins: as `colour_bins` gives them, (S,).
        inside: area of each Gaussian in the one part, (S,).
        outside: the same in the other.
    """
    counts = np.array([np.bincount(bins, areas, COLOURS) for areas in (inside, outside)], np.float64)
    models = blurred_histograms(counts)
    ratio = np.log((models[0] + 1e-4) / (models[1] + 1e-4))[bins]
    hits = [
        areas[right].sum() / max(areas.sum(), 1e-12) for areas, right in ((inside, ratio > 0), (outside, ratio < 0))
    ]
    return np.clip(ratio, -_MAX_LOG_RATIO, _MAX_LOG_RATIO), float(np.mean(hits))


def _smoothed(rgb: FloatArray, beside: NDArray[np.int32], shares: FloatArray) -> FloatArray:
    """Return Lab colours (S, 3) after two passes of a bilateral filter over the neighbourhoods (S, K)."""
    lab = np.asarray(cv2.cvtColor(rgb.astype(np.float32)[None], cv2.COLOR_RGB2Lab)[0])

    def smoothed(rows: slice) -> FloatArray:
        around = lab.take(beside[rows], axis=0)
        difference = around - lab[rows, None]
        alike = shares[rows] * np.exp(np.einsum("ski,ski->sk", difference, difference) * _COLOUR_FACTOR)
        total = np.maximum(alike.sum(axis=1, keepdims=True), 1e-30)
        return np.asarray(np.einsum("sk,ski->si", alike, around) / total)

    for _ in range(2):
        lab = np.concatenate(in_shares(smoothed, len(lab)))
    return np.asarray(lab, np.float32)


def _normals(
    means: FloatArray, beside: NDArray[np.int32], shares: FloatArray, facing: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return unit normals (S, 3) of neighbourhoods (S, K), on the side that is seen, and flatness, 0 to 1, (S,)."""

    def of(rows: slice) -> tuple[FloatArray, FloatArray]:
        share, around = shares[rows], means.take(beside[rows], axis=0)
        share = share / np.maximum(share.sum(axis=1, keepdims=True), 1e-30)
        offsets = around - np.einsum("sk,ski->si", share, around)[:, None]
        variances, axes = np.linalg.eigh(np.einsum("sk,ski,skj->sij", share, offsets, offsets))
        normals = axes[:, :, 0]
        normals = normals * np.where(np.einsum("si,si->s", normals, facing[rows]) < 0, -1, 1)[:, None]
        flatness = 1 - variances[:, 0] / np.maximum(variances[:, 1], 1e-30)
        return np.asarray(normals, np.float32), np.asarray(np.clip(flatness, 0, 1), np.float32)

    normals, flatness = zip(*in_shares(of, len(means)), strict=True)
    return np.concatenate(normals), np.concatenate(flatness)


def _edges(beside: NDArray[np.int32], distances: FloatArray, spacing: FloatArray) -> tuple[IntArray, Float64Array]:
    """Return pairs of neighbours, each once and in order, (E, 2), and lengths of boundary between them, (E,).

    The edges of a node share the length of boundary that passes it, so that the length of a cut does not depend on how
    densely a surface is covered.
    """
    n, k = len(beside), min(_EDGE_NEIGHBOURS, beside.shape[1] - 1)
    starts, ends = np.repeat(np.arange(n), k), beside[:, 1 : k + 1].ravel().astype(np.int64)
    keys = np.minimum(starts, ends) * n + np.maximum(starts, ends)
    keys, first, count = np.unique(keys, return_index=True, return_counts=True)
    a, b = np.divmod(keys, n)
    width = np.sqrt(spacing[a] * spacing[b]).astype(np.float64)
    near = np.exp(-0.5 * (distances[:, 1 : k + 1].ravel()[first] / np.maximum(1.5 * width, 1e-30)) ** 2)
    return np.stack([a, b], axis=1), near * width * (2 * count / max(k, 1))


def _likeness(edges: IntArray, colours: FloatArray) -> Float64Array:
    """Return how alike the colours of both ends of each edge are, 0 to 1, (E,)."""
    a, b = (colours.take(ends, axis=0) for ends in edges.T)
    difference = np.square((a - b) * _LAB_WEIGHTS).sum(axis=1)
    return np.asarray(np.exp(-0.5 * difference / _COLOUR_SIGMA**2))


def _convexity(edges: IntArray, means: FloatArray, normals: FloatArray, flatness: FloatArray) -> Float64Array:
    """Return how convex the surface is along each edge, 0 to 1, (E,)."""
    a, b = edges.T
    step = (means.take(b, axis=0) - means.take(a, axis=0)).astype(np.float64)
    step /= np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-30)
    concavity = np.maximum(np.einsum("ei,ei->e", normals.take(a, axis=0) - normals.take(b, axis=0), step), 0)
    flat = np.minimum(flatness[a], flatness[b])
    return np.asarray(flat * np.exp(-concavity / _CONCAVITY_SCALE) + (1 - flat) * _UNEVEN_WEIGHT)


def blurred_histograms(counts: Float64Array) -> Float64Array:
    """Normalise histograms over the colours' bins, blurred by one bin, (R, `COLOURS`)."""
    blurred = counts.reshape(-1, *_COLOUR_BINS)
    for axis in range(1, 4):
        side = 0.25 * blurred
        blurred = 2 * side
        for of, to in ((slice(-1), slice(1, None)), (slice(1, None), slice(-1))):
            np.moveaxis(blurred, axis, 0)[to] += np.moveaxis(side, axis, 0)[of]
    sums = np.maximum(blurred.sum(axis=(1, 2, 3), keepdims=True), 1e-12)
    return np.asarray((blurred / sums).reshape(len(counts), -1))
