"""The gsplat renderer without a GPU, on stand-ins for gsplat; test_rendering_parity.py tests what it computes."""

import gc
import sys
from dataclasses import replace

import numpy as np
import pytest
from extreme_scenes import huge_gaussians
from scenes import front_camera, gaussian, random_scene

torch = pytest.importorskip("torch", reason="needs PyTorch: the cuda extra")

from gsplat_stand_in import VERSIONS, StandIn, alpha_cap_of, install, install_version, make_renderer, one_thread  # noqa: E402
from test_rendering_parity import assert_close  # noqa: E402

from gaussian_trimmer import rendering  # noqa: E402
from gaussian_trimmer.errors import InputError  # noqa: E402
from gaussian_trimmer.gaussians import concatenate  # noqa: E402
from gaussian_trimmer.rendering import get_renderer, gsplat_cuda  # noqa: E402
from gaussian_trimmer.rendering.gsplat_cuda import GsplatRenderer  # noqa: E402
from gaussian_trimmer.rendering.reference import ReferenceRenderer  # noqa: E402


@pytest.fixture(params=VERSIONS)
def version(request, monkeypatch):
    install_version(monkeypatch, request.param)
    return request.param


@pytest.fixture(params=["gsplat", *VERSIONS])
def renderer(request, monkeypatch):
    return make_renderer(request.param, monkeypatch)


@pytest.fixture(autouse=True, scope="module")
def few_threads():
    with one_thread():
        yield


CAMERA = front_camera(37, 26)
SCENE = random_scene(0, 80, 2)
LABELS = np.zeros((CAMERA.height, CAMERA.width), np.uint8)


def noting(monkeypatch, renderer, name, note):
    """Call `note` with the arguments and the result of every call of one of gsplat's functions."""
    function = getattr(renderer._gsplat, name)

    def noted(*args, **kwargs):
        result = function(*args, **kwargs)
        note(args, result)
        return result

    monkeypatch.setattr(renderer._gsplat, name, noted)


def test_more_labels_and_values_than_go_through_at_once(renderer):
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 20, LABELS.shape).astype(np.uint8)
    sums = renderer.blend_weights(SCENE, CAMERA, labels, 19)
    for label in (0, 7, 8, 18):
        one = renderer.blend_weights(SCENE, CAMERA, np.uint8(labels != label), 1)
        np.testing.assert_allclose(sums[:, label], one[:, 0], rtol=1e-6)  # other widths round in another order
    assert sums.shape == (80, 19) and np.all(sums.sum(axis=0) > 10)
    values = rng.uniform(-1, 1, (80, 37)).astype(np.float32)
    image = renderer.blend_values(SCENE, CAMERA, values)
    parts = [renderer.blend_values(SCENE, CAMERA, part) for part in (values[:, :20], values[:, 20:])]
    np.testing.assert_allclose(image, np.concatenate(parts, axis=2), atol=1e-6)


def test_a_view_is_projected_once(renderer, monkeypatch):
    other = random_scene(1, 80, 2)
    projected = []
    noting(monkeypatch, renderer, "rasterization", lambda args, _: projected.append((args[0].data_ptr(), args[7])))
    for _ in range(2):
        for drawn in (SCENE, other):
            renderer.blend_values(drawn, CAMERA, np.ones((80, 1), np.float32))
            renderer.blend_weights(drawn, CAMERA, LABELS, 1)
    renderer.render(SCENE, front_camera(20, 10), weights=True)
    assert [width for _, width in projected] == [37, 37, 20]
    assert projected[0][0] == projected[2][0] != projected[1][0], "Gaussians are uploaded once, too."


def test_the_oldest_projections_make_room(renderer, monkeypatch):
    cameras, ones = [front_camera(20, 10) for _ in range(4)], np.ones((80, 1), np.float32)
    for camera in cameras[:3]:
        renderer.blend_values(SCENE, camera, ones)
    kept = renderer._upload(SCENE).projections
    assert [camera for camera, _ in kept.values()] == cameras[:3]
    monkeypatch.setattr(gsplat_cuda, "_KEPT_BYTES", sum(projection.nbytes for _, projection in kept.values()))
    renderer.blend_values(SCENE, cameras[0], ones)
    renderer.blend_values(SCENE, cameras[3], ones)
    assert [camera for camera, _ in kept.values()] == [cameras[2], cameras[0], cameras[3]]


def test_weights_of_all_pixels_add_up_to_alpha(renderer):
    opaque, behind = (gaussian((0, 0, z), (40, 40, 0.01), opacity=o) for z, o in ((1, 0.99999), (2, 0.5)))
    scene, camera = concatenate([behind, opaque]), replace(CAMERA, world_to_camera=np.eye(4))
    weights, alpha = renderer.blend_weights(scene, camera, LABELS, 1), renderer.render(scene, camera).alpha
    # Only with the cap of the version in use does the weight behind the opaque Gaussian come out right.
    behind = 0.5 * (1 - alpha_cap_of(renderer))
    assert weights[0, 0] == pytest.approx(behind * alpha.size, rel=0.01)
    assert weights.sum() == pytest.approx(alpha.sum(), rel=1e-5)


def test_far_from_the_origin_as_near_it(renderer, monkeypatch):
    offset = np.array([40000.0, -70000.0, 9000.0])
    far = SCENE.replace(means=(SCENE.means + offset).astype(np.float32))
    # Rounded to float32, the means have moved by up to 0.004; the renderers must agree on the rounded scene.
    pose = CAMERA.world_to_camera.copy()
    pose[:3, 3] -= pose[:3, :3] @ offset
    camera = replace(CAMERA, world_to_camera=pose)
    monkeypatch.setattr("gaussian_trimmer.rendering.reference.ALPHA_CAP", alpha_cap_of(renderer))
    actual, expected = (r.render(far, camera) for r in (renderer, ReferenceRenderer()))
    assert_close(renderer, actual.rgb, expected.rgb)
    assert_close(renderer, actual.depth * expected.alpha, expected.depth * expected.alpha, scale=3.0)


def test_huge_gaussians_as_in_the_reference(renderer, monkeypatch):
    # Round ones: gsplat finds determinants in single precision, in which those of long needles are lost.
    scene = huge_gaussians(0)
    scene = scene.replace(log_scales=np.repeat(scene.log_scales[:, :1], 3, axis=1))
    assert scene.log_scales.max() > 80
    monkeypatch.setattr("gaussian_trimmer.rendering.reference.ALPHA_CAP", alpha_cap_of(renderer))
    actual, expected = (r.render(scene, CAMERA) for r in (renderer, ReferenceRenderer()))
    assert expected.alpha.min() > 0.2
    assert_close(renderer, actual.rgb, expected.rgb)


def test_views_of_too_many_pairs_are_refused(renderer, monkeypatch):
    scene = concatenate([gaussian((0.4, -0.3, 0.2), scale=50.0, opacity=0.01)] * 10)
    n_pairs = 10 * -(-CAMERA.width // renderer._tile) * -(-CAMERA.height // renderer._tile)
    monkeypatch.setattr(gsplat_cuda, "_COUNTED_FIRST", 100)
    monkeypatch.setattr(rendering, "MOST_PAIRS", n_pairs)
    renderer.render(scene, CAMERA)
    monkeypatch.setattr(rendering, "MOST_PAIRS", n_pairs - 1)
    with pytest.raises(InputError, match=f"consists of {n_pairs:,} pairs of a tile and a Gaussian"):
        renderer.render(scene, front_camera(37, 26))


def test_too_little_memory_is_one_sentence(renderer, monkeypatch):
    def exhausted(*args, **kwargs):
        raise torch.OutOfMemoryError("CUDA out of memory.")

    monkeypatch.setattr(renderer._gsplat, "rasterization", exhausted)
    with pytest.raises(InputError, match="not enough memory for this view; take smaller views, or render with --rend"):
        renderer.render(SCENE, CAMERA)


def test_nothing_to_draw(renderer):
    background = np.array([0.2, 0.4, 0.9], np.float32)
    for scene in (SCENE.select(slice(0, 0)), gaussian(mean=(100, 100, -100))):
        n = len(scene)
        picture = renderer.render(scene, CAMERA, background, weights=True)
        np.testing.assert_array_equal(picture.rgb, np.broadcast_to(background, (26, 37, 3)))
        assert not picture.alpha.any() and not picture.depth.any() and picture.weights.tolist() == [0] * n
        assert renderer.blend_values(scene, CAMERA, np.ones((n, 2), np.float32)).shape == (26, 37, 2)
        np.testing.assert_array_equal(renderer.blend_weights(scene, CAMERA, LABELS, 2), np.zeros((n, 2)))
        ids, weights = renderer.top_contributors(scene, CAMERA, np.array([[1, 2]]), 3)
        assert ids.tolist() == [[-1] * 3] and weights.tolist() == [[0] * 3]


def test_gaussians_are_released_with_their_owner(renderer):
    scene, other = random_scene(0, 80, 2), random_scene(1, 80, 2)
    for drawn in (scene, other):
        renderer.render(drawn, CAMERA)
    assert len(renderer._uploaded) == 2
    del scene, drawn
    gc.collect()
    assert list(renderer._uploaded) == [other]


def test_a_missing_extra_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "gsplat", None)
    with pytest.raises(InputError, match=r'pip install "gaussian-trimmer\[cuda\]", or render with --renderer numba'):
        GsplatRenderer()


def test_a_missing_gpu_is_named(version, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(InputError, match="needs a CUDA device, and PyTorch finds none"):
        GsplatRenderer()


def test_missing_kernels_are_named(monkeypatch):
    install(monkeypatch, StandIn(), kernels=None)
    with pytest.raises(InputError, match=r"cannot compile its CUDA kernels .there is no CUDA toolkit"):
        GsplatRenderer("cpu")


def test_auto_is_numba_even_where_gsplat_could_run(version, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert get_renderer("auto").name == "numba"
