"""Draw views: tile-based, parallel over tiles, vectorised over the pixels of a tile.

Three steps, each a compiled kernel: project every Gaussian, list for every tile the Gaussians that reach it from near
to far, blend. The first two are kept for the last few pairs of Gaussians and camera, as many as fit into half a
gigabyte, since the trimmer asks for the colours, the weights and the contributors of the same view one after another.

Memory is bounded: where the lists, or the weights of their entries, would take more than half a gigabyte, tiles are
listed and blended part by part. The result does not depend on that, nor on the number of threads: a tile is blended by
one thread, and sums over tiles are taken in a fixed order.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any
from weakref import ref

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray
from gaussian_trimmer.parallel import WORTH_A_THREAD, parallel_for, parallel_map
from gaussian_trimmer.rendering.blending import FRUSTUM_MARGIN, MOST_PAIRS, Rendering
from gaussian_trimmer.rendering.numba_kernels import blend_tiles, sum_pairs, top_of_pixels
from gaussian_trimmer.rendering.projection_kernels import (
    TILE,
    Ellipsoids,
    Pinhole,
    Tiles,
    bin_gaussians,
    count_tiles,
    project,
)

_KEPT_BYTES = 1 << 29
"""Memory for projections that are kept for the next call; the last one is kept however large it is."""
_LISTED_BYTES = 1 << 29
"""Memory for the lists of a view's tiles, and for the weights of their entries."""
_BYTES_OF_A_PAIR = 6
_BYTES_OF_A_WEIGHT = 4
_PROJECTED_TOGETHER = 1 << 16
"""Gaussians that are projected in one call, so that what is copied of a table stays small."""
_NO_LABELS = np.zeros((0, 1, 1), np.float32)
UNDECIDED = np.float32(0.5)
"""Share inside the masks, and probability, that speak neither for the object nor against it."""


@dataclass(frozen=True, eq=False)
class Projection:
    """The M Gaussians of a view that can reach a pixel, from near to far, and the tiles that they reach."""

    rows: IntArray
    """Row of each drawn Gaussian in the scene, (M,)."""
    splats: FloatArray
    """Pixel centre (2), factor of the inverse covariance (3), opacity, half extents (2), (M, 8)."""
    colours: FloatArray
    """RGB and depth, (M, 4)."""
    tile_starts: IntArray
    """Where each tile's list begins among the lists of all tiles, row-major tiles, (T + 1,)."""
    tiles: Tiles | None
    """The lists of all tiles, or None where they are so long that they are made part by part."""

    @property
    def nbytes(self) -> int:
        """Memory held."""
        lists = self.tiles.lists.nbytes + self.tiles.spans.nbytes if self.tiles else 0
        return self.rows.nbytes + self.splats.nbytes + self.colours.nbytes + self.tile_starts.nbytes + lists

    def parts(self, camera: Camera, n_labels: int = 0) -> Iterator[Tiles]:
        """Yield all tiles in order, in as few runs as keep lists, and n_labels weights of each entry, within memory."""
        of_an_entry = max(_BYTES_OF_A_PAIR, _BYTES_OF_A_WEIGHT * n_labels)
        first, n_tiles, starts = 0, len(self.tile_starts) - 1, self.tile_starts
        while first < n_tiles:
            room = starts[first] + _LISTED_BYTES // of_an_entry
            last = max(int(np.searchsorted(starts, room, side="right")) - 1, first + 1)
            yield self._listed(first, min(last, n_tiles), camera)
            first = last

    def _listed(self, first: int, last: int, camera: Camera) -> Tiles:
        """Return the tiles from `first` up to before `last`."""
        begin, end = self.tile_starts[[first, last]]
        starts = self.tile_starts[first : last + 1] - begin
        if self.tiles is not None:
            lists, spans = self.tiles.lists[begin:end], self.tiles.spans[begin:end]
            return Tiles(first, starts, lists, spans, camera.width, camera.height)
        return _binned(self.splats, starts, first, camera)

    def scattered(self, sums: FloatArray, n: int) -> FloatArray:
        """Return sums of drawn Gaussians (M, L) as sums of all Gaussians (n, L)."""
        all_sums = np.zeros((n, sums.shape[1]), np.float32)
        all_sums[self.rows] = sums
        return all_sums


def render(
    gaussians: Gaussians,
    camera: Camera,
    background: FloatArray | None = None,
    weights: bool = False,
    mask: BoolArray | None = None,
) -> Rendering:
    """Render colour, alpha and depth of a view and, in the same pass if asked for, the blend weights of Gaussians.

    Accurate to about 1e-4 in colour against a computation in float64. `background` is an RGB colour (3,), black if not
    given. With a mask (H, W), the blend weights are those outside and inside of it.
    """
    projection = _kept_projections.project(gaussians, camera)
    labels = np.ones((int(weights), camera.height, camera.width), np.float32)
    if mask is not None:
        labels = np.stack([~mask, mask]).astype(np.float32)
    image, sums = _blend(projection, projection.colours, camera, labels)
    rgb, alpha = np.asarray(cv2.merge(list(image[:3])), np.float32), np.ascontiguousarray(image[4])
    if background is not None:
        rgb = rgb + (1 - alpha)[..., None] * np.asarray(background, np.float32)
    depth = np.divide(image[3], alpha, out=np.zeros_like(alpha), where=alpha > 0)
    sums = projection.scattered(sums, len(gaussians))
    return Rendering(rgb, alpha, depth, sums.ravel() if mask is None else sums)


def blend_values(gaussians: Gaussians, camera: Camera, values: FloatArray) -> FloatArray:
    """Sum over Gaussians of alpha_i T_i values_i at each pixel, for any values (N, C), as (H, W, C)."""
    projection = _kept_projections.project(gaussians, camera)
    drawn = np.ascontiguousarray(values[projection.rows], np.float32)
    return np.stack(list(_blend(projection, drawn, camera, _NO_LABELS)[0][:-1]), axis=-1)


def blend_weights(gaussians: Gaussians, camera: Camera, labels: NDArray[np.uint8], n_labels: int) -> FloatArray:
    """Sum over pixels of alpha_i T_i, separately by the pixels' labels (H, W), as (N, n_labels).

    Pixels whose label is n_labels or more are left out.
    """
    projection = _kept_projections.project(gaussians, camera)
    indicators = (labels[None] == np.arange(n_labels, dtype=np.uint8)[:, None, None]).astype(np.float32)
    no_values = np.zeros((len(projection.rows), 0), np.float32)
    return projection.scattered(_blend(projection, no_values, camera, indicators)[1], len(gaussians))


def label_weights(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    labels: Iterable[NDArray[np.uint8] | BoolArray],
    n_labels: int = 2,
) -> Iterator[FloatArray]:
    """Blend weights of each Gaussian summed over the pixels of each label, (N, n_labels), one array a view.

    Args:
        gaussians: what the views show, N Gaussians.
        cameras: the cameras of the views.
        labels: the label of each pixel, (H, W) each; of a mask, 0 outside and 1 inside.
        n_labels: how many labels there are; pixels of higher ones are left out.
    """

    def weights(camera: Camera, image: NDArray[np.uint8] | BoolArray) -> FloatArray:
        return blend_weights(gaussians, camera, image.astype(np.uint8), n_labels)

    return parallel_map(weights, cameras, labels)


def share_inside(weights: FloatArray, min_weight: float = 0.0) -> FloatArray:
    """Return the share of the blend weights outside and inside of masks (N, 2) that is inside, (N,).

    It is one half where there is no more weight than `min_weight`.
    """
    total = weights.sum(axis=1)
    share = np.full_like(total, UNDECIDED)
    return np.asarray(np.divide(weights[:, 1], total, out=share, where=total > min_weight))


def top_contributors(gaussians: Gaussians, camera: Camera, pixels: IntArray, k: int) -> tuple[IntArray, FloatArray]:
    """Return the k Gaussians of largest blend weight at each asked pixel (x, y), by reverse alpha blending.

    Returns row numbers (P, k), -1 where fewer than k contribute, and weights (P, k) in falling order.

    Raises:
        ValueError: a pixel lies outside the camera's image.
    """
    pixels = np.asarray(pixels, np.int64).reshape(-1, 2)
    if len(pixels) and not ((pixels >= 0).all() and (pixels < [camera.width, camera.height]).all()):
        raise ValueError(f"Pixels must lie in the image of {camera.width} x {camera.height}.")
    projection = _kept_projections.project(gaussians, camera)
    ids, weights = np.full((len(pixels), k), -1, np.int64), np.zeros((len(pixels), k), np.float32)
    for tiles in projection.parts(camera):
        parallel_for(
            lambda first, last, tiles=tiles: top_of_pixels(  # type: ignore[misc]
                projection.splats, tiles, pixels[first:last], ids[first:last], weights[first:last]
            ),
            len(pixels),
        )
    return np.where(ids >= 0, projection.rows[ids] if len(projection.rows) else -1, -1), weights


class ProjectionCache:
    """The projections of the last few pairs of Gaussians and camera; it keeps neither of them alive."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[int, int], tuple[ref[Gaussians], ref[Camera], Projection]] = OrderedDict()
        self._looking = threading.Lock()

    def project(self, gaussians: Gaussians, camera: Camera) -> Projection:
        """Project Gaussians into a camera at the first call, and keep the projection while there is room for it."""
        key = id(gaussians), id(camera)
        with self._looking:
            known = self._kept.get(key)
            if known and known[0]() is gaussians and known[1]() is camera:  # An id may have passed to another object.
                self._kept.move_to_end(key)
                return known[2]
        projection = project_view(gaussians, camera)
        with self._looking:
            self._kept[key] = ref(gaussians), ref(camera), projection
            self._kept.move_to_end(key)
            self._forget()
        return projection

    def _forget(self) -> None:
        """Let go of the projections of what no longer exists, and of the oldest ones beyond the memory for them."""
        for key, (gaussians, camera, _) in list(self._kept.items()):
            if gaussians() is None or camera() is None:
                del self._kept[key]
        held = sum(projection.nbytes for *_, projection in self._kept.values())
        while len(self._kept) > 1 and held > _KEPT_BYTES:
            held -= self._kept.popitem(last=False)[1][2].nbytes


_kept_projections = ProjectionCache()


def project_view(gaussians: Gaussians, camera: Camera, wanted: BoolArray | None = None) -> Projection:
    """Project, sort by depth (ties by row) and bin into tiles; into those wanted only, (T,), if that is given.

    Raises:
        InputError: the pairs of a tile and a Gaussian that reaches it are more than `MOST_PAIRS`.
    """
    splats, colours, drawn = _projected(gaussians, camera)
    # A key of depth bits above the row number sorts by depth, ties by row, with one plain sort.
    candidates = np.flatnonzero(drawn)
    keys = colours[candidates, 3].view(np.uint32).astype(np.uint64) << np.uint64(32) | candidates.astype(np.uint64)
    keys.sort()
    rows = (keys & np.uint64(0xFFFFFFFF)).astype(np.int64)
    splats, colours = splats.take(rows, axis=0), colours.take(rows, axis=0)
    across, down = -(-camera.width // TILE), -(-camera.height // TILE)
    table = np.zeros((down + 1, across), np.int64)
    _by_columns(lambda first, last: count_tiles(splats, camera.height, table, first, last), across, len(splats))
    counts = table[:-1].ravel()
    if wanted is not None:
        counts[~wanted] = 0
    starts = np.zeros(len(counts) + 1, np.int64)
    np.cumsum(counts, out=starts[1:])
    if starts[-1] > MOST_PAIRS:
        raise InputError(
            f"A view of {camera.width} x {camera.height} pixels consists of {starts[-1]:,} pairs of a tile and a "
            f"Gaussian that reaches it, and at most {MOST_PAIRS:,} can be drawn; take smaller views, or remove "
            "Gaussians that are as large as the whole picture."
        )
    listed = starts[-1] * _BYTES_OF_A_PAIR <= _LISTED_BYTES
    return Projection(rows, splats, colours, starts, _binned(splats, starts, 0, camera) if listed else None)


def _projected(gaussians: Gaussians, camera: Camera) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return what `project` finds of all Gaussians; columns of a table become arrays of their own share by share."""
    n = len(gaussians)
    found = np.empty((n, 8), np.float32), np.empty((n, 4), np.float32), np.zeros(n, np.bool_)
    pinhole = pinhole_of(camera, gaussians.antialiased)

    def part(first: int, last: int) -> None:
        share = slice(first, last)
        sh_dc, sh_rest = _owned(gaussians.sh_dc[share]), _owned(gaussians.sh_rest[share])
        project(ellipsoids_of(gaussians, share), sh_dc, sh_rest, pinhole, *(array[share] for array in found))

    parallel_for(part, n, _PROJECTED_TOGETHER, at_least=WORTH_A_THREAD)
    return found


def _binned(splats: FloatArray, starts: IntArray, first_tile: int, camera: Camera) -> Tiles:
    """Return the tiles from `first_tile` on whose lists begin at `starts` (T + 1,), with their lists."""
    lists, spans = np.zeros(starts[-1], np.int32), np.zeros((starts[-1], 2), np.uint8)
    tiles = Tiles(first_tile, starts, lists, spans, camera.width, camera.height)
    ends = starts[:-1].copy()
    across = -(-camera.width // TILE)
    _by_columns(lambda first, last: bin_gaussians(splats, tiles, ends, first, last), across, len(splats))
    return tiles


def _by_columns(work: Callable[[int, int], Any], across: int, n_splats: int) -> None:
    """Call work(first, last) for columns of tiles, side by side if there are many Gaussians to go through for each."""
    parallel_for(work, across, at_least=1 if n_splats >= WORTH_A_THREAD else across)


def _owned(values: FloatArray) -> FloatArray:
    """Return the same array, or a copy if it is a column of a table or cannot be written: kernels are compiled once."""
    return np.require(values, requirements=("C", "W"))


def ellipsoids_of(gaussians: Gaussians, rows: IntArray | slice) -> Ellipsoids:
    """Return gaussians, or some of them, as the kernels take them."""
    g = gaussians
    return Ellipsoids(*(_owned(a[rows]) for a in (g.means, g.log_scales, g.quaternions, g.opacity_logits)))


def pinhole_of(camera: Camera, antialiased: bool) -> Pinhole:
    """Return a camera as the kernels take it, for Gaussians that are antialiased or not."""
    margin = FRUSTUM_MARGIN * np.array([camera.width, camera.height])
    fx, fy, cx, cy = camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]
    with np.errstate(all="ignore"):  # Lenses that are possible in name only show nothing; the kernel sees to that.
        limits = np.array(
            [
                (-margin[0] - cx) / fx,
                (camera.width + margin[0] - cx) / fx,
                (-margin[1] - cy) / fy,
                (camera.height + margin[1] - cy) / fy,
            ]
        )
    lens = np.array([fx, fy, cx, cy, camera.width, camera.height, camera.near, antialiased], np.float64)
    return Pinhole(np.ascontiguousarray(camera.world_to_camera), camera.centre, lens, limits)


def _blend(
    projection: Projection, values: FloatArray, camera: Camera, labels: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return blended values, then alpha, (C + 1, H, W), and blend weights under label images (L, H, W), (M, L)."""
    image, sums = blend_view(projection, values, camera, labels)
    return image[:, : camera.height, : camera.width], sums


def blend_view(
    projection: Projection, values: FloatArray, camera: Camera, labels: FloatArray = _NO_LABELS
) -> tuple[FloatArray, FloatArray]:
    """Return the same, on images of whole tiles: (C + 1, H', W') and (M, L)."""
    labels = whole_tiles(labels)
    across, down = -(-camera.width // TILE), -(-camera.height // TILE)
    image = np.empty((values.shape[1] + 1, down * TILE, across * TILE), np.float32)
    sums = np.zeros((len(projection.rows), len(labels)), np.float32)
    for tiles in projection.parts(camera, len(labels)):
        pairs = np.zeros((len(tiles.lists), len(labels)), np.float32)
        parallel_for(
            lambda first, last, tiles=tiles, pairs=pairs: blend_tiles(  # type: ignore[misc]
                projection.splats, values, tiles, labels, image, pairs, (first, last)
            ),
            len(tiles.starts) - 1,
        )
        sum_pairs(pairs, tiles.lists, sums)
    return image, sums


def whole_tiles(images: FloatArray) -> FloatArray:
    """Extend images (L, H, W) with zeros to whole tiles, (L, H', W'); the same array if they are that already."""
    missing = -images.shape[1] % TILE, -images.shape[2] % TILE
    return np.pad(images, ((0, 0), (0, missing[0]), (0, missing[1]))) if any(missing) and len(images) else images
