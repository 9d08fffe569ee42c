"""The largest contributors of a few pixels, from what gsplat 1.5.3 and 1.6 offer for it.

Version 1.6 has a kernel that lists the largest of every pixel. With 1.5.3, all Gaussians that blend into the asked
pixels are listed, and the arithmetic of the kernels is repeated for these pairs.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Any

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.rendering.gsplat_projection import Projection

Tensor = Any  # torch is imported late, so its types have no name here.

_TO_THE_LAST = 1 << 30
_PAIRS_AT_ONCE = 1 << 25
"""Upper bound on the pairs of pixel and Gaussian listed at a time; 64 bytes each."""


def top_by_kernel(gsplat: Any, projection: Projection, camera: Camera, pixels: Tensor, k: int) -> tuple[Tensor, Tensor]:
    """The k largest blend weights at pixels, given by their flat numbers (P,): splats (P, k) and weights (P, k)."""
    ids, weights = gsplat.rasterize_top_contributing_gaussian_ids(
        projection.means,
        projection.conics,
        projection.opacities,
        projection.tile_starts,
        projection.tile_lists,
        camera.width,
        camera.height,
        projection.tile,
        k,
    )
    # The kernel lists them from near to far.
    return _largest_first(ids.reshape(-1, k)[pixels].long(), weights.reshape(-1, k)[pixels], k)


def top_by_pairs(
    gsplat: Any, projection: Projection, camera: Camera, pixels: Tensor, k: int, alpha_cap: float
) -> tuple[Tensor, Tensor]:
    """The same as `top_by_kernel`, without that kernel; `alpha_cap` is that of the installed version."""
    distinct, place = pixels.unique(return_inverse=True)
    ids, weights = distinct.new_full((len(distinct), k), -1), projection.means.new_zeros((len(distinct), k))
    for part in _parts(projection, camera, distinct):
        found, part_ids, part_weights = _contributions(gsplat, projection, camera, part, alpha_cap)
        part_ids, part_weights = _largest_first(part_ids, part_weights, k)
        rows = import_module("torch").searchsorted(distinct, found)
        ids[rows, : part_ids.shape[1]], weights[rows, : part_ids.shape[1]] = part_ids, part_weights
    return ids[place], weights[place]


def _parts(projection: Projection, camera: Camera, pixels: Tensor) -> Iterator[Tensor]:
    """Pixels (P,) in parts whose pairs with the splats of their tiles fit into memory."""
    y, x = pixels // camera.width, pixels % camera.width
    tiles = y // projection.tile * projection.tile_starts.shape[2] + x // projection.tile
    pairs = projection.list_lengths()[tiles].cumsum(0)
    _, counts = (pairs // _PAIRS_AT_ONCE).unique_consecutive(return_counts=True)
    yield from pixels.split(counts.tolist())


def _contributions(
    gsplat: Any, projection: Projection, camera: Camera, pixels: Tensor, alpha_cap: float
) -> tuple[Tensor, Tensor, Tensor]:
    """What blends into pixels, given by their flat numbers.

    Flat numbers of those pixels that anything blends into (P,), their splats from near to far (P, R), padded with -1,
    and the weights alpha_i T_i (P, R), zero where padded.
    """
    # A pixel that lets no light through is finished before its first Gaussian: gsplat skips it.
    light = projection.means.new_zeros((1, camera.height, camera.width))
    light.view(-1)[pixels] = 1
    ids, flat, _ = gsplat.rasterize_to_indices_in_range(
        0,
        _TO_THE_LAST,
        light,
        projection.means,
        projection.conics,
        projection.opacities,
        camera.width,
        camera.height,
        projection.tile,
        projection.tile_starts,
        projection.tile_lists,
    )
    ids, flat = ids.long(), flat.long()
    mean_x, mean_y = projection.means[0, ids].unbind(1)
    dx, dy = flat % camera.width + 0.5 - mean_x, flat // camera.width + 0.5 - mean_y
    a, b, c = projection.conics[0, ids].unbind(1)
    power = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
    alphas = (projection.opacities[0, ids] * (-power).exp()).clamp(max=alpha_cap)
    # The pairs come pixel after pixel: those of a pixel become a row of the tables.
    distinct, row, counts = flat.unique_consecutive(return_inverse=True, return_counts=True)
    column = (row >= 0).cumsum(0) - 1 - (counts.cumsum(0) - counts)[row]
    shape = (len(distinct), int(counts.max()) if len(counts) else 0)
    id_table, alpha_table = ids.new_full(shape, -1), alphas.new_zeros(shape)
    id_table[row, column], alpha_table[row, column] = ids, alphas
    past = 1 - alpha_table
    return distinct, id_table, alpha_table * past.cumprod(dim=1) / past


def _largest_first(ids: Tensor, weights: Tensor, k: int) -> tuple[Tensor, Tensor]:
    """The k largest of the weights (P, R) in falling order, the nearer first where equal, with their ids."""
    weights, order = weights.sort(dim=1, descending=True, stable=True)
    return ids.gather(1, order)[:, :k], weights[:, :k]
