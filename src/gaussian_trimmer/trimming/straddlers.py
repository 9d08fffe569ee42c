"""Boundary Gaussian Decomposition: the Gaussians that show at the masks' contours, their cut planes, and the cut.

So are strokes that a user draws on an object: what shows under one goes, and what crosses its edge is split there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.graphs import distance_to_outside
from gaussian_trimmer.geometry.split import SPLIT_RULES, split_plane
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.rendering import blend_weights, render, top_contributors
from gaussian_trimmer.trimming.arguments import StrokeCut
from gaussian_trimmer.trimming.config import BoundaryConfig, SplitConfig
from gaussian_trimmer.trimming.refinement import Pieces
from gaussian_trimmer.views.view import HALF, TrimmedView

_MAX_OFFSET = 3.0
"""Distance of a plane from the centre, in standard deviations along its normal, from which it cuts nothing off."""
_CONTOUR_SMOOTHING = 1.5
"""Standard deviation of the blur of the signed distance, in pixels: contours of masks are staircases."""
_MIN_SLOPE = 0.1
"""Slope of the signed distance below which a pixel is equally far from several parts of the contour."""
_STROKE_ROUNDS = 3
"""A Gaussian as long as a stroke is wide crosses both of its edges, and its halves are soft."""
_LEAST_SHARE_UNDER = 0.1
"""Share of what shows of a Gaussian under a stroke from which on it is cut."""


class Straddlers(NamedTuple):
    """Gaussians that show on both sides of a mask's contour, each with the plane that cuts it best."""

    rows: IntArray
    """Row numbers, ascending, (S,)."""
    normals: Float64Array
    """Unit normals of the cut planes, towards the object, (S, 3)."""
    offsets: Float64Array
    """Signed distance of the centre from the plane, positive inside, in standard deviations along the normal, (S,)."""
    minor_weight: Float64Array
    """Blend weight on the side that the Gaussian shows less on, in the view that gave the plane, (S,)."""


@dataclass(frozen=True, eq=False)
class CutGaussians:
    """Gaussians that are the object's in part."""

    rows: IntArray
    """Their rows, ascending, (S,)."""
    inner: Gaussians
    """Their parts inside the object, (S,)."""
    outer: Gaussians | None
    """Their parts outside it, (S,); None if the rule keeps only one part."""

    def select(self, rows: BoolArray) -> CutGaussians | None:
        """Return some of them, (S,); None if it is none."""
        outer = None if self.outer is None else self.outer.select(rows)
        return CutGaussians(self.rows[rows], self.inner.select(rows), outer) if rows.any() else None


def split_straddlers(
    gaussians: Gaussians,
    candidates: BoolArray,
    accepted: Sequence[TrimmedView],
    boundary: BoundaryConfig,
    config: SplitConfig,
) -> CutGaussians:
    """Cut the Gaussians that straddle the outline of the object in the views.

    Args:
        gaussians: what the views show: L Gaussians, of which the first N may be cut.
        candidates: which of these N may be, (N,).
        accepted: views whose masks were accepted.
        boundary: which Gaussians straddle.
        config: the rule that cuts them.
    """
    if config.rule == "none" or not candidates.any():
        return CutGaussians(np.zeros(0, np.int64), gaussians.select(slice(0)), None)
    found = find_straddlers(gaussians, candidates, accepted, boundary)
    return CutGaussians(
        found.rows, *SPLIT_RULES[config.rule](gaussians.select(found.rows), found.normals, found.offsets)
    )


def find_straddlers(
    gaussians: Gaussians,
    candidates: BoolArray,
    views: Sequence[TrimmedView],
    config: BoundaryConfig,
) -> Straddlers:
    """Find straddlers over all views. Where several views find the same one, that of the largest minor weight cuts it.

    Args:
        gaussians: what the views show: L Gaussians, of which the first N may straddle.
        candidates: which of these N may, (N,).
        views: accepted views.
        config: thresholds.
    """

    def in_view(trimmed: TrimmedView) -> Straddlers:
        return straddlers_in_view(gaussians, candidates, trimmed.view.camera, trimmed.mask, config)

    found = Straddlers._make(map(np.concatenate, zip(*parallel_map(in_view, views), strict=True)))
    order = np.lexsort((-found.minor_weight, found.rows))
    first = order[np.unique(found.rows[order], return_index=True)[1]]
    return Straddlers._make(values[first] for values in found)


def contour_pixels(mask: BoolArray, band: int) -> IntArray:
    """Return pixels (x, y) within `band` of a mask's contour, on either side, (P, 2); the image's edge is none."""
    kernel = np.ones((2 * band + 1, 2 * band + 1), np.uint8)
    padded = cv2.copyMakeBorder(mask.astype(np.uint8), band, band, band, band, cv2.BORDER_REPLICATE)
    ring = (cv2.dilate(padded, kernel) != cv2.erode(padded, kernel))[band:-band, band:-band]
    rows, columns = np.nonzero(ring)
    return np.stack([columns, rows], axis=1)


def signed_distance(mask: BoolArray) -> FloatArray:
    """Return the distance of every pixel to the mask's contour in pixels, positive inside, (H, W)."""
    return np.asarray(np.where(mask, distance_to_outside(mask) - 0.5, 0.5 - distance_to_outside(~mask)), np.float32)


def straddlers_in_view(
    gaussians: Gaussians,
    candidates: BoolArray,
    camera: Camera,
    mask: BoolArray,
    config: BoundaryConfig,
) -> Straddlers:
    """Find the straddlers of one mask (H, W); arguments as those of `find_straddlers`."""
    none = Straddlers(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0), np.zeros(0))
    pixels = contour_pixels(mask, config.band)
    if len(pixels) == 0:
        return none
    ids, contributions = top_contributors(gaussians, camera, pixels, config.contributors)
    rows = np.unique(ids[(ids >= 0) & (ids < len(candidates)) & (contributions > 0)])
    weights = blend_weights(gaussians, camera, mask.astype(np.uint8), 2)
    minor_weight = weights.min(axis=1)
    rows = rows[candidates[rows] & (minor_weight[rows] > 0)]
    if len(rows) == 0:
        return none
    normals, distances = _tangent_planes(gaussians.means[rows].astype(np.float64), camera, mask)
    covariances = gaussians.select(rows).covariances()
    spread = np.sqrt(np.einsum("ni,nij,nj->n", normals, covariances, normals))
    usable = (spread > 0) & np.isfinite(distances)
    offsets = np.divide(distances, spread, out=np.zeros_like(distances), where=spread > 0)
    usable &= np.abs(offsets) < _MAX_OFFSET
    return Straddlers(rows[usable], normals[usable], offsets[usable], minor_weight[rows][usable].astype(np.float64))


def _tangent_planes(means: Float64Array, camera: Camera, mask: BoolArray) -> tuple[Float64Array, Float64Array]:
    """Find the plane through the camera and the tangent of the contour nearest to the projection of each centre (S, 3).

    Returns unit normals towards the mask's inside (S, 3) and the centres' signed distances in scene units (S,). The
    contour is where the smoothed signed distance is zero; its gradient at the centre's pixel points across the contour.
    """
    height, width = mask.shape
    distance = cv2.GaussianBlur(signed_distance(mask), (0, 0), _CONTOUR_SMOOTHING)
    slope_y, slope_x = np.gradient(distance)
    pixels, _ = camera.project(means)
    column = np.clip(np.nan_to_num(pixels[:, 0]), 0, width - 1).astype(np.int64)
    row = np.clip(np.nan_to_num(pixels[:, 1]), 0, height - 1).astype(np.int64)
    across = np.stack([slope_x[row, column], slope_y[row, column]], axis=1).astype(np.float64)
    slope = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.divide(across, slope, out=np.zeros_like(across), where=slope > _MIN_SLOPE)
    # Two pixels of the tangent line: the contour's nearest point, and one beside it.
    nearest_point = np.stack([column, row], axis=1) + 0.5 - distance[row, column, None] * across
    tangent = np.stack([-across[:, 1], across[:, 0]], axis=1)
    first, second = (camera.ray_directions(nearest_point + step * tangent) for step in (-1.0, 1.0))
    normals = np.cross(first, second)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    inner = camera.ray_directions(nearest_point + across)
    normals *= np.where(np.einsum("ni,ni->n", normals, inner) < 0, -1.0, 1.0)[:, None]
    distances = np.einsum("ni,ni->n", normals, means - camera.centre)
    return normals, np.where(slope[:, 0] > _MIN_SLOPE, distances, np.nan)


def cut_at_stroke(pieces: Pieces, cut: StrokeCut, taken: Gaussians) -> tuple[Pieces, Pieces]:
    """Cut an object, seen alone, at a stroke: what crosses both of its edges, or shows under what was cut, in rounds.

    Parts and fitted Gaussians under the stroke go. Other whole ones there are not the object's, or were selected again.
    What lies deeper below the surface than the stroke is wide stays.

    Args:
        pieces: the object.
        cut: the stroke.
        taken: what it took away whole before, which hides what lies behind.

    Returns:
        The object, with the Gaussians that were cut after all others, and what was cut off.
    """
    inner, off = pieces, pieces.select(np.zeros(0, np.int64))
    for _ in range(_STROKE_ROUNDS):
        shown = concatenate([inner.gaussians, taken])
        beside, under = blend_weights(shown, cut.camera, cut.mask.astype(np.uint8), 2)[: len(inner.source)].T
        crossing = ~cut.spared[inner.source] & (under > _LEAST_SHARE_UNDER * (under + beside))
        crossing &= ~_is_deeper(shown, cut)[: len(inner.source)]
        found = straddlers_in_view(inner.gaussians, crossing, cut.camera, ~cut.mask, BoundaryConfig())
        gone = crossing & (inner.part | inner.fitted) & (under > beside)
        gone[found.rows] = False
        kept = ~gone
        kept[found.rows] = False
        split = inner.select(found.rows)
        inside, outside = split_plane(split.gaussians, found.normals, found.offsets)
        off = off.followed_by(inner.select(np.flatnonzero(gone))).followed_by(split.parts(outside))
        inner = inner.select(np.flatnonzero(kept)).followed_by(split.parts(inside))
    return inner, off


def _is_deeper(gaussians: Gaussians, cut: StrokeCut) -> BoolArray:
    """Return which centres lie deeper below what a stroke's view shows than half the stroke's width, (M,)."""
    picture = render(gaussians, cut.camera)
    surface = np.where(picture.alpha > HALF, picture.depth, np.inf)
    pixels, depths = cut.camera.project(gaussians.means.astype(np.float64))
    inside = cut.camera.contains(pixels)
    x, y = pixels[inside].astype(np.int64).T
    deeper = np.zeros(len(gaussians), np.bool_)
    reach = distance_to_outside(cut.mask).max() / cut.camera.K[0, 0]
    deeper[inside] = depths[inside] > surface[y, x] * (1 + reach)
    return deeper
