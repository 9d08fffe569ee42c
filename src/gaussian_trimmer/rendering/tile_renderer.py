"""Draw views: tile-based, parallel over the tiles of all views, vectorised over the pixels of a tile.

Three steps, each a compiled kernel: project every Gaussian, list for every tile the Gaussians that reach it from near
to far, blend. What the first two find of single views is kept for the last few pairs of Gaussians and camera, as many
as fit into half a gigabyte, since who selects asks for colours, weights and contributors one after another.

Memory is bounded: where the lists, or the weights of their entries, would take more than half a gigabyte, tiles are
listed and blended part by part. The result does not depend on that, nor on the number of threads: a tile is blended by
one thread, and sums over tiles are taken in a fixed order.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from weakref import ref

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray
from gaussian_trimmer.parallel import for_each, parallel_for
from gaussian_trimmer.rendering.blending import Rendering
from gaussian_trimmer.rendering.numba_kernels import blend_tiles, sum_pairs, top_of_pixels
from gaussian_trimmer.rendering.projection import Projection, project_views, tiles_of
from gaussian_trimmer.rendering.projection_kernels import AREA, Tiles

_KEPT_BYTES = 1 << 29
"""Memory for projections that are kept for the next call; the last one is kept however large it is."""
_TOGETHER_BYTES = 1 << 28
"""Memory for views that are drawn together, unless a single one takes more."""
_BYTES_OF_A_GAUSSIAN, _BYTES_OF_A_PIXEL = 64, 64
_NO_LABELS = np.zeros((0, 1, AREA), np.float32)
UNDECIDED = np.float32(0.5)
"""Share inside the masks, and probability, that speak neither for the object nor against it."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """V views of N Gaussians that were drawn, and what is needed to ask for more of them."""

    gaussians: Gaussians
    projection: Projection
    tiled: FloatArray
    """Colours if they were asked for, depth, values that were given, and alpha, (C, T, A)."""
    weights: FloatArray
    """Blend weight of each Gaussian under each image that was given, (V, N, L)."""
    coloured: bool = True

    @property
    def cameras(self) -> Sequence[Camera]:
        """The views' cameras."""
        return self.projection.cameras

    @cached_property
    def images(self) -> list[FloatArray]:
        """Colour and alpha, (4, H, W) each."""
        return self.projection.images(self.tiled[[0, 1, 2, -1]])

    @cached_property
    def rgb(self) -> list[FloatArray]:
        """Colours, (3, H, W) each."""
        return self.projection.images(self.tiled[:3])

    @cached_property
    def alpha(self) -> list[FloatArray]:
        """Accumulated opacity, (H, W) each."""
        return [image[0] for image in self.projection.images(self.tiled[-1:])]

    @cached_property
    def depth(self) -> list[FloatArray]:
        """Depth as in `Rendering`, (H, W) each."""
        first = 3 * self.coloured
        depth, alpha = self.tiled[first : first + 1], self.tiled[-1:]
        depth = np.divide(depth, alpha, out=np.zeros_like(depth), where=alpha > 0)
        return [image[0] for image in self.projection.images(depth)]

    @cached_property
    def values(self) -> list[FloatArray]:
        """Blended values, (C, H, W) each."""
        return self.projection.images(self.tiled[3 * self.coloured + 1 : -1])

    def blend(self, values: FloatArray, around: BoolArray) -> list[FloatArray]:
        """Sum over Gaussians of blend weight times their values (N, C) at each pixel, (C, H, W) each.

        Zero beside the tiles that some of them (N,) reach.
        """
        projection = self.projection.around(around)
        return projection.images(_blend(projection, values[projection.rows])[0][:-1])

    def weigh(self, images: Sequence[FloatArray]) -> FloatArray:
        """Sum over pixels of blend weight times each of the images of each view (L, H, W), (V, N, L)."""
        nothing = np.zeros((len(self.projection.rows), 0), np.float32)
        sums = _blend(self.projection, nothing, self.projection.tiled(images))[1]
        return self.projection.scattered(sums)

    def renderings(self) -> list[Rendering]:
        """Return what each camera sees; without colours if they were not asked for."""
        none = np.zeros((0, 0, 3), np.float32)
        rgb = [np.asarray(cv2.merge(list(image))) for image in self.rgb] if self.coloured else [none] * len(self.depth)
        weights = [found if found.shape[1] > 1 else found.ravel() for found in self.weights]
        alpha = [np.ascontiguousarray(image) for image in self.alpha]
        return [Rendering(*shown) for shown in zip(rgb, alpha, self.depth, weights, strict=True)]


def draw(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    *,
    values: FloatArray | None = None,
    images: Sequence[FloatArray] | None = None,
    around: BoolArray | None = None,
    colours: bool = True,
) -> Drawing:
    """Draw some views at once.

    Args:
        gaussians: N Gaussians.
        cameras: the views.
        values: of the Gaussians, (N, C), which are blended like colours.
        images: of each view, (L, H, W), under which blend weights are summed.
        around: Gaussians whose tiles are drawn, (N,); others stay empty. None: all.
        colours: whether colours are asked for.
    """
    projection = project_views(gaussians, cameras, around, colours=colours)
    return draw_projected(gaussians, projection, values=values, images=images, colours=colours)


def draw_projected(
    gaussians: Gaussians,
    projection: Projection,
    *,
    values: FloatArray | None = None,
    images: Sequence[FloatArray] | None = None,
    colours: bool = True,
) -> Drawing:
    """Draw views of Gaussians, or of a part of them, that were projected already; as `draw` otherwise."""
    shown = projection.colours if colours else np.ascontiguousarray(projection.colours[:, 3:])
    if values is not None:
        shown = np.concatenate([shown, values[projection.rows]], axis=1)
    labels = _NO_LABELS if images is None else projection.tiled(images)
    tiled, sums = _blend(projection, shown, labels)
    return Drawing(gaussians, projection, tiled, projection.scattered(sums), colours)


def portions(gaussians: Gaussians, cameras: Sequence[Camera]) -> Iterator[slice]:
    """Yield the views in portions that can be drawn at once within memory."""
    pixels = max((camera.width * camera.height for camera in cameras), default=1)
    room = _TOGETHER_BYTES // (_BYTES_OF_A_GAUSSIAN * len(gaussians) + _BYTES_OF_A_PIXEL * pixels)
    for first in range(0, len(cameras), max(1, room)):
        yield slice(first, first + max(1, room))


def render_views(
    gaussians: Gaussians, cameras: Sequence[Camera], masks: Sequence[BoolArray] | None = None, *, colours: bool = True
) -> Iterator[Rendering]:
    """Yield what each of some cameras sees; with masks (H, W), with the blend weights outside and inside of each."""
    for some in portions(gaussians, cameras):
        images = None if masks is None else [np.stack([~mask, mask]).astype(np.float32) for mask in masks[some]]
        yield from draw(gaussians, cameras[some], images=images, colours=colours).renderings()


def render(
    gaussians: Gaussians, camera: Camera, background: FloatArray | None = None, weights: bool = False
) -> Rendering:
    """Render colour, alpha and depth of a view and, in the same pass if asked for, the blend weights of Gaussians.

    Accurate to about 1e-4 in colour against a computation in float64. `background` is an RGB colour (3,), black if not
    given.
    """
    projection = _kept_projections.project(gaussians, camera)
    labels = np.ones((1, len(projection.places), AREA), np.float32) if weights else _NO_LABELS
    tiled, sums = _blend(projection, projection.colours, labels)
    (found,) = Drawing(gaussians, projection, tiled, projection.scattered(sums)).renderings()
    if background is None:
        return found
    rgb = found.rgb + (1 - found.alpha)[..., None] * np.asarray(background, np.float32)
    return Rendering(rgb, found.alpha, found.depth, found.weights)


def blend_values(gaussians: Gaussians, camera: Camera, values: FloatArray) -> FloatArray:
    """Sum over Gaussians of alpha_i T_i values_i at each pixel, for any values (N, C), as (H, W, C)."""
    projection = _kept_projections.project(gaussians, camera)
    drawn = np.ascontiguousarray(values[projection.rows], np.float32)
    return np.stack(list(projection.images(_blend(projection, drawn)[0][:-1])[0]), axis=-1)


def blend_weights(gaussians: Gaussians, camera: Camera, labels: NDArray[np.uint8], n_labels: int) -> FloatArray:
    """Sum over pixels of alpha_i T_i, separately by the pixels' labels (H, W), as (N, n_labels).

    Pixels whose label is n_labels or more are left out.
    """
    projection = _kept_projections.project(gaussians, camera)
    return np.asarray(_weighed(projection, [labels], n_labels)[0])


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
    images = iter(labels)
    for some in portions(gaussians, cameras):
        projection = project_views(gaussians, cameras[some], colours=False)
        of_views = [image.astype(np.uint8) for image in islice(images, len(cameras[some]))]
        yield from _weighed(projection, of_views, n_labels)


def shown_weights(gaussians: Gaussians, cameras: Sequence[Camera]) -> list[FloatArray]:
    """Blend weights of each Gaussian in each view, in pixels, (N,) each."""
    whole = (np.zeros((camera.height, camera.width), np.uint8) for camera in cameras)
    return [weights[:, 0] for weights in label_weights(gaussians, cameras, whole, 1)]


def _weighed(projection: Projection, labels: Sequence[NDArray[np.uint8]], n_labels: int) -> FloatArray:
    """Return blend weights of N Gaussians by the label of each pixel of each view (H, W), (V, N, n_labels)."""
    numbers = np.arange(n_labels, dtype=np.uint8)[:, None, None]
    tiled = projection.tiled([(image == numbers).astype(np.float32) for image in labels])
    return projection.scattered(_blend(projection, np.zeros((len(projection.rows), 0), np.float32), tiled)[1])


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
    across = tiles_of(camera)[0]
    for tiles in projection.parts():
        parallel_for(
            lambda first, last, tiles=tiles: top_of_pixels(  # type: ignore[misc]
                projection.splats, tiles, across, pixels[first:last], ids[first:last], weights[first:last]
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
        projection = project_views(gaussians, [camera])
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


def _blend(
    projection: Projection, values: FloatArray, labels: FloatArray = _NO_LABELS
) -> tuple[FloatArray, FloatArray]:
    """Return values (M, C) blended, then alpha, (C + 1, T, A), and weights under label pictures (L, T, A), (M, L)."""
    image = np.empty((values.shape[1] + 1, len(projection.tile_starts) - 1, AREA), np.float32)
    sums = np.zeros((len(projection.rows), len(labels)), np.float32)
    for tiles in projection.parts(len(labels)):
        pairs = np.zeros((len(tiles.lists), len(labels)), np.float32)
        parallel_for(
            lambda first, last, tiles=tiles, pairs=pairs: blend_tiles(  # type: ignore[misc]
                projection.splats, values, tiles, labels, image, pairs, (first, last)
            ),
            len(tiles.starts) - 1,
        )
        if len(labels):
            sum_over_tiles(projection, tiles, pairs, np.ones(len(tiles.starts) - 1, np.bool_), sums)
    return image, sums


def sum_over_tiles(projection: Projection, tiles: Tiles, pairs: FloatArray, busy: BoolArray, sums: FloatArray) -> None:
    """Add sums of pairs (P, K) in busy tiles (T,) to those of drawn Gaussians (M, K), view by view."""
    for_each(
        lambda part: sum_pairs(pairs, tiles.starts[part[0] : part[1] + 1], tiles.lists, busy[slice(*part)], sums),
        projection.by_view(tiles),
    )
