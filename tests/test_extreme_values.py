"""Numbers as large, as small and as meaningless as they can be: no kernel leaves its arrays, and what can be drawn is.

Whether a kernel writes beside its arrays cannot be seen in what it returns. The tests of that run in a process in which
Numba checks every index.
"""

import os
import subprocess
import sys

import numpy as np
import pytest
import reference
from scenes import (
    COORDINATES,
    FAR_COORDINATES,
    MEANINGLESS,
    extreme_camera,
    extreme_scene,
    front_camera,
    gaussian,
    huge_gaussians,
)
from test_rendering_parity import LARGEST_FLIP, TOLERANCE, assert_close, assert_weights_close

from gaussian_trimmer import rendering
from gaussian_trimmer.cameras import Camera

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
        ask_everything(rendering, scene, extreme_camera(seed, MEANINGLESS if seed % 4 == 3 else ()))


CHECKED = """
import numba
compiled = numba.njit
numba.njit = lambda *function, **options: compiled(*function, **{**options, "boundscheck": True})
import numpy as np
import test_extreme_values
test_extreme_values.draw_extreme_scenes()
from gaussian_trimmer.rendering.projection_kernels import Tiles, bin_gaussians
places = np.array([[0, 0, 16, 16]])
tiles = Tiles(0, np.array([0, 1]), np.zeros(1, np.int32), np.zeros((1, 2), np.uint8), places)
try:
    bin_gaussians(np.zeros((2, 3), np.float32), 0, (0, 1, 1, 16), tiles, np.array([0]), 0, 1)
except IndexError:
    print("done")
"""


@pytest.mark.slow
def test_no_kernel_leaves_its_arrays(tmp_path):
    path = os.pathsep.join(path for path in sys.path if path)
    # A cache of its own: Numba does not tell kernels that check from others.
    environment = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_OPT": "1"}
    done = subprocess.run(
        [sys.executable, "-c", CHECKED], env=environment, capture_output=True, text=True, check=False, timeout=600
    )
    assert (done.returncode, done.stdout.strip()) == (0, "done"), done.stderr


# --- what can be drawn is drawn, and alike


@pytest.mark.parametrize("seed", range(45))
def test_extreme_scenes_look_alike(seed):
    # Not their colours: of 1e30, an error of a millionth is more than any tolerance. Opacities of exactly one lie on
    # the threshold at which a pixel is finished, so more pixels flip than in other scenes.
    scene, camera = extreme_scene(seed), extreme_camera(seed)
    expected, *others = ask_everything(reference, scene, camera)[1:]
    actual, *more = ask_everything(rendering, scene, camera)[1:]
    assert all(np.isfinite(array).all() for array in (actual, *others, *more))
    difference = np.abs(actual - expected)
    assert difference.max() <= LARGEST_FLIP
    assert np.mean(difference > TOLERANCE) <= 0.01


@pytest.mark.parametrize("seed", range(10))
def test_huge_gaussians_are_drawn_alike(seed):
    scene, camera = huge_gaussians(seed), front_camera(83, 61)
    actual, expected = (renderer.render(scene, camera, weights=True) for renderer in (rendering, reference))
    assert expected.alpha.min() > 0.2, "They cover the picture."
    assert_close(actual.rgb, expected.rgb)
    assert_close(actual.alpha, expected.alpha)
    assert_weights_close(actual.weights, expected.weights)


@pytest.mark.parametrize("renderer", [rendering, reference])
@pytest.mark.parametrize("log_scale", [18.5, 30.0, 48.0, 88.0, 300.0])
def test_a_needle_of_any_length_is_a_line(renderer, log_scale):
    # At 45 degrees through the middle of the pixel (16, 16); thinner than a pixel, so its profile is the low pass.
    camera = Camera(np.eye(4), np.array([[20.0, 0, 16.5], [0, 20.0, 16.5], [0, 0, 1]]), 33, 33)
    quaternion = (np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8))
    needle = gaussian((0, 0, 1), quaternion=quaternion, opacity=0.8)
    needle = needle.replace(log_scales=np.array([[log_scale, -20, -20]], np.float32))
    alpha = renderer.render(needle, camera).alpha
    y, x = np.indices(alpha.shape)
    profile = 0.8 * np.exp(-0.5 * ((x - y) ** 2 / 2) / 0.3)
    np.testing.assert_allclose(alpha, np.where(profile >= 1 / 255, profile, 0), atol=1e-3)


@pytest.mark.parametrize("renderer", [rendering, reference])
@pytest.mark.parametrize("length", [1e-30, 1e-20, 1.0, 1e20])
def test_the_length_of_a_quaternion_does_not_matter(renderer, length):
    camera = front_camera(33, 20)
    turned = gaussian((0.4, -0.3, 0.2), scale=(0.5, 0.1, 0.05), quaternion=(0.5, -0.7, 0.4, 0.3), opacity=0.8)
    expected = renderer.render(turned, camera).alpha
    stretched = turned.replace(quaternions=(np.float64(length) * turned.quaternions).astype(np.float32))
    np.testing.assert_allclose(renderer.render(stretched, camera).alpha, expected, atol=1e-5)
    assert expected.max() > 0.5
