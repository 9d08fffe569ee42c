"""The GPU renderer: gsplat's CUDA kernels behind the `Renderer` contract.

gsplat shares every constant of this package but one: up to version 1.5.3 a Gaussian's alpha is capped at 0.999, not at
0.99, so that what lies right behind an opaque centre shows ten times less.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, TypeVar, cast
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.geometry.limits import LARGEST_LOG_SCALE
from gaussian_trimmer.rendering import (
    LARGEST_SPREAD,
    LARGEST_VALUE,
    LOW_PASS_VARIANCE,
    Rendering,
    check_pairs,
)
from gaussian_trimmer.rendering.gsplat_import import import_gsplat
from gaussian_trimmer.rendering.gsplat_projection import Projection
from gaussian_trimmer.rendering.numba_cpu import NumbaRenderer

Tensor = Any  # torch is imported late, so its types have no name here.
Method = TypeVar("Method", bound=Callable[..., Any])

_CHANNELS_AT_ONCE = 32
_LABELS_AT_ONCE = 8
_TILE, _TILE_OF_1_6 = 8, 4
"""Side of a tile in pixels: warps of 32 threads draw it, two or a part of one, and sums of two terms have no order.
Version 1.6 draws only tiles of 4 or 16 pixels."""
_KEPT_BYTES = 1 << 29
"""Device memory for the projections of one scene that are kept for the next call."""
_COUNTED_FIRST = 1 << 30
"""Pairs of tile and Gaussian from which on they are counted before gsplat lists them, in numbers of 32 bits."""
_WEIGHT_UNIT = 2.0**-30
"""Weights are summed as whole numbers of this, because sums of floats on a GPU change from run to run."""


@dataclass(frozen=True, eq=False)
class _Uploaded:
    """Activated Gaussians on the device, relative to their mean position to spare digits far from the origin."""

    origin: Float64Array
    means: Tensor
    quaternions: Tensor
    scales: Tensor
    opacities: Tensor
    coefficients: Tensor
    """Spherical harmonics, (N, K, 3)."""
    projections: OrderedDict[int, tuple[Camera, Projection]] = field(default_factory=OrderedDict)
    """The last few, by the id of the camera, which stays its own because the camera is kept."""


def _on_device(method: Method) -> Method:
    """Let a method take gradients, since blend weights are gradients, whatever mode the caller is in."""

    @wraps(method)
    def wrapped(self: GsplatRenderer, *arguments: Any, **options: Any) -> Any:
        try:
            with self._torch.inference_mode(False):
                return method(self, *arguments, **options)
        except self._torch.OutOfMemoryError as error:
            raise InputError(
                "The GPU has not enough memory for this view; take smaller views, or render with --renderer numba."
            ) from error

    return cast(Method, wrapped)


class GsplatRenderer:
    """Fulfils the `Renderer` contract on a CUDA device.

    Gaussians are uploaded once and stay as long as they live; so do their projections into the last few cameras.

    Raises:
        InputError: gsplat or PyTorch is missing, there is no CUDA device, or gsplat's kernels cannot be built.
    """

    name = "gsplat"

    def __init__(self, device: str = "cuda") -> None:
        self._torch, self._gsplat = import_gsplat(device)
        self._device = self._torch.device(device)
        is_1_6 = hasattr(self._gsplat, "rasterize_top_contributing_gaussian_ids")
        self._tile = _TILE_OF_1_6 if is_1_6 else _TILE
        self._cpu = NumbaRenderer()
        self._uploaded: WeakKeyDictionary[Gaussians, _Uploaded] = WeakKeyDictionary()

    @_on_device
    def render(
        self, gaussians: Gaussians, camera: Camera, background: FloatArray | None = None, weights: bool = False
    ) -> Rendering:
        """Render colour, alpha and depth, and the Gaussians' blend weights if asked for; see `Renderer.render`."""
        image, alpha = self._blank(camera, 4), self._blank(camera, 1)[..., 0]
        if len(gaussians):
            image, alpha, _ = self._project(gaussians, camera)
        rgb = image[..., :3]
        if background is not None:
            rgb = rgb + (1 - alpha)[..., None] * self._tensor(background)
        everywhere = self._blank(camera, int(weights)) + 1
        shown = self._weights_under(everywhere, gaussians, camera).flatten()
        return Rendering(_array(rgb), _array(alpha), _array(image[..., 3]), _array(shown))

    @_on_device
    def blend_values(self, gaussians: Gaussians, camera: Camera, values: FloatArray) -> FloatArray:
        """Return blend-weighted sums of per-Gaussian values; see `Renderer.blend_values`."""
        if not len(gaussians):
            return _array(self._blank(camera, values.shape[1]))
        projection = self._projection(gaussians, camera)
        parts = self._tensor(values)[None].split(_CHANNELS_AT_ONCE, dim=2)
        images = [self._blend(projection, camera, part.contiguous())[0] for part in parts]
        return _array(self._torch.cat(images, dim=2))

    @_on_device
    def blend_weights(
        self, gaussians: Gaussians, camera: Camera, labels: NDArray[np.uint8], n_labels: int
    ) -> FloatArray:
        """Sum over pixels of alpha_i T_i by label; see `Renderer.blend_weights`. The same in every run."""
        label = self._torch.tensor(labels, device=self._device)[..., None]
        parts = self._torch.arange(n_labels, device=self._device).split(_LABELS_AT_ONCE)
        sums = [self._weights_under((label == part).float(), gaussians, camera) for part in parts]
        return _array(self._torch.cat(sums, dim=1))

    def top_contributors(
        self, gaussians: Gaussians, camera: Camera, pixels: IntArray, k: int
    ) -> tuple[IntArray, FloatArray]:
        """Return the k largest blend weights at each asked pixel, found on the CPU; see `Renderer.top_contributors`."""
        return self._cpu.top_contributors(gaussians, camera, pixels, k)

    def _weights_under(self, images: Tensor, gaussians: Gaussians, camera: Camera) -> Tensor:
        """Sum over pixels alpha_i T_i times the values of images (H, W, L), as (N, L), the same in every run.

        They are the gradient of a blended image by the values that are blended, so gsplat's backward pass gives them at
        the price of a few pictures. Its kernel adds up what the warps of a tile find in any order; with splats apart
        for every tile, and at most two warps to a tile, order does not matter, and tiles are added up as whole numbers.
        """
        sums = self._torch.zeros((len(gaussians), images.shape[2]), dtype=self._torch.int64, device=self._device)
        projection = self._projection(gaussians, camera) if len(gaussians) else None
        if projection is not None and len(projection.tile_lists) and images.shape[2]:
            found = self._gradient(projection.apart(), camera, images)
            sums.index_add_(0, projection.tile_lists.long(), (found.double() / _WEIGHT_UNIT).round().long())
        return (sums.double() * _WEIGHT_UNIT).float()

    def _gradient(self, projection: Projection, camera: Camera, images: Tensor) -> Tensor:
        """Return sums over pixels of alpha_i T_i times the values of images (H, W, L), for each splat, (M, L)."""
        black = projection.means.new_zeros((1, projection.means.shape[1], images.shape[2]), requires_grad=True)
        with self._torch.enable_grad():
            light, alpha = self._blend(projection, camera, black, background=black.new_ones((1, images.shape[2])))
        # Black splats before a white background show the light left, T. The kernel, which goes from back to front,
        # starts from 1 - alpha instead: where T is small, that is rounded by 1e-4 of it, and all weights with it.
        exact = images * light.detach() / (1 - alpha.detach())[..., None]
        return self._torch.autograd.grad(light, black, exact)[0][0]

    def _blend(
        self, projection: Projection, camera: Camera, values: Tensor, background: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Return blended values (1, M, C) before a background (1, C), as (H, W, C), and alpha, (H, W)."""
        image, alpha = self._gsplat.rasterize_to_pixels(
            projection.means,
            projection.conics,
            values,
            projection.opacities,
            camera.width,
            camera.height,
            projection.tile,
            projection.tile_starts,
            projection.tile_lists,
            backgrounds=background,
        )
        return image[0], alpha[0, ..., 0]

    def _projection(self, gaussians: Gaussians, camera: Camera) -> Projection:
        kept = self._upload(gaussians).projections
        if id(camera) not in kept:
            return self._project(gaussians, camera)[2]
        kept.move_to_end(id(camera))
        return kept[id(camera)][1]

    def _project(self, gaussians: Gaussians, camera: Camera) -> tuple[Tensor, Tensor, Projection]:
        """Return colour and mean depth (H, W, 4), alpha (H, W), and the projection of both, which is kept."""
        drawn = self._upload(gaussians)
        world_to_camera = camera.world_to_camera.astype(np.float64)
        world_to_camera[:3, 3] += world_to_camera[:3, :3] @ drawn.origin
        view, K = self._tensor(world_to_camera)[None], self._tensor(camera.K)[None]
        scales = self._shortened(drawn, world_to_camera, camera)
        with self._torch.no_grad():
            self._check_pairs(drawn, scales, view, K, camera)
            # packed=False: the ids of packed splats would not be rows of the scene.
            image, alpha, info = self._gsplat.rasterization(
                drawn.means,
                drawn.quaternions,
                scales,
                drawn.opacities,
                drawn.coefficients,
                view,
                K,
                camera.width,
                camera.height,
                sh_degree=gaussians.sh_degree,
                render_mode="RGB+ED",
                near_plane=camera.near,
                far_plane=LARGEST_VALUE,
                eps2d=LOW_PASS_VARIANCE,
                rasterize_mode="classic",
                packed=False,
                tile_size=self._tile,
            )
        names = ("means2d", "conics", "opacities", "isect_offsets", "flatten_ids")
        projection = Projection(self._tile, *(info[name] for name in names))
        drawn.projections[id(camera)] = camera, projection
        while len(drawn.projections) > 1 and sum(p.nbytes for _, p in drawn.projections.values()) > _KEPT_BYTES:
            drawn.projections.popitem(last=False)
        return image[0], alpha[0, ..., 0], projection

    def _shortened(self, drawn: _Uploaded, world_to_camera: Float64Array, camera: Camera) -> Tensor:
        """Return scales (N, 3), none of which shows longer than `LARGEST_SPREAD`: gsplat squares single precision."""
        forward = self._tensor(world_to_camera[2])
        depths = (drawn.means @ forward[:3] + forward[3]).clamp(min=camera.near)
        limit = depths * (LARGEST_SPREAD / float(max(camera.K[0, 0], camera.K[1, 1])))
        return self._torch.minimum(drawn.scales, limit[:, None])

    def _check_pairs(self, drawn: _Uploaded, scales: Tensor, view: Tensor, K: Tensor, camera: Camera) -> None:
        """Refuse a view of more than `rendering.MOST_PAIRS` pairs of tile and Gaussian, where there may be so many."""
        tiles = self._torch.tensor(
            [-(-camera.width // self._tile), -(-camera.height // self._tile)], device=self._device
        )
        if len(drawn.means) * int(tiles.prod()) <= _COUNTED_FIRST:
            return
        radii, centres = self._gsplat.fully_fused_projection(
            drawn.means,
            None,
            drawn.quaternions,
            scales,
            view,
            K,
            camera.width,
            camera.height,
            eps2d=LOW_PASS_VARIANCE,
            near_plane=camera.near,
            far_plane=LARGEST_VALUE,
            opacities=drawn.opacities,
        )[:2]
        shown = (radii > 0).all(dim=-1)
        radii, centres = radii[shown].double(), centres[shown].double()
        low = ((centres - radii) / self._tile).floor().clamp(min=0)
        high = ((centres + radii) / self._tile).ceil().minimum(tiles.double())
        check_pairs(int((high - low).clamp(min=0).prod(dim=1).sum()), camera)

    def _upload(self, gaussians: Gaussians) -> _Uploaded:
        if gaussians not in self._uploaded:
            origin = gaussians.means.mean(axis=0, dtype=np.float64)
            constant, rest = self._tensor(gaussians.sh_dc), self._tensor(gaussians.sh_rest)
            self._uploaded[gaussians] = _Uploaded(
                origin,
                self._tensor(gaussians.means - origin),
                self._tensor(gaussians.quaternions),
                self._tensor(gaussians.log_scales).clamp(max=LARGEST_LOG_SCALE).exp(),
                self._tensor(gaussians.opacity_logits).sigmoid(),
                self._torch.cat([constant[:, None], rest.transpose(1, 2)], dim=1),
            )
        return self._uploaded[gaussians]

    def _tensor(self, values: NDArray[Any]) -> Tensor:
        """Return a copy of an array on the device, in float32."""
        return self._torch.tensor(values, dtype=self._torch.float32, device=self._device)

    def _blank(self, camera: Camera, n_channels: int) -> Tensor:
        return self._torch.zeros((camera.height, camera.width, n_channels), device=self._device)


def _array(tensor: Tensor) -> NDArray[Any]:
    return cast(NDArray[Any], tensor.detach().contiguous().cpu().numpy())
