"""Derivatives of a view by the parameters of its Gaussians, on the CPU: what a fit by gradients needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.compiling import KERNELS
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.rendering import gradient_kernels as kernels
from gaussian_trimmer.rendering.numba_cpu import Projection, blend_view, lens_of, project_view
from gaussian_trimmer.rendering.numba_kernels import TILE


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
        return np.asarray(np.divide(depth, alpha, out=np.zeros_like(depth), where=alpha > 0))

    def blend(self, values: FloatArray) -> FloatArray:
        """Sum over Gaussians of blend weight times values (N, C) at each pixel, (C, H, W)."""
        ordered = np.ascontiguousarray(values[self.projection.rows])
        return blend_view(self.projection, ordered, self.camera)[0][:-1, : self.camera.height, : self.camera.width]

    def weigh(self, images: FloatArray) -> FloatArray:
        """Sum over pixels of each Gaussian's blend weight times each of the images (L, H, W), (N, L)."""
        nothing = np.zeros((len(self.projection.rows), 0), np.float32)
        sums = blend_view(self.projection, nothing, self.camera, images)[1]
        return self.projection.scattered(sums, len(self.gaussians))


def draw(gaussians: Gaussians, camera: Camera) -> Drawing:
    """Draw a view as `NumbaRenderer.render` does, without keeping anything for later calls."""
    projection = project_view(gaussians, camera)
    return Drawing(gaussians, camera, projection, blend_view(projection, projection.colours, camera)[0])


def gradients(drawing: Drawing, slopes: FloatArray, moving: BoolArray) -> FloatArray:
    """Derivatives of a loss by the parameters of Gaussians, (N, 13).

    The columns are: mean in scene units (3), log-scales (3), turn about the Gaussian's own axes in radians (3), opacity
    logit, sh_dc (3). That a colour changes with the direction of view is left out, since fitted Gaussians move by
    fractions of their size.

    Args:
        drawing: the view.
        slopes: derivatives of the loss by colour and alpha of each pixel, (4, H, W).
        moving: which Gaussians are asked for, (N,); the rows of the others are zero.
    """
    camera, gaussians, projection = drawing.camera, drawing.gaussians, drawing.projection
    padded = np.zeros((4, *drawing.padded.shape[1:]), np.float32)
    padded[:, : camera.height, : camera.width] = slopes
    image = np.ascontiguousarray(drawing.padded[[0, 1, 2, 4]])
    down, across = padded.shape[1] // TILE, padded.shape[2] // TILE
    busy = padded.any(axis=0).reshape(down, TILE, across, TILE).any(axis=(1, 3)).ravel()
    moves = moving[projection.rows]
    sums = np.zeros((len(projection.rows), kernels.N_SUMS), np.float32)
    for tiles in projection.parts(camera, kernels.N_SUMS):
        part = busy[tiles.first : tiles.first + len(tiles.starts) - 1]
        with KERNELS:
            pairs = kernels.differentiate_tiles(
                projection.splats, projection.colours, moves, tiles.starts, tiles.lists, tiles.spans, tiles.first,
                camera.width, camera.height, image, padded, part,
            )  # fmt: skip
            kernels.sum_moving_pairs(pairs, tiles.starts, tiles.lists, part, sums)
    chosen = np.flatnonzero(moves)
    rows = projection.rows[chosen]
    derivatives = np.zeros((len(gaussians), kernels.N_PARAMETERS), np.float32)
    lens, limits = lens_of(camera)
    with KERNELS:
        derivatives[rows] = kernels.gather(
            gaussians.means[rows], gaussians.log_scales[rows], gaussians.quaternions[rows],
            gaussians.opacity_logits[rows], np.ascontiguousarray(camera.world_to_camera), lens, limits,
            projection.splats[chosen], projection.colours[chosen], sums[chosen],
        )  # fmt: skip
    return derivatives
