"""The CPU renderer: tile-based, parallel over tiles, vectorised over the pixels of a tile.

Three steps, each a compiled kernel: project every Gaussian, list for every tile the Gaussians that reach it from near
to far, blend. The first two are kept for the last few pairs of Gaussians and camera, since the trimmer asks for the
colours, the weights and the contributors of the same view one after another.

The result does not depend on the number of threads: a tile is blended by one thread, and sums over tiles are taken
in a fixed order.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.compiling import KERNELS
from gaussian_trimmer.gaussians import FloatArray, Gaussians, IntArray
from gaussian_trimmer.rendering import FRUSTUM_MARGIN, Rendering, pixels_inside
from gaussian_trimmer.rendering.numba_kernels import (
    TILE,
    bin_gaussians,
    blend_tiles,
    count_tiles,
    project,
    sum_pairs,
    top_of_pixels,
)

_KEPT_PROJECTIONS = 24
_NO_LABELS = np.zeros((0, 1, 1), np.float32)


@dataclass(frozen=True, eq=False)
class Projection:
    """The M Gaussians of a view that can reach a pixel, from near to far, and the tiles that they reach."""

    rows: IntArray
    """Row of each drawn Gaussian in the scene, (M,)."""
    splats: FloatArray
    """Pixel centre (2), factor of the inverse covariance (3), opacity, half extents (2), (M, 8)."""
    colours: FloatArray
    """RGB and depth, (M, 4)."""
    tile_starts: NDArray[np.int32]
    """Where each tile's list begins in `tile_lists`, row-major tiles, (T + 1,)."""
    tile_lists: NDArray[np.int32]
    """Indices into the arrays above, from near to far, tile after tile, (P,)."""
    tile_spans: NDArray[np.uint8]
    """First and one past the last row of its tile that each entry of `tile_lists` reaches, (P, 2)."""

    def scattered(self, sums: FloatArray, n: int) -> FloatArray:
        """Sums of drawn Gaussians (M, L) as sums of all Gaussians (n, L)."""
        all_sums = np.zeros((n, sums.shape[1]), np.float32)
        all_sums[self.rows] = sums
        return all_sums


class NumbaRenderer:
    """Renders on the CPU. Accurate to about 1e-4 in colour against the float64 reference."""

    name = "numba"

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[int, int], tuple[Gaussians, Camera, Projection]] = OrderedDict()

    def render(
        self, gaussians: Gaussians, camera: Camera, background: FloatArray | None = None, weights: bool = False
    ) -> Rendering:
        """Colour, alpha and depth of a view, and the Gaussians' blend weights if asked for; see `Renderer.render`."""
        projection = self._projection(gaussians, camera)
        labels = np.ones((int(weights), camera.height, camera.width), np.float32)
        image, sums = _blend(projection, projection.colours, camera, labels)
        rgb, alpha = np.asarray(cv2.merge(list(image[:3])), np.float32), np.ascontiguousarray(image[4])
        if background is not None:
            rgb = rgb + (1 - alpha)[..., None] * np.asarray(background, np.float32)
        depth = np.divide(image[3], alpha, out=np.zeros_like(alpha), where=alpha > 0)
        return Rendering(rgb, alpha, depth, projection.scattered(sums, len(gaussians)).ravel())

    def blend_values(self, gaussians: Gaussians, camera: Camera, values: FloatArray) -> FloatArray:
        """Blend-weighted sums of per-Gaussian values; see `Renderer.blend_values`."""
        projection = self._projection(gaussians, camera)
        drawn = np.ascontiguousarray(values[projection.rows], np.float32)
        return np.stack(list(_blend(projection, drawn, camera, _NO_LABELS)[0][:-1]), axis=-1)

    def blend_weights(
        self, gaussians: Gaussians, camera: Camera, labels: NDArray[np.uint8], n_labels: int
    ) -> FloatArray:
        """Sum over pixels of alpha_i T_i by label; see `Renderer.blend_weights`."""
        projection = self._projection(gaussians, camera)
        indicators = (labels[None] == np.arange(n_labels, dtype=np.uint8)[:, None, None]).astype(np.float32)
        no_values = np.zeros((len(projection.rows), 0), np.float32)
        return projection.scattered(_blend(projection, no_values, camera, indicators)[1], len(gaussians))

    def top_contributors(
        self, gaussians: Gaussians, camera: Camera, pixels: IntArray, k: int
    ) -> tuple[IntArray, FloatArray]:
        """The k largest blend weights at each asked pixel; see `Renderer.top_contributors`."""
        pixels = pixels_inside(pixels, camera)
        projection = self._projection(gaussians, camera)
        with KERNELS:
            ids, weights = top_of_pixels(
                projection.splats,
                projection.tile_starts,
                projection.tile_lists,
                projection.tile_spans,
                camera.width,
                pixels,
                k,
            )
        return np.where(ids >= 0, projection.rows[ids] if len(projection.rows) else -1, -1), weights

    def _projection(self, gaussians: Gaussians, camera: Camera) -> Projection:
        key = (id(gaussians), id(camera))  # Both objects are kept beside the result, so the ids stay theirs.
        if key not in self._kept:
            self._kept[key] = (gaussians, camera, project_view(gaussians, camera))
            if len(self._kept) > _KEPT_PROJECTIONS:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key][2]


def project_view(gaussians: Gaussians, camera: Camera) -> Projection:
    """Project, sort by depth (ties by row) and bin into tiles."""
    margin = FRUSTUM_MARGIN * np.array([camera.width, camera.height])
    fx, fy, cx, cy = camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]
    limits = np.array([
        (-margin[0] - cx) / fx, (camera.width + margin[0] - cx) / fx,
        (-margin[1] - cy) / fy, (camera.height + margin[1] - cy) / fy,
    ])  # fmt: skip
    lens = np.array([fx, fy, cx, cy, camera.width, camera.height, camera.near])
    with KERNELS:
        splats, colours, drawn = project(
            gaussians.means, gaussians.log_scales, gaussians.quaternions, gaussians.opacity_logits,
            gaussians.sh_dc, gaussians.sh_rest, np.ascontiguousarray(camera.world_to_camera), camera.centre, lens,
            limits,
        )  # fmt: skip
        # A key of depth bits above the row number sorts by depth, ties by row, with one plain sort.
        candidates = np.flatnonzero(drawn)
        keys = colours[candidates, 3].view(np.uint32).astype(np.uint64) << np.uint64(32) | candidates.astype(np.uint64)
        keys.sort()
        rows = (keys & np.uint64(0xFFFFFFFF)).astype(np.int64)
        splats, colours = splats[rows], colours[rows]
        counts = count_tiles(splats, camera.width, camera.height)
        starts = np.zeros(len(counts) + 1, np.int32)
        np.cumsum(counts, out=starts[1:])
        lists, spans = bin_gaussians(splats, camera.width, camera.height, starts)
    return Projection(rows, splats, colours, starts, lists, spans)


def _blend(
    projection: Projection, values: FloatArray, camera: Camera, labels: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Blended values followed by alpha, (C + 1, H, W), and blend weights under label images (L, H, W), (M, L)."""
    with KERNELS:
        image, pairs = blend_tiles(
            projection.splats, values, projection.tile_starts, projection.tile_lists, projection.tile_spans,
            camera.width, camera.height, _padded(labels),
        )  # fmt: skip
        sums = sum_pairs(pairs, projection.tile_lists, len(projection.rows))
    return image[:, : camera.height, : camera.width], sums


def _padded(indicators: FloatArray) -> FloatArray:
    """Images (L, H, W) extended with zeros to whole tiles."""
    _, height, width = indicators.shape
    return np.pad(indicators, ((0, 0), (0, -height % TILE), (0, -width % TILE)))
