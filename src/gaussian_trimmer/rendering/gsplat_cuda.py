"""The GPU renderer: gsplat's CUDA kernels behind the `Renderer` contract.

gsplat shares every constant of this package but one: up to version 1.5.3 a Gaussian's alpha is capped at 0.999, not at
0.99, so that what lies right behind an opaque centre shows ten times less. The cap of the installed version is
measured and used where this file repeats the kernels' arithmetic.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from importlib.util import find_spec
from typing import Any, cast
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.rendering import LOW_PASS_VARIANCE, Rendering, pixels_inside

Tensor = Any  # torch is imported late, so its types have no name here.

_INSTALL = 'run: pip install "gaussian-trimmer[cuda]", or render with --renderer numba.'
_TO_THE_LAST = 1 << 30
_PAIRS_AT_ONCE = 1 << 25
"""Upper bound on the pairs of pixel and Gaussian held at a time, unless one row of tiles has more; 64 bytes each."""
_WEIGHT_UNIT = 2.0**-30
"""Weights are summed as whole numbers of this, because sums of floats on a GPU change from run to run."""


def is_available() -> bool:
    """Whether gsplat is installed and there is a CUDA device for it. Does not compile or load its kernels."""
    if find_spec("gsplat") is None or find_spec("torch") is None:
        return False
    return bool(import_module("torch").cuda.is_available())


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


class GsplatRenderer:
    """Fulfils the `Renderer` contract on a CUDA device. Gaussians are uploaded once and stay as long as they live.

    Raises:
        InputError: gsplat or PyTorch is missing, there is no CUDA device, or gsplat's kernels cannot be built.
    """

    name = "gsplat"

    def __init__(self, device: str = "cuda") -> None:
        self._torch, self._gsplat = _import_libraries(device)
        self._device = self._torch.device(device)
        self._uploaded: WeakKeyDictionary[Gaussians, _Uploaded] = WeakKeyDictionary()

    def render(
        self, gaussians: Gaussians, camera: Camera, background: FloatArray | None = None, weights: bool = False
    ) -> Rendering:
        """Colour, alpha and depth of a view; see `Renderer.render`."""
        image, alpha, _ = self._rasterise(gaussians, camera)
        rgb = image[..., :3]
        if background is not None:
            rgb = rgb + (1 - alpha)[..., None] * self._tensor(background)
        everywhere = np.zeros((camera.height, camera.width), np.uint8)
        sums = self.blend_weights(gaussians, camera, everywhere, 1)[:, 0] if weights else np.zeros(0, np.float32)
        return Rendering(_array(rgb), _array(alpha), _array(image[..., 3]), sums)

    def blend_values(self, gaussians: Gaussians, camera: Camera, values: FloatArray) -> FloatArray:
        """Blend-weighted sums of per-Gaussian values; see `Renderer.blend_values`."""
        return _array(self._rasterise(gaussians, camera, self._tensor(values))[0])

    def blend_weights(
        self, gaussians: Gaussians, camera: Camera, labels: NDArray[np.uint8], n_labels: int
    ) -> FloatArray:
        """Sum over pixels of alpha_i T_i by label; see `Renderer.blend_weights`. The same in every run."""
        label = self._torch.from_numpy(np.array(labels, np.int64)).to(self._device)
        sums = self._torch.zeros(len(gaussians) * n_labels, dtype=self._torch.int64, device=self._device)
        for pixels, ids, weights in self._contributions(gaussians, camera, label < n_labels):
            place = ids * n_labels + label.flatten()[pixels][:, None]
            units = (weights.double() / _WEIGHT_UNIT).round().long()
            sums.index_add_(0, place[ids >= 0], units[ids >= 0])
        return _array((sums.double() * _WEIGHT_UNIT).float().reshape(len(gaussians), n_labels))

    def top_contributors(
        self, gaussians: Gaussians, camera: Camera, pixels: IntArray, k: int
    ) -> tuple[IntArray, FloatArray]:
        """The k largest blend weights at each asked pixel; see `Renderer.top_contributors`."""
        pixels = pixels_inside(pixels, camera)
        asked = self._torch.from_numpy(pixels[:, 1] * camera.width + pixels[:, 0]).to(self._device)
        if hasattr(self._gsplat, "rasterize_top_contributing_gaussian_ids"):
            ids, weights = self._top_by_kernel(gaussians, camera, asked, k)
        else:
            ids, weights = self._top_by_pairs(gaussians, camera, asked, k)
        return _array(self._torch.where(weights > 0, ids.long(), -1)), _array(weights)

    def _top_by_kernel(self, gaussians: Gaussians, camera: Camera, asked: Tensor, k: int) -> tuple[Tensor, Tensor]:
        """The kernel of gsplat 1.6, which lists the k largest of every pixel from near to far."""
        info = self._rasterise(gaussians, camera)[2]
        if not info:
            return self._no_contributors(len(asked), k)
        ids, weights = self._gsplat.rasterize_top_contributing_gaussian_ids(
            info["means2d"], info["conics"], info["opacities"], info["isect_offsets"], info["flatten_ids"],
            camera.width, camera.height, info["tile_size"], k,
        )  # fmt: skip
        return _largest_first(ids.reshape(-1, k)[asked], weights.reshape(-1, k)[asked], k)

    def _top_by_pairs(self, gaussians: Gaussians, camera: Camera, asked: Tensor, k: int) -> tuple[Tensor, Tensor]:
        distinct, place = asked.unique(return_inverse=True)
        wanted = self._torch.zeros(camera.height * camera.width, dtype=self._torch.bool, device=self._device)
        wanted[distinct] = True
        top_ids, top_weights = self._no_contributors(len(distinct), k)
        for pixels, ids, weights in self._contributions(gaussians, camera, wanted.reshape(camera.height, camera.width)):
            ids, weights = _largest_first(ids, weights, k)
            rows = self._torch.searchsorted(distinct, pixels)
            top_ids[rows, : ids.shape[1]], top_weights[rows, : ids.shape[1]] = ids, weights
        return top_ids[place], top_weights[place]

    def _no_contributors(self, n_pixels: int, k: int) -> tuple[Tensor, Tensor]:
        ids = self._torch.full((n_pixels, k), -1, dtype=self._torch.int64, device=self._device)
        return ids, self._torch.zeros((n_pixels, k), device=self._device)

    def _contributions(
        self, gaussians: Gaussians, camera: Camera, wanted: Tensor
    ) -> Iterator[tuple[Tensor, Tensor, Tensor]]:
        """What blends into the wanted pixels (H, W), band after band of the image.

        Yields flat numbers of pixels (P,), the rows of their Gaussians from near to far (P, R), padded with -1, and
        the weights alpha_i T_i (P, R), zero where padded.
        """
        info = self._rasterise(gaussians, camera)[2]
        if not info or not len(info["flatten_ids"]):
            return
        band = self._rows_at_once(info, camera)
        for first in range(0, camera.height, band):
            # A pixel that lets no light through is finished before its first Gaussian: gsplat skips it.
            transmittance = self._torch.zeros((1, camera.height, camera.width), device=self._device)
            transmittance[0, first : first + band] = wanted[first : first + band].float()
            ids, pixels, _ = self._gsplat.rasterize_to_indices_in_range(
                0, _TO_THE_LAST, transmittance, info["means2d"], info["conics"], info["opacities"],
                camera.width, camera.height, info["tile_size"], info["isect_offsets"], info["flatten_ids"],
            )  # fmt: skip
            if len(ids):
                yield self._blend_pairs(info, camera, ids.long(), pixels.long())

    def _rows_at_once(self, info: dict[str, Any], camera: Camera) -> int:
        """Height in pixels of a band whose pairs fit into memory, a multiple of the tile size."""
        tile = int(info["tile_size"])
        starts = info["isect_offsets"].flatten().long()
        ends = self._torch.cat([starts[1:], starts.new_tensor([len(info["flatten_ids"])])])
        pairs_of_a_row = int((ends - starts).max()) * tile * camera.width
        return max(1, _PAIRS_AT_ONCE // pairs_of_a_row) * tile

    def _blend_pairs(
        self, info: dict[str, Any], camera: Camera, ids: Tensor, pixels: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Weights of (Gaussian, pixel) pairs (M,), which come pixel after pixel and from near to far within each."""
        centres = self._torch.stack([pixels % camera.width, pixels // camera.width], dim=1) + 0.5
        dx, dy = (centres - info["means2d"][0, ids]).unbind(1)
        a, b, c = info["conics"][0, ids].unbind(1)
        power = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
        alphas = (info["opacities"][0, ids] * (-power).exp()).clamp(max=self._alpha_cap)

        distinct, row, counts = pixels.unique_consecutive(return_inverse=True, return_counts=True)
        column = self._torch.arange(len(pixels), device=self._device) - (counts.cumsum(0) - counts)[row]
        table = (len(distinct), int(counts.max()))
        id_table = ids.new_full(table, -1)
        id_table[row, column] = ids
        alpha_table = alphas.new_zeros(table)
        alpha_table[row, column] = alphas
        behind = (1 - alpha_table).cumprod(dim=1)
        before = self._torch.cat([self._torch.ones_like(behind[:, :1]), behind[:, :-1]], dim=1)
        return distinct, id_table, alpha_table * before

    def _rasterise(
        self, gaussians: Gaussians, camera: Camera, values: Tensor | None = None
    ) -> tuple[Tensor, Tensor, dict[str, Any]]:
        """Blended values (H, W, C), alpha (H, W), and gsplat's own account of the view, empty without Gaussians.

        Without values, colours and mean depth are blended, C = 4.
        """
        shape = (camera.height, camera.width)
        if not len(gaussians):
            channels = 4 if values is None else values.shape[1]
            return self._tensor(np.zeros((*shape, channels))), self._tensor(np.zeros(shape)), {}
        drawn = self._upload(gaussians)
        world_to_camera = camera.world_to_camera.astype(np.float64)
        world_to_camera[:3, 3] += world_to_camera[:3, :3] @ drawn.origin
        with self._torch.no_grad():
            # packed=False: the ids of packed splats would not be rows of the scene.
            image, alpha, info = self._gsplat.rasterization(
                drawn.means, drawn.quaternions, drawn.scales, drawn.opacities,
                drawn.coefficients if values is None else values,
                self._tensor(world_to_camera)[None], self._tensor(camera.K)[None], camera.width, camera.height,
                sh_degree=gaussians.sh_degree if values is None else None,
                render_mode="RGB+ED" if values is None else "RGB",
                near_plane=camera.near, eps2d=LOW_PASS_VARIANCE, rasterize_mode="classic", packed=False,
            )  # fmt: skip
        return image[0], alpha[0, ..., 0], info

    def _upload(self, gaussians: Gaussians) -> _Uploaded:
        if gaussians not in self._uploaded:
            origin = gaussians.means.mean(axis=0, dtype=np.float64)
            coefficients = np.concatenate([gaussians.sh_dc[:, :, None], gaussians.sh_rest], axis=2)
            self._uploaded[gaussians] = _Uploaded(
                origin,
                self._tensor(gaussians.means - origin),
                self._tensor(gaussians.quaternions),
                self._tensor(gaussians.log_scales).exp(),
                self._tensor(gaussians.opacity_logits).sigmoid(),
                self._tensor(coefficients.transpose(0, 2, 1)),
            )
        return self._uploaded[gaussians]

    def _tensor(self, values: NDArray[Any]) -> Tensor:
        """A copy of an array on the device, in float32."""
        return self._torch.from_numpy(np.array(values, np.float32, order="C")).to(self._device)

    @cached_property
    def _alpha_cap(self) -> float:
        """Largest alpha of the installed gsplat: what an opaque Gaussian gives the pixel that it is centred on."""
        ahead, unturned = np.array([[0, 0, 1]], np.float32), np.array([[1, 0, 0, 0]], np.float32)
        zeros, no_rest = np.zeros((1, 3), np.float32), np.zeros((1, 3, 0), np.float32)
        opaque = Gaussians(ahead, zeros, unturned, np.array([100], np.float32), zeros, no_rest)
        K = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
        return float(self._rasterise(opaque, Camera(np.eye(4), K, 1, 1))[1].max())


def _largest_first(ids: Tensor, weights: Tensor, k: int) -> tuple[Tensor, Tensor]:
    """The k largest of the weights (P, R) in falling order, the nearer first where equal, with their ids."""
    weights, order = weights.sort(dim=1, descending=True, stable=True)
    return ids.gather(1, order)[:, :k], weights[:, :k]


def _array(tensor: Tensor) -> NDArray[Any]:
    return cast(NDArray[Any], tensor.contiguous().cpu().numpy())


def _import_libraries(device: str) -> tuple[Any, Any]:
    """The modules torch and gsplat, with the kernels of gsplat loaded; compiles them if this was never done."""
    try:
        torch, gsplat = import_module("torch"), import_module("gsplat")
    except ImportError as error:
        raise InputError(f"The gsplat renderer needs PyTorch and gsplat ({error}); {_INSTALL}") from error
    if device.startswith("cuda") and not torch.cuda.is_available():
        raise InputError(
            "The gsplat renderer needs a CUDA device, and PyTorch finds none here; render with --renderer numba."
        )
    try:
        kernels = import_module("gsplat.cuda._backend")._C
    except (ImportError, OSError, RuntimeError) as error:
        raise InputError(_no_kernels(str(error).strip().partition("\n")[0])) from error
    if kernels is None:
        raise InputError(_no_kernels("there is no CUDA toolkit"))
    return torch, gsplat


def _no_kernels(reason: str) -> str:
    return (
        f"gsplat cannot compile its CUDA kernels ({reason}); install the CUDA toolkit that PyTorch was built for, "
        "or a wheel of gsplat with compiled kernels, or render with --renderer numba."
    )
