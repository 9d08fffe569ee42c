"""Derivatives of a view by the parameters of its Gaussians, on the CPU: what a fit by gradients needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.compiling import KERNELS
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.rendering import FRUSTUM_MARGIN
from gaussian_trimmer.rendering.gradient_kernels import N_PARAMETERS, N_SUMS, differentiate_tiles, gather, sum_moving_pairs
from gaussian_trimmer.rendering.numba_cpu import Projection, _blend, project_view
from gaussian_trimmer.rendering.numba_kernels import TILE, blend_tiles

_NO_LABELS = np.zeros((0, 1, 1), np.float32)


@dataclass(frozen=True, eq=False)
class Drawing:
    """A view that was drawn, and what is needed to differentiate it."""

    gaussians: Gaussians
    camera: Camera
    projection: Projection
    padded: FloatArray
    """Colour, depth and alpha, (5, H', W'), with H' and W' rounded up to whole tiles."""

    @property
    def image(self) -> FloatArray:
        """Colour and alpha, (4, H, W)."""
        return self.padded[[0, 1, 2, 4], : self.camera.height, : self.camera.width]

    @property
    def depth(self) -> FloatArray:
        """Depth as in `Rendering`, (H, W)."""
        depth, alpha = self.padded[3:, : self.camera.height, : self.camera.width]
        return np.divide(depth, alpha, out=np.zeros_like(depth), where=alpha > 0)

    def blend(self, values: FloatArray) -> FloatArray:
        """Blend-weighted sums of per-Gaussian values (N, C), (C, H, W)."""
        return _blend(self.projection, np.ascontiguousarray(values[self.projection.rows]), self.camera, _NO_LABELS)[0][:-1]


def weigh(drawing: Drawing, images: FloatArray) -> FloatArray:
    """Sum over the pixels of each Gaussian's blend weight times each of the images (L, H, W), (N, L)."""
    projection = drawing.projection
    none = np.zeros((len(projection.rows), 0), np.float32)
    return projection.scattered(_blend(projection, none, drawing.camera, images)[1], len(drawing.gaussians))


def draw(gaussians: Gaussians, camera: Camera) -> Drawing:
    """Draw a view as `NumbaRenderer.render` does, without keeping anything for later calls."""
    projection = project_view(gaussians, camera)
    across, down = -(-camera.width // TILE), -(-camera.height // TILE)
    padded = np.empty((5, down * TILE, across * TILE), np.float32)
    for tiles in projection.parts(camera):
        with KERNELS:
            blend_tiles(
                projection.splats, projection.colours, tiles.starts, tiles.lists, tiles.spans, tiles.first,
                camera.width, camera.height, _NO_LABELS, padded,
            )  # fmt: skip
    return Drawing(gaussians, camera, projection, padded)


def gradients(drawing: Drawing, slopes: FloatArray, moving: BoolArray) -> FloatArray:
    """Derivatives of a loss by the parameters of Gaussians, (N, 13).

    The columns are: mean in scene units (3), log-scales (3), turn about the Gaussian's own axes in radians (3), opacity
    logit, sh_dc (3). The change of colour with the direction of view is left out.

    Args:
        drawing: the view.
        slopes: derivatives of the loss by colour and alpha of each pixel, (4, H, W).
        moving: which Gaussians are asked for, (N,); the rows of the others are zero.
    """
    camera, gaussians, projection = drawing.camera, drawing.gaussians, drawing.projection
    padded = np.zeros((4, *drawing.padded.shape[1:]), np.float32)
    padded[:, : camera.height, : camera.width] = slopes
    down, across = padded.shape[1] // TILE, padded.shape[2] // TILE
    busy = padded.any(axis=0).reshape(down, TILE, across, TILE).any(axis=(1, 3)).ravel()
    moves = moving[projection.rows]
    sums = np.zeros((len(projection.rows), N_SUMS), np.float32)
    image = np.ascontiguousarray(drawing.padded[[0, 1, 2, 4]])
    for tiles in projection.parts(camera, N_SUMS):
        part = busy[tiles.first : tiles.first + len(tiles.starts) - 1]
        with KERNELS:
            pairs = differentiate_tiles(
                projection.splats, projection.colours, moves, tiles.starts, tiles.lists, tiles.spans, tiles.first,
                camera.width, camera.height, image, padded, part,
            )  # fmt: skip
            sum_moving_pairs(pairs, tiles.starts, tiles.lists, part, sums)
    chosen = np.flatnonzero(moves)
    rows = projection.rows[chosen]
    out = np.zeros((len(gaussians), N_PARAMETERS), np.float32)
    with KERNELS:
        out[rows] = gather(
            gaussians.means[rows], gaussians.log_scales[rows], gaussians.quaternions[rows],
            gaussians.opacity_logits[rows], np.ascontiguousarray(camera.world_to_camera), _lens(camera),
            _limits(camera), projection.splats[chosen], projection.colours[chosen], sums[chosen],
        )  # fmt: skip
    return out


def _lens(camera: Camera) -> FloatArray:
    return np.array([camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]])


def _limits(camera: Camera) -> FloatArray:
    """Slopes of the widened frustum, as in `project_view`."""
    margin = FRUSTUM_MARGIN * np.array([camera.width, camera.height])
    fx, fy, cx, cy = camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]
    return np.array([
        (-margin[0] - cx) / fx, (camera.width + margin[0] - cx) / fx,
        (-margin[1] - cy) / fy, (camera.height + margin[1] - cy) / fy,
    ])  # fmt: skip
