"""A stand-in for gsplat, for machines without a GPU: its CUDA kernels in PyTorch, and a thin module of its functions.

The kernels have the names, arguments and shapes of those that gsplat 1.5.3 compiles, so that its own Python layer runs
on them too, and what is peculiar to a GPU: culled entries stay unwritten, the backward pass starts from an alpha that
was rounded, and what the warps of a tile find is added up in an order that changes from call to call.
"""

import math
import sys
from contextlib import contextmanager
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scenes import gaussian

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.rendering.gsplat_cuda import GsplatRenderer
from gaussian_trimmer.rendering.reference import sh_basis

torch = pytest.importorskip("torch", reason="needs PyTorch: the cuda extra")

WARP = 32
CUT_OFF, STOP = 1 / 255, 1e-4


class Kernels:
    """`gsplat.cuda._backend._C`. `alpha_cap` is 0.999 as in 1.5.3, or 0.99 as in 1.6."""

    CameraModelType, PINHOLE = SimpleNamespace(), 0

    def __init__(self, alpha_cap):
        self.alpha_cap = alpha_cap
        self._rng = np.random.default_rng(0)

    def projection_ewa_3dgs_fused_fwd(
        self, means, covars, quats, scales, opacities, viewmats, Ks, width, height, eps2d, near_plane, far_plane,
        radius_clip, calc_compensations, camera_model,
    ):  # fmt: skip
        n = len(means)
        assert covars is None and radius_clip == 0 and not calc_compensations and camera_model == self.PINHOLE
        assert means.shape == (n, 3) and quats.shape == (n, 4) and scales.shape == (n, 3) and opacities.shape == (n,)
        assert viewmats.shape == (1, 4, 4) and Ks.shape == (1, 3, 3)
        assert all(x.dtype == torch.float32 and x.is_contiguous() for x in (means, quats, scales, opacities, viewmats))
        viewmat, K = viewmats[0], Ks[0]
        q = torch.nn.functional.normalize(quats, dim=1)
        w, xyz = q[:, :1, None], q[:, 1:]
        cross = torch.linalg.cross(xyz[:, None].expand(-1, 3, -1), torch.eye(3)[None].expand(n, -1, -1))
        rotation = torch.eye(3) + 2 * (w * cross + torch.linalg.cross(xyz[:, None].expand(-1, 3, -1), cross))
        half = scales[:, :, None] * rotation @ viewmat[:3, :3].T  # Rows are the axes in the camera, (N, 3, 3).
        local = means @ viewmat[:3, :3].T + viewmat[:3, 3]
        z = local[:, 2].clamp(min=near_plane)
        focal, principal, size = K[[0, 1], [0, 1]], K[:2, 2], torch.tensor([width, height])
        slopes = local[:, :2] / z[:, None]
        margin = 0.15 * size / focal
        clamped = slopes.clamp(-principal / focal - margin, (size - principal) / focal + margin)
        J = torch.zeros(n, 3, 2)
        J[:, 0, 0], J[:, 1, 1] = focal[0] / z, focal[1] / z
        J[:, 2] = -focal * clamped / z[:, None]
        covariance = (half @ J).transpose(1, 2) @ (half @ J) + eps2d * torch.eye(2)
        inverse = torch.linalg.inv(covariance)
        extent = (2 * (opacities / CUT_OFF).clamp(min=1).log()).sqrt()[:, None]
        radii = (extent * covariance.diagonal(dim1=1, dim2=2).sqrt()).ceil().int()
        radii[(local[:, 2] < near_plane) | (local[:, 2] > far_plane) | (opacities < CUT_OFF)] = 0
        conics = torch.stack([inverse[:, 0, 0], inverse[:, 0, 1], inverse[:, 1, 1]], dim=1)
        means2d = slopes * focal + principal
        # The kernel leaves what it culls unwritten; nobody may look at it.
        culled = (radii <= 0).any(1)
        means2d[culled], conics[culled] = math.nan, math.nan
        return radii[None], means2d[None], local[None, :, 2].contiguous(), conics[None], None

    def spherical_harmonics_fwd(self, degree, directions, coefficients, masks):
        assert coefficients.shape[-2] == (degree + 1) ** 2
        unit = torch.nn.functional.normalize(directions.double(), dim=-1)
        basis = torch.from_numpy(sh_basis(unit.reshape(-1, 3).numpy())).float()
        return torch.einsum("cnkd,nk->cnd", coefficients, basis[:, : coefficients.shape[-2]])

    def intersect_tile(
        self, means2d, radii, depths, image_ids, gaussian_ids, n_images, tile, tiles_wide, tiles_high, sort, segmented
    ):
        assert n_images == 1 and sort and not segmented
        order = depths[0].argsort(stable=True)
        order = order[(radii[0, order] > 0).all(1)]
        low, high = means2d[0, order] - radii[0, order], means2d[0, order] + radii[0, order]
        tile_ids, lists = [], []
        for t in range(tiles_high * tiles_wide):
            corner = torch.tensor([t % tiles_wide * tile, t // tiles_wide * tile])
            lists.append(order[((high > corner) & (low < corner + tile)).all(1)])
            tile_ids.append(torch.full_like(lists[-1], t << 32))
        flatten_ids = torch.cat(lists).int()
        return flatten_ids.bincount(minlength=len(depths[0]))[None].int(), torch.cat(tile_ids), flatten_ids

    def intersect_offset(self, isect_ids, n_images, tiles_wide, tiles_high):
        tiles = torch.arange(tiles_high * tiles_wide)
        return torch.searchsorted(isect_ids >> 32, tiles).int().reshape(1, tiles_high, tiles_wide)

    def rasterize_to_pixels_3dgs_fwd(
        self, means2d, conics, colors, opacities, backgrounds, masks, width, height, tile, offsets, flatten_ids
    ):
        channels = colors.shape[-1]
        assert channels in (1, 2, 3, 4, 5, 8, 9, 16, 17, 32) and colors.shape == (1, means2d.shape[1], channels)
        image, light = torch.zeros(height * width, channels), torch.ones(height * width)
        everywhere = torch.ones(1, height, width)
        for pixels, ids, weights, left in self._tiles(
            means2d, conics, opacities, width, height, tile, offsets, flatten_ids, everywhere
        ):
            image[pixels], light[pixels] = weights @ colors[0, ids], left
        if backgrounds is not None:
            assert backgrounds.shape == (1, channels)
            image = image + light[:, None] * backgrounds
        last_ids = torch.zeros(1, height, width, dtype=torch.int32)
        return image.reshape(1, height, width, channels), 1 - light.reshape(1, height, width, 1), last_ids

    def rasterize_to_pixels_3dgs_bwd(
        self, means2d, conics, colors, opacities, backgrounds, masks, width, height, tile, offsets, flatten_ids,
        alphas, last_ids, v_image, v_alphas, absgrad,
    ):  # fmt: skip
        assert v_image.shape == (1, height, width, colors.shape[-1]) and v_alphas.shape == alphas.shape
        found = []
        everywhere = torch.ones(1, height, width)
        for pixels, ids, weights, left in self._tiles(
            means2d, conics, opacities, width, height, tile, offsets, flatten_ids, everywhere
        ):
            rounded = weights * ((1 - alphas.flatten()[pixels]) / left)[:, None]
            warps = (pixels // width % tile * tile + pixels % width % tile) // WARP
            for warp in warps.unique():
                lanes = warps == warp
                found.append((ids, rounded[lanes].T @ v_image.flatten(1, 2)[0, pixels[lanes]]))
        v_colors = torch.zeros_like(colors)
        for i in self._rng.permutation(len(found)):
            v_colors[0, found[i][0]] += found[i][1]
        return None, torch.zeros_like(means2d), torch.zeros_like(conics), v_colors, torch.zeros_like(opacities)

    def _tiles(self, means2d, conics, opacities, width, height, tile, offsets, flatten_ids, transmittances):
        """For each tile its pixels (P,), the rows of its list (G,), weights alpha_i T_i (P, G), the light left (P,)."""
        n = means2d.shape[1]
        assert means2d.shape == (1, n, 2) and conics.shape == (1, n, 3) and opacities.shape == (1, n)
        assert transmittances.shape == (1, height, width)
        assert offsets.shape == (1, math.ceil(height / tile), math.ceil(width / tile))
        starts = [*offsets.flatten().tolist(), len(flatten_ids)]
        for t in range(len(starts) - 1):
            ids = flatten_ids[starts[t] : starts[t + 1]].long()
            if not len(ids):
                continue
            top, left = t // offsets.shape[2] * tile, t % offsets.shape[2] * tile
            y = torch.arange(top, min(top + tile, height)).repeat_interleave(min(tile, width - left))
            x = torch.arange(left, min(left + tile, width)).repeat(min(tile, height - top))
            dx = means2d[0, ids, 0] - (x[:, None] + 0.5)
            dy = means2d[0, ids, 1] - (y[:, None] + 0.5)
            a, b, c = conics[0, ids].unbind(1)
            alphas = opacities[0, ids] * torch.exp(-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy)
            alphas = torch.where(alphas < CUT_OFF, 0, alphas.clamp(max=self.alpha_cap))
            start = transmittances[0, y, x][:, None]
            after = start * (1 - alphas).cumprod(dim=1)
            drawn = ((alphas > 0) & (after <= STOP)).cumsum(dim=1) == 0
            alphas = torch.where(drawn, alphas, 0)
            after = start * (1 - alphas).cumprod(dim=1)
            yield y * width + x, ids, alphas * torch.cat([start, after[:, :-1]], dim=1), after[:, -1]


class StandIn(ModuleType):
    """A module `gsplat` with the functions that the renderer calls, as 1.5.3 documents them.

    With `tiles`, the sizes of tiles that 1.6 is limited to, it has what that version is known by as well.
    """

    def __init__(self, alpha_cap=0.999, tiles=None):
        super().__init__("gsplat")
        self.kernels = Kernels(alpha_cap)
        self.tiles = tiles
        self.calls = []
        if tiles:
            self.rasterize_top_contributing_gaussian_ids = None

    def rasterization(
        self, means, quats, scales, opacities, colors, viewmats, Ks, width, height, near_plane=0.01, far_plane=1e10,
        radius_clip=0.0, eps2d=0.3, sh_degree=None, packed=True, tile_size=16, backgrounds=None, render_mode="RGB",
        sparse_grad=False, absgrad=False, rasterize_mode="classic",
    ):  # fmt: skip
        assert rasterize_mode == "classic" and render_mode == "RGB+ED" and backgrounds is None and not packed
        assert sh_degree is not None and colors.shape == (len(means), (sh_degree + 1) ** 2, 3)
        self.calls.append(means.data_ptr())
        radii, means2d, depths, conics, _ = self.kernels.projection_ewa_3dgs_fused_fwd(
            means, None, quats, scales, opacities, viewmats, Ks, width, height, eps2d, near_plane, far_plane,
            radius_clip, False, self.kernels.PINHOLE,
        )  # fmt: skip
        directions = means - torch.inverse(viewmats)[:, None, :3, 3]
        shown = self.kernels.spherical_harmonics_fwd(sh_degree, directions, colors[None], None) + 0.5
        tiles = math.ceil(width / tile_size), math.ceil(height / tile_size)
        _, isect_ids, flatten_ids = self.kernels.intersect_tile(
            means2d, radii, depths, None, None, 1, tile_size, *tiles, True, False
        )
        info = {
            "means2d": means2d, "conics": conics, "opacities": opacities[None], "depths": depths, "radii": radii,
            "isect_offsets": self.kernels.intersect_offset(isect_ids, 1, *tiles), "flatten_ids": flatten_ids,
            "width": width, "height": height, "tile_size": tile_size,
        }  # fmt: skip
        image, alpha = self.rasterize_to_pixels(
            means2d, conics, torch.cat([shown.clamp(min=0), depths[..., None]], dim=2), opacities[None], width, height,
            tile_size, info["isect_offsets"], flatten_ids,
        )  # fmt: skip
        image[..., 3:] /= alpha.clamp(min=1e-10)
        return image, alpha, info

    def fully_fused_projection(
        self, means, covars, quats, scales, viewmats, Ks, width, height, eps2d=0.3, near_plane=0.01, far_plane=1e10,
        radius_clip=0.0, packed=False, sparse_grad=False, calc_compensations=False, camera_model="pinhole",
        opacities=None,
    ):  # fmt: skip
        assert camera_model == "pinhole" and not packed
        return self.kernels.projection_ewa_3dgs_fused_fwd(
            means, covars, quats, scales, opacities, viewmats, Ks, width, height, eps2d, near_plane, far_plane,
            radius_clip, calc_compensations, self.kernels.PINHOLE,
        )  # fmt: skip

    def rasterize_to_pixels(
        self, means2d, conics, colors, opacities, image_width, image_height, tile_size, isect_offsets, flatten_ids,
        backgrounds=None, masks=None, packed=False, absgrad=False,
    ):  # fmt: skip
        assert not self.tiles or tile_size in self.tiles
        # gsplat pads the channels to a number that its kernels were compiled for.
        channels = colors.shape[-1]
        extra = (1 << (channels - 1).bit_length()) - channels
        colors = torch.nn.functional.pad(colors, (0, extra))
        if backgrounds is not None:
            backgrounds = torch.nn.functional.pad(backgrounds, (0, extra))
        image, alpha = _Rasterisation.apply(
            self.kernels, colors, means2d, conics, opacities, backgrounds, image_width, image_height, tile_size,
            isect_offsets, flatten_ids,
        )  # fmt: skip
        return image[..., :channels], alpha


class _Rasterisation(torch.autograd.Function):
    """The kernels of the forward and the backward pass, joined for colours alone."""

    @staticmethod
    def forward(
        ctx, kernels, colors, means2d, conics, opacities, backgrounds, width, height, tile_size, offsets, flatten_ids
    ):
        ctx.arguments = (
            means2d, conics, colors, opacities, backgrounds, None, width, height, tile_size, offsets, flatten_ids
        )  # fmt: skip
        image, alphas, last_ids = kernels.rasterize_to_pixels_3dgs_fwd(*ctx.arguments)
        ctx.kernels, ctx.results = kernels, (alphas, last_ids)
        return image, alphas

    @staticmethod
    def backward(ctx, v_image, v_alphas):
        results = ctx.kernels.rasterize_to_pixels_3dgs_bwd(*ctx.arguments, *ctx.results, v_image, v_alphas, False)
        return None, results[3], *[None] * 9


@contextmanager
def one_thread():
    """So small tensors lose more to the threads of PyTorch than they gain."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


VERSIONS = {
    "1.5.3": {"alpha_cap": 0.999},
    "1.6": {"alpha_cap": 0.99, "tiles": (4, 16)},
    "1.5.3 kernels": {"alpha_cap": 0.999},
}
"""Two versions of gsplat replaced as a whole, and the installed one with nothing but its kernels replaced."""


def install_version(monkeypatch, name):
    """Make `import gsplat` find a gsplat that runs on a CPU: one of `VERSIONS`."""
    if name != "1.5.3 kernels":
        return install(monkeypatch, StandIn(**VERSIONS[name]))
    gsplat = pytest.importorskip("gsplat", reason="gsplat is not installed")
    if gsplat.__version__ != "1.5.3":
        pytest.skip(f"gsplat is {gsplat.__version__}, and the kernels of the stand-in are those of 1.5.3")
    return install(monkeypatch, gsplat, Kernels(**VERSIONS[name]))


def make_renderer(name, monkeypatch):
    """The renderer on one of `VERSIONS`, or, by the name `gsplat`, on what is installed and on a CUDA device."""
    if name != "gsplat":
        install_version(monkeypatch, name)
        return GsplatRenderer("cpu")
    pytest.importorskip("gsplat", reason="gsplat is not installed")
    if not torch.cuda.is_available():
        pytest.skip("there is no CUDA device for gsplat")
    return GsplatRenderer()


def alpha_cap_of(renderer):
    """The largest alpha of the gsplat in use: what an opaque Gaussian gives the pixel that it is centred on."""
    K = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    return float(renderer.render(gaussian((0, 0, 1), opacity=1 - 1e-7), Camera(np.eye(4), K, 1, 1)).alpha.max())


def install(monkeypatch, gsplat, kernels=()):
    """Make `import gsplat` find a module, and kernels beside it; None for kernels that could not be compiled."""
    backend = ModuleType("gsplat.cuda._backend")
    backend._C = kernels
    monkeypatch.setitem(sys.modules, "gsplat", gsplat)
    monkeypatch.setitem(sys.modules, "gsplat.cuda._backend", backend)
    if not hasattr(gsplat, "cuda"):
        monkeypatch.setitem(sys.modules, "gsplat.cuda", ModuleType("gsplat.cuda"))
    return gsplat
