"""Numbers as large, as small and as meaningless as they can be: no kernel leaves its arrays, and what can be drawn is.

Whether a kernel writes beside its arrays cannot be seen in what it returns. The tests of that run in a process in which
Numba checks every index.
"""

import os
import subprocess
import sys

import numpy as np
import pytest
import toy
from extreme_scenes import COORDINATES, FAR_COORDINATES, MEANINGLESS, extreme_camera, extreme_scene, huge_gaussians
from scenes import front_camera, gaussian
from test_rendering_parity import LARGEST_FLIP, TOLERANCE, assert_close, assert_weights_close

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.rendering.numba_cpu import TILE, NumbaRenderer
from gaussian_trimmer.rendering.numba_kernels import bin_gaussians, blend_tiles, count_tiles, top_of_pixels
from gaussian_trimmer.trimming.trim import trim

N_SCENES = 50


def ask_everything(renderer, scene, camera):
    """Whatever a renderer can be asked about a view."""
    shape = camera.height, camera.width
    pixels = np.argwhere(np.ones(shape, np.bool_))[::5, ::-1]
    picture = renderer.render(scene, camera, weights=True)
    values = renderer.blend_values(scene, camera, np.ones((len(scene), 2), np.float32))
    weights = renderer.blend_weights(scene, camera, np.indices(shape).sum(axis=0).astype(np.uint8) % 3, 3)
    ids, largest = renderer.top_contributors(scene, camera, pixels, 3)
    assert ids.min(initial=0) >= -1 and ids.max(initial=-1) < len(scene)
    return [picture.rgb, picture.alpha, picture.depth, picture.weights, values, weights, largest]


def draw_extreme_scenes():
    """Draw scenes and cameras whose numbers may be anything, NaN among them."""
    for seed in range(N_SCENES):
        scene = extreme_scene(seed, (*COORDINATES, *FAR_COORDINATES), MEANINGLESS)
        ask_everything(NumbaRenderer(), scene, extreme_camera(seed, MEANINGLESS if seed % 4 == 3 else ()))


def draw_meaningless_splats():
    """Run the kernels behind the projection on splats that no projection returns, and on wrong counts of them."""
    width, height = 49, 35
    n_tiles = -(-width // TILE) * -(-height // TILE)
    pixels = np.argwhere(np.ones((height, width), np.bool_))[::7, ::-1].astype(np.int64)
    for seed in range(N_SCENES):
        rng = np.random.default_rng(seed)
        splats = rng.normal(0, 30, (40, 8)).astype(np.float32)
        extremes = [0.0, 1e-38, 1e9, -1e9, 2e23, -2e23, 3e38, -3e38, *MEANINGLESS]
        splats = np.where(rng.random(splats.shape) < 0.3, rng.choice(extremes, splats.shape), splats)
        splats = splats.astype(np.float32)
        counts = count_tiles(splats, width, height)
        assert counts.min() >= 0 and counts.max() <= len(splats)
        if seed % 2:  # As if the arithmetic of the lists had been rounded another way than that of their lengths.
            counts = np.maximum(counts + rng.integers(-2, 3, len(counts)), 0)
        starts = np.concatenate([[0], np.cumsum(counts)])
        lists, spans = bin_gaussians(splats, width, height, starts, 0)
        assert lists.min(initial=0) >= 0 and lists.max(initial=0) < len(splats)
        assert spans.max(initial=0) <= TILE
        image = np.zeros((2, -(-height // TILE) * TILE, -(-width // TILE) * TILE), np.float32)
        blend_tiles(splats, splats[:, :1].copy(), starts, lists, spans, 0, width, height, image[:1] + 1, image)
        ids, weights = np.full((len(pixels), 3), -1), np.zeros((len(pixels), 3), np.float32)
        top_of_pixels(splats, starts, lists, spans, 0, width, pixels, ids, weights)
        assert len(starts) == n_tiles + 1


def write_beside_an_array():
    """What must fail where indices are checked."""
    bin_gaussians(np.zeros((2, 3), np.float32), 16, 16, np.array([0, 1]), 0)


CHECKED = """
import sys
import numba
compiled = numba.njit
numba.njit = lambda *function, **options: compiled(*function, **{**options, "boundscheck": True, "parallel": False})
import test_extreme_values
getattr(test_extreme_values, sys.argv[1])()
print("done")
"""
# Numba may lose an error within a parallel loop, so these are compiled as plain ones.


def in_a_checked_process(function, cache):
    """Call a function of this module, by its name, in a process in which every index of a kernel is checked."""
    path = os.pathsep.join(path for path in sys.path if path)
    environment = {"PYTHONPATH": path, "NUMBA_CACHE_DIR": str(cache), "NUMBA_OPT": "1"}
    return subprocess.run(
        [sys.executable, "-c", CHECKED, function], env={**os.environ, **environment}, capture_output=True, text=True,
        check=False, timeout=600,
    )  # fmt: skip


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """A folder of its own for kernels that check: Numba does not tell them from others."""
    return tmp_path_factory.mktemp("checked_kernels")


@pytest.mark.slow
@pytest.mark.parametrize("function", ["draw_extreme_scenes", "draw_meaningless_splats"])
def test_no_kernel_leaves_its_arrays(function, cache):
    done = in_a_checked_process(function, cache)
    assert (done.returncode, done.stdout.strip()) == (0, "done"), done.stderr


@pytest.mark.slow
def test_indices_are_really_checked_there(cache):
    done = in_a_checked_process("write_beside_an_array", cache)
    assert done.returncode == 1
    assert "IndexError: index is out of bounds" in done.stderr


# --- what can be drawn is drawn, and alike


@pytest.mark.parametrize("seed", range(45))
def test_extreme_scenes_look_alike(seed):
    # Not their colours: of 1e30, an error of a millionth is more than any tolerance. Opacities of exactly one lie on
    # the threshold at which a pixel is finished, so more pixels flip than in other scenes.
    scene, camera = extreme_scene(seed), extreme_camera(seed)
    expected, *others = ask_everything(get_renderer("reference"), scene, camera)[1:]
    actual, *more = ask_everything(get_renderer("numba"), scene, camera)[1:]
    assert all(np.isfinite(array).all() for array in (actual, *others, *more))
    difference = np.abs(actual - expected)
    assert difference.max() <= LARGEST_FLIP
    assert np.mean(difference > TOLERANCE) <= 0.01


def test_extreme_scenes_are_worth_drawing():
    alphas = [NumbaRenderer().render(extreme_scene(seed), extreme_camera(seed)).alpha.max() for seed in range(45)]
    assert np.sum(np.array(alphas) > 0.5) > 15


@pytest.mark.parametrize("seed", range(10))
def test_huge_gaussians_are_drawn_alike(seed):
    scene, camera = huge_gaussians(seed), front_camera(83, 61)
    numba, reference = get_renderer("numba"), get_renderer("reference")
    actual, expected = (renderer.render(scene, camera, weights=True) for renderer in (numba, reference))
    assert expected.alpha.min() > 0.2, "They cover the picture."
    assert_close(numba, actual.rgb, expected.rgb)
    assert_close(numba, actual.alpha, expected.alpha)
    assert_weights_close(numba, actual.weights, expected.weights)


@pytest.mark.parametrize("renderer", ["numba", "reference"])
@pytest.mark.parametrize("log_scale", [18.5, 30.0, 48.0, 88.0, 300.0])
def test_a_needle_of_any_length_is_a_line(renderer, log_scale):
    # At 45 degrees through the middle of the pixel (16, 16); thinner than a pixel, so its profile is the low pass.
    camera = Camera(np.eye(4), np.array([[20.0, 0, 16.5], [0, 20.0, 16.5], [0, 0, 1]]), 33, 33)
    quaternion = (np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8))
    needle = gaussian((0, 0, 1), quaternion=quaternion, opacity=0.8)
    needle = needle.replace(log_scales=np.array([[log_scale, -20, -20]], np.float32))
    alpha = get_renderer(renderer).render(needle, camera).alpha
    y, x = np.indices(alpha.shape)
    profile = 0.8 * np.exp(-0.5 * ((x - y) ** 2 / 2) / 0.3)
    np.testing.assert_allclose(alpha, np.where(profile >= 1 / 255, profile, 0), atol=1e-3)


@pytest.mark.parametrize("renderer", ["numba", "reference"])
@pytest.mark.parametrize("length", [1e-30, 1e-20, 1.0, 1e20])
def test_the_length_of_a_quaternion_does_not_matter(renderer, length):
    camera = front_camera(33, 20)
    turned = gaussian((0.4, -0.3, 0.2), scale=(0.5, 0.1, 0.05), quaternion=(0.5, -0.7, 0.4, 0.3), opacity=0.8)
    expected = get_renderer(renderer).render(turned, camera).alpha
    stretched = turned.replace(quaternions=(np.float64(length) * turned.quaternions).astype(np.float32))
    np.testing.assert_allclose(get_renderer(renderer).render(stretched, camera).alpha, expected, atol=1e-5)
    assert expected.max() > 0.5


@pytest.mark.parametrize("renderer", ["numba", "reference"])
def test_what_is_not_finite_is_not_drawn(renderer):
    camera, whole = front_camera(33, 20), gaussian((0.4, -0.3, 0.2), opacity=0.8)
    for name in ("means", "log_scales", "quaternions"):
        for number in MEANINGLESS:
            damaged = getattr(whole, name).copy()
            damaged[0, 0] = number
            if (name, number) in (("log_scales", -np.inf), ("log_scales", np.inf)):
                continue  # A flat one, and one taken for the largest that there is.
            alpha = get_renderer(renderer).render(whole.replace(**{name: damaged}), camera).alpha
            assert not alpha.any(), (name, number)


@pytest.mark.parametrize("selected", [False, True])
@pytest.mark.parametrize("log_scale", [48.0, 80.0])
def test_one_exploded_gaussian_does_not_spoil_a_trim(log_scale, selected):
    scene, truth = toy.ball_on_floor(n_ball=400, floor_side=20)
    selection = toy.dilated(scene, truth)
    log_scales = scene.log_scales.copy()
    log_scales[np.flatnonzero(selection == selected)[0]] = log_scale
    result = trim(scene.replace(log_scales=log_scales), selection, config=toy.small_config())
    assert result.refused is None
    toy.check_parts(result, selection)
    assert toy.jaccard(toy.object_rows(result), truth) > 0.98 > toy.jaccard(selection, truth)
