"""The gsplat renderer: everything around the kernels on a stand-in for gsplat, and parity where there is a GPU.

The stand-in follows the signatures, shapes and semantics that gsplat 1.5.3 documents, in plain torch for tiny scenes.
"""

import gc
import inspect
import math
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scenes import front_camera, gaussian, random_scene

torch = pytest.importorskip("torch", reason="needs PyTorch: the cuda extra")

from gaussian_trimmer.cameras import Camera  # noqa: E402
from gaussian_trimmer.errors import InputError  # noqa: E402
from gaussian_trimmer.gaussians import concatenate  # noqa: E402
from gaussian_trimmer.rendering import gsplat_cuda  # noqa: E402
from gaussian_trimmer.rendering.gsplat_cuda import GsplatRenderer  # noqa: E402
from gaussian_trimmer.rendering.reference import ReferenceRenderer, sh_basis  # noqa: E402

TILE = 16
# float32 against float64; where that tips an alpha over the cut-off or a transmittance over the stop, a pixel may
# change by 0.01: allowed to one in a thousand.
TOLERANCE = 1e-4
LARGEST_FLIP = 0.01
SHARE_OF_FLIPS = 0.001


class StandIn(ModuleType):
    """A module `gsplat` in torch on the CPU. `alpha_cap` is 0.999 as in 1.5.3, or 0.99 as in 1.6."""

    def __init__(self, alpha_cap=0.999, with_top_kernel=False):
        super().__init__("gsplat")
        self.alpha_cap = alpha_cap
        self.calls = []
        if with_top_kernel:
            self.rasterize_top_contributing_gaussian_ids = self._top

    def rasterization(
        self, means, quats, scales, opacities, colors, viewmats, Ks, width, height, near_plane=0.01, far_plane=1e10,
        radius_clip=0.0, eps2d=0.3, sh_degree=None, packed=True, tile_size=TILE, backgrounds=None, render_mode="RGB",
        sparse_grad=False, absgrad=False, rasterize_mode="classic",
    ):  # fmt: skip
        n = len(means)
        assert means.shape == (n, 3) and quats.shape == (n, 4) and scales.shape == (n, 3) and opacities.shape == (n,)
        assert viewmats.shape == (1, 4, 4) and Ks.shape == (1, 3, 3)
        assert all(x.dtype == torch.float32 and x.is_contiguous() for x in (means, quats, scales, opacities, colors))
        assert rasterize_mode == "classic" and backgrounds is None and not packed
        assert render_mode == ("RGB" if sh_degree is None else "RGB+ED")
        self.calls.append(means.data_ptr())
        means2d, conics, depths, radii = self._project(
            means, quats, scales, opacities, viewmats[0], Ks[0], width, height, eps2d, near_plane
        )
        if sh_degree is not None:
            assert colors.shape == (n, (sh_degree + 1) ** 2, 3)
            directions = means.double() + viewmats[0, :3, :3].T.double() @ viewmats[0, :3, 3].double()
            basis = torch.from_numpy(sh_basis(torch.nn.functional.normalize(directions, dim=1).numpy())).float()
            colors = (torch.einsum("nkc,nk->nc", colors, basis[:, : colors.shape[1]]) + 0.5).clamp(min=0)
            colors = torch.cat([colors, depths[:, None]], dim=1)
        offsets, flatten_ids = self._tiles(means2d, radii, depths, width, height, tile_size)
        info = {
            "means2d": means2d[None], "conics": conics[None], "opacities": opacities[None], "depths": depths[None],
            "radii": radii[None], "gaussian_ids": None, "camera_ids": None, "width": width, "height": height,
            "tile_size": tile_size, "isect_offsets": offsets, "flatten_ids": flatten_ids,
        }  # fmt: skip
        image = torch.zeros(height * width, colors.shape[1])
        alpha = torch.zeros(height * width, 1)
        for pixel, ids, weights in self._blend(info, torch.ones(height * width)):
            image[pixel] = weights @ colors[ids]
            alpha[pixel] = weights.sum()
        if sh_degree is not None:
            image[:, -1:] /= alpha.clamp(min=1e-10)
        return image.reshape(1, height, width, -1), alpha.reshape(1, height, width, 1), info

    def rasterize_to_indices_in_range(
        self, range_start, range_end, transmittances, means2d, conics, opacities, image_width, image_height, tile_size,
        isect_offsets, flatten_ids,
    ):  # fmt: skip
        n = means2d.shape[1]
        assert (range_start, range_end) == (0, 1 << 30)
        assert transmittances.shape == (1, image_height, image_width)
        assert means2d.shape == (1, n, 2) and conics.shape == (1, n, 3) and opacities.shape == (1, n)
        info = {
            "means2d": means2d, "conics": conics, "opacities": opacities, "width": image_width, "height": image_height,
            "tile_size": tile_size, "isect_offsets": isect_offsets, "flatten_ids": flatten_ids,
        }  # fmt: skip
        blended = list(self._blend(info, transmittances.flatten()))
        ids = torch.cat([torch.zeros(0, dtype=torch.int64), *(ids for _, ids, _ in blended)])
        pixels = torch.tensor([pixel for pixel, ids, _ in blended for _ in ids], dtype=torch.int64)
        return ids, pixels, torch.zeros_like(pixels)

    def _top(
        self, means2d, conics, opacities, tile_offsets, flatten_ids, image_width, image_height, tile_size,
        num_depth_samples,
    ):  # fmt: skip
        """Of every pixel the largest weights, from near to far, padded with -1 and 0."""
        info = {
            "means2d": means2d, "conics": conics, "opacities": opacities, "width": image_width, "height": image_height,
            "tile_size": tile_size, "isect_offsets": tile_offsets, "flatten_ids": flatten_ids,
        }  # fmt: skip
        top_ids = torch.full((image_height * image_width, num_depth_samples), -1, dtype=torch.int32)
        top_weights = torch.zeros(image_height * image_width, num_depth_samples)
        for pixel, ids, weights in self._blend(info, torch.ones(image_height * image_width)):
            kept = weights.sort(descending=True, stable=True).indices[:num_depth_samples].sort().values
            top_ids[pixel, : len(kept)], top_weights[pixel, : len(kept)] = ids[kept].int(), weights[kept]
        shape = (1, image_height, image_width, num_depth_samples)
        return top_ids.reshape(shape), top_weights.reshape(shape)

    def _project(self, means, quats, scales, opacities, viewmat, K, width, height, eps2d, near_plane):
        q = torch.nn.functional.normalize(quats, dim=1)
        w, xyz = q[:, :1, None], q[:, 1:]
        cross = torch.linalg.cross(xyz[:, None].expand(-1, 3, -1), torch.eye(3)[None].expand(len(q), -1, -1))
        rotation = torch.eye(3) + 2 * (w * cross + torch.linalg.cross(xyz[:, None].expand(-1, 3, -1), cross))
        half = scales[:, :, None] * rotation @ viewmat[:3, :3].T  # Rows are the axes in the camera, (N, 3, 3).
        local = means @ viewmat[:3, :3].T + viewmat[:3, 3]
        z = local[:, 2].clamp(min=near_plane)
        focal, principal, size = K[[0, 1], [0, 1]], K[:2, 2], torch.tensor([width, height])
        slopes = local[:, :2] / z[:, None]
        margin = 0.15 * size / focal
        clamped = slopes.clamp(-principal / focal - margin, (size - principal) / focal + margin)
        J = torch.zeros(len(means), 3, 2)
        J[:, 0, 0], J[:, 1, 1] = focal[0] / z, focal[1] / z
        J[:, 2] = -focal * clamped / z[:, None]
        covariance = (half @ J).transpose(1, 2) @ (half @ J) + eps2d * torch.eye(2)
        inverse = torch.linalg.inv(covariance)
        extent = (2 * (opacities * 255).clamp(min=1).log()).sqrt()[:, None]
        radii = (extent * covariance.diagonal(dim1=1, dim2=2).sqrt()).ceil().int()
        radii[(local[:, 2] < near_plane) | (opacities < 1 / 255)] = 0
        conics = torch.stack([inverse[:, 0, 0], inverse[:, 0, 1], inverse[:, 1, 1]], dim=1)
        culled = (radii <= 0).any(1)
        means2d = slopes * focal + principal
        # The kernel leaves what it culls unwritten; nobody may look at it.
        means2d[culled], conics[culled] = math.nan, math.nan
        return means2d, conics, local[:, 2], radii

    def _tiles(self, means2d, radii, depths, width, height, tile_size):
        order = depths.argsort(stable=True)
        order = order[(radii[order] > 0).all(1)]
        lists = []
        for y in range(0, height, tile_size):
            for x in range(0, width, tile_size):
                corner = torch.tensor([x, y])
                low, high = means2d[order] - radii[order], means2d[order] + radii[order]
                lists.append(order[((high > corner) & (low < corner + tile_size)).all(1)])
        lengths = torch.tensor([0, *(len(ids) for ids in lists)]).cumsum(0)[:-1]
        tiles = (1, math.ceil(height / tile_size), math.ceil(width / tile_size))
        return lengths.int().reshape(tiles), torch.cat(lists).int()

    def _blend(self, info, transmittances):
        """Pixel, its Gaussians from near to far, their weights; pixels in row-major order."""
        tile, width, height = info["tile_size"], info["width"], info["height"]
        starts = [*info["isect_offsets"].flatten().tolist(), len(info["flatten_ids"])]
        for pixel in range(width * height):
            y, x = divmod(pixel, width)
            t = (y // tile) * math.ceil(width / tile) + x // tile
            ids = info["flatten_ids"][starts[t] : starts[t + 1]].long()
            dx, dy = (info["means2d"][0, ids] - torch.tensor([x + 0.5, y + 0.5])).unbind(1)
            a, b, c = info["conics"][0, ids].unbind(1)
            alphas = info["opacities"][0, ids] * torch.exp(-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy)
            alphas = alphas.clamp(max=self.alpha_cap)
            ids, alphas = ids[alphas >= 1 / 255], alphas[alphas >= 1 / 255]
            after = transmittances[pixel] * (1 - alphas).cumprod(0)
            drawn = int((after > 1e-4).long().cumprod(0).sum())
            if drawn:
                before = torch.cat([transmittances[pixel : pixel + 1], after[: drawn - 1]])
                yield pixel, ids[:drawn], alphas[:drawn] * before


def install(monkeypatch, module, kernels=True):
    backend = ModuleType("gsplat.cuda._backend")
    backend._C = SimpleNamespace() if kernels else None
    monkeypatch.setitem(sys.modules, "gsplat", module)
    monkeypatch.setitem(sys.modules, "gsplat.cuda", ModuleType("gsplat.cuda"))
    monkeypatch.setitem(sys.modules, "gsplat.cuda._backend", backend)
    return module


@pytest.fixture(params=["1.5.3", "1.6"])
def stand_in(request, monkeypatch):
    newer = request.param == "1.6"
    return install(monkeypatch, StandIn(alpha_cap=0.99 if newer else 0.999, with_top_kernel=newer))


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def scene_below_the_caps(seed=0, n=80, sh_degree=2):
    """Opacities up to 0.98, where the caps of no version matter."""
    scene = random_scene(seed, n, sh_degree)
    return scene.replace(opacity_logits=np.minimum(scene.opacity_logits, np.float32(np.log(0.98 / 0.02))))


CAMERA = front_camera(37, 26)
REFERENCE = ReferenceRenderer()


def assert_close(actual, expected, scale=1.0):
    assert actual.shape == expected.shape and actual.dtype == expected.dtype
    difference = np.abs(actual.astype(np.float64) - expected) / scale
    assert np.count_nonzero(difference > TOLERANCE) <= SHARE_OF_FLIPS * difference.size
    assert difference.max(initial=0.0) <= LARGEST_FLIP


def check_render(renderer, scene, camera):
    background = np.array([0.2, 0.4, 0.9], np.float32)
    actual, expected = renderer.render(scene, camera, background), REFERENCE.render(scene, camera, background)
    assert_close(actual.rgb, expected.rgb)
    assert_close(actual.alpha, expected.alpha)
    assert_close(actual.depth * expected.alpha, expected.depth * expected.alpha, scale=3.0)
    assert_close(renderer.render(scene, camera).rgb, REFERENCE.render(scene, camera).rgb)


def check_blend_values(renderer, scene, camera):
    values = np.random.default_rng(1).uniform(-1, 1, (len(scene), 5)).astype(np.float32)
    actual, expected = (r.blend_values(scene, camera, values) for r in (renderer, REFERENCE))
    assert_close(actual, expected)


def check_blend_weights(renderer, scene, camera):
    labels = np.random.default_rng(0).integers(0, 4, (camera.height, camera.width)).astype(np.uint8)
    labels[0] = 255
    actual, expected = (r.blend_weights(scene, camera, labels, 3) for r in (renderer, REFERENCE))
    assert expected.sum() > 100
    assert_close(actual, expected, scale=np.maximum(expected, 1.0))
    np.testing.assert_array_equal(actual, renderer.blend_weights(scene, camera, labels, 3))


def check_top_contributors(renderer, scene, camera, k):
    pixels = np.random.default_rng(0).integers(0, (camera.width, camera.height), (60, 2))
    expected_ids, expected = REFERENCE.top_contributors(scene, camera, pixels, k + 1)
    ids, weights = renderer.top_contributors(scene, camera, pixels, k)
    assert ids.dtype == np.int64 and ids.shape == (60, k)
    assert_close(weights, expected[:, :k])
    assert np.all((ids == -1) == (weights == 0))
    # Where neighbours in the ranking are nearly equal, either order is right.
    gap = -np.diff(np.column_stack([np.full(len(pixels), np.inf), expected]), axis=1)
    separated = np.minimum(gap[:, :-1], gap[:, 1:]) > 20 * TOLERANCE
    np.testing.assert_array_equal(ids[separated], expected_ids[:, :k][separated])
    assert separated.sum() > 30


def test_renders_what_the_reference_renders(stand_in):
    check_render(GsplatRenderer("cpu"), scene_below_the_caps(), CAMERA)


@pytest.mark.parametrize("sh_degree", [0, 1, 3])
def test_every_degree_of_spherical_harmonics(stand_in, sh_degree):
    check_render(GsplatRenderer("cpu"), scene_below_the_caps(3, 24, sh_degree), front_camera(20, 15))


def test_blends_any_values(stand_in):
    check_blend_values(GsplatRenderer("cpu"), scene_below_the_caps(), CAMERA)


def test_blend_weights_by_label(stand_in):
    check_blend_weights(GsplatRenderer("cpu"), scene_below_the_caps(), CAMERA)


@pytest.mark.parametrize("k", [1, 4, 100])
def test_top_contributors(stand_in, k):
    check_top_contributors(GsplatRenderer("cpu"), scene_below_the_caps(), CAMERA, k)


def test_bands_of_the_image_change_nothing(stand_in, monkeypatch):
    renderer, scene = GsplatRenderer("cpu"), scene_below_the_caps()
    labels = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    pixels = np.array([[3, 2], [30, 25], [3, 2], [18, 16]])
    whole = renderer.blend_weights(scene, CAMERA, labels, 1), *renderer.top_contributors(scene, CAMERA, pixels, 5)
    monkeypatch.setattr(gsplat_cuda, "_PAIRS_AT_ONCE", 1)
    banded = renderer.blend_weights(scene, CAMERA, labels, 1), *renderer.top_contributors(scene, CAMERA, pixels, 5)
    for one, other in zip(whole, banded, strict=True):
        np.testing.assert_array_equal(one, other)


def test_weights_of_all_pixels_add_up_to_alpha(stand_in):
    renderer = GsplatRenderer("cpu")
    opaque, behind = (gaussian((0, 0, z), (40, 40, 0.01), opacity=o) for z, o in ((1, 0.99999), (2, 0.5)))
    scene, camera = concatenate([behind, opaque]), Camera(np.eye(4), CAMERA.K, CAMERA.width, CAMERA.height)
    labels = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    weights, alpha = renderer.blend_weights(scene, camera, labels, 1), renderer.render(scene, camera).alpha
    # Only with the cap of the version in use does the weight behind the opaque Gaussian come out right.
    assert weights[0, 0] == pytest.approx(0.5 * (1 - stand_in.alpha_cap) * alpha.size, rel=0.01)
    assert weights.sum() == pytest.approx(alpha.sum(), rel=1e-5)


@pytest.mark.parametrize("cap", [0.999, 0.99])
def test_the_alpha_cap_is_measured(monkeypatch, cap):
    install(monkeypatch, StandIn(alpha_cap=cap))
    assert GsplatRenderer("cpu")._alpha_cap == pytest.approx(cap, abs=1e-6)


def test_far_from_the_origin_as_near_it(stand_in):
    scene, offset = scene_below_the_caps(), np.array([40000.0, -70000.0, 9000.0])
    far = scene.replace(means=(scene.means + offset).astype(np.float32))
    # Rounded to float32, the means have moved by up to 0.004; the renderers must agree on the rounded scene.
    pose = CAMERA.world_to_camera.copy()
    pose[:3, 3] -= pose[:3, :3] @ offset
    check_render(GsplatRenderer("cpu"), far, Camera(pose, CAMERA.K, CAMERA.width, CAMERA.height))


def test_nothing_to_draw(stand_in):
    renderer = GsplatRenderer("cpu")
    labels, pixels = np.zeros((CAMERA.height, CAMERA.width), np.uint8), np.array([[1, 2]])
    for scene in (scene_below_the_caps().select(slice(0, 0)), gaussian(mean=(100, 100, -100))):
        check_render(renderer, scene, CAMERA)
        assert renderer.blend_values(scene, CAMERA, np.ones((len(scene), 2), np.float32)).shape == (26, 37, 2)
        np.testing.assert_array_equal(renderer.blend_weights(scene, CAMERA, labels, 2), np.zeros((len(scene), 2)))
        ids, weights = renderer.top_contributors(scene, CAMERA, pixels, 3)
        assert ids.tolist() == [[-1] * 3] and weights.tolist() == [[0] * 3]


def test_no_pixels_asked(stand_in):
    ids, weights = GsplatRenderer("cpu").top_contributors(scene_below_the_caps(), CAMERA, np.zeros((0, 2), int), 3)
    assert ids.shape == weights.shape == (0, 3)


def test_pixels_outside_the_image_are_refused(stand_in):
    with pytest.raises(ValueError, match="in the image of 37 x 26"):
        GsplatRenderer("cpu").top_contributors(scene_below_the_caps(), CAMERA, np.array([[37, 0]]), 3)


def test_gaussians_are_uploaded_once_and_released_with_their_owner(stand_in):
    renderer, scene, other = GsplatRenderer("cpu"), scene_below_the_caps(), scene_below_the_caps(1)
    for drawn in (scene, other, scene):
        renderer.render(drawn, CAMERA)
    renderer.render(scene, front_camera(20, 10))
    first, second, third, fourth = stand_in.calls
    assert first == third == fourth != second
    assert len(renderer._uploaded) == 2
    del scene, drawn
    gc.collect()
    assert list(renderer._uploaded) == [other]


def test_files_are_not_written_through_their_arrays(stand_in):
    scene = scene_below_the_caps()
    for array in (scene.means, scene.quaternions, scene.opacity_logits):
        array.setflags(write=False)
    GsplatRenderer("cpu").render(scene, CAMERA)


def test_a_missing_extra_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "gsplat", None)
    with pytest.raises(InputError, match=r'pip install "gaussian-trimmer\[cuda\]", or render with --renderer numba'):
        GsplatRenderer()


def test_a_missing_gpu_is_named(stand_in, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(InputError, match="needs a CUDA device, and PyTorch finds none"):
        GsplatRenderer()


def test_missing_kernels_are_named(monkeypatch):
    install(monkeypatch, StandIn(), kernels=False)
    with pytest.raises(InputError, match=r"cannot compile its CUDA kernels .there is no CUDA toolkit"):
        GsplatRenderer("cpu")


@pytest.mark.parametrize("gpu", [True, False])
@pytest.mark.parametrize("installed", [True, False])
def test_is_available_asks_for_both(monkeypatch, gpu, installed):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: gpu)
    monkeypatch.setattr(gsplat_cuda, "find_spec", lambda name: object() if installed or name != "gsplat" else None)
    assert gsplat_cuda.is_available() is (gpu and installed)


@pytest.mark.parametrize("name", ["rasterization", "rasterize_to_indices_in_range"])
def test_the_stand_in_has_the_signatures_of_the_installed_gsplat(name):
    gsplat = pytest.importorskip("gsplat", reason="gsplat is not installed")
    real = inspect.signature(getattr(gsplat, name)).parameters
    for i, (parameter, own) in enumerate(inspect.signature(getattr(StandIn(), name)).parameters.items()):
        assert list(real)[i] == parameter
        assert real[parameter].default == own.default


@pytest.fixture(scope="module")
def gpu_renderer():
    pytest.importorskip("gsplat", reason="gsplat is not installed")
    if not torch.cuda.is_available():
        pytest.skip("there is no CUDA device")
    return GsplatRenderer()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("size", [(37, 26), (130, 97)])
def test_parity_on_a_gpu(gpu_renderer, seed, size):
    scene, camera = scene_below_the_caps(seed, 160), front_camera(*size)
    check_render(gpu_renderer, scene, camera)
    check_blend_values(gpu_renderer, scene, camera)
    check_blend_weights(gpu_renderer, scene, camera)
    check_top_contributors(gpu_renderer, scene, camera, 10)


def test_the_weights_of_a_gpu_add_up_to_alpha(gpu_renderer):
    scene, camera = random_scene(5, 160), front_camera(130, 97)
    labels = np.zeros((97, 130), np.uint8)
    total = gpu_renderer.blend_weights(scene, camera, labels, 1).sum()
    assert total == pytest.approx(gpu_renderer.render(scene, camera).alpha.sum(), rel=1e-4)
    assert gpu_renderer._alpha_cap in (pytest.approx(0.999, abs=1e-5), pytest.approx(0.99, abs=1e-5))
