"""Drawing against the reference, on random scenes and on the cases that are easily drawn wrong."""

from functools import cache

import numpy as np
import pytest
import reference
from scenes import front_camera, gaussian, random_scene

from gaussian_trimmer import rendering
from gaussian_trimmer.gaussians import concatenate

# The fast paths compute in float32 with an approximate exponential, relative errors of about 1e-5; where that tips an
# alpha over the cut-off or a transmittance over the stop, a pixel may change by 0.01: allowed to one in a thousand.
TOLERANCE = 5e-5
LARGEST_FLIP = 0.01
SHARE_OF_FLIPS = 0.001

SIZES = [(83, 61), (7, 5), (48, 32), (130, 17)]
BACKGROUND = np.array([0.2, 0.4, 0.9], np.float32)


def wide(depth, opacity, colour=(0.9, 0.4, 0.1)):
    """A Gaussian so large that it covers the image of `straight_camera` almost evenly."""
    return gaussian(mean=(0.1, 0.05, depth), scale=(1.5, 1.2, 0.01), opacity=opacity, colour=colour)


def straight_camera(width, height):
    camera = front_camera(width, height)
    return type(camera)(np.eye(4), camera.K, width, height)


@cache
def view(scene, width, height):
    """Gaussians and a camera, by the scene's name."""
    if scene.startswith("random"):
        degree = int(scene[-1])
        gaussians = random_scene(seed=10 + degree, sh_degree=degree)
        model = "antialiased" if "antialiased" in scene else "default"
        return gaussians.replace(model=model), front_camera(width, height)
    gaussians = {
        "capped": concatenate([wide(2.0, 0.9999), wide(1.0, 0.3, (0.1, 0.8, 0.6))]),
        "exhausted": concatenate([wide(2.0 - 0.07 * i, 0.75, (i % 2, 0.1 * i, 0.5)) for i in range(10)]),
        "faint": concatenate([wide(2.0 - 0.1 * i, opacity) for i, opacity in enumerate([0.0035, 0.0045, 0.006])]),
        "behind": wide(-1.0, 0.9),
        "empty": wide(1.0, 0.9).select(slice(0, 0)),
    }
    return gaussians[scene], straight_camera(width, height)


SCENES = [f"random {degree}" for degree in range(4)] + [
    "random antialiased 1",
    "capped",
    "exhausted",
    "faint",
    "behind",
    "empty",
]
VIEWS = [(scene, *size) for scene in SCENES for size in SIZES]


def assert_close(actual, expected, scale=1.0):
    """Nearly all entries agree within the tolerance, all within a flip, both relative to `scale`."""
    assert actual.shape == expected.shape
    assert np.isfinite(actual).all()
    difference = np.abs(actual.astype(np.float64) - expected) / scale
    assert np.count_nonzero(difference > TOLERANCE) <= SHARE_OF_FLIPS * difference.size
    assert difference.max(initial=0.0) <= LARGEST_FLIP


def assert_weights_close(actual, expected):
    """Sums over many pixels: errors add up in proportion."""
    assert_close(actual, expected, scale=np.maximum(expected, 1.0))


@pytest.mark.parametrize("args", VIEWS, ids=str)
def test_render(args):
    expected, actual = (renderer.render(*view(*args), BACKGROUND) for renderer in (reference, rendering))
    assert_close(actual.rgb, expected.rgb)
    assert_close(actual.alpha, expected.alpha)
    # Depths are quotients by alpha, so their error is too; they are of the order of 3.
    assert_close(actual.depth * expected.alpha, expected.depth * expected.alpha, scale=3.0)
    assert np.all((actual.depth == 0) == (actual.alpha == 0))
    assert actual.weights.size == 0


@pytest.mark.parametrize("args", [("random 2", 83, 61), ("exhausted", 130, 17), ("empty", 7, 5)], ids=str)
def test_render_with_weights(args):
    gaussians, camera = view(*args)
    expected = reference.render(gaussians, camera, BACKGROUND, weights=True)
    actual = rendering.render(gaussians, camera, BACKGROUND, weights=True)
    assert_close(actual.rgb, expected.rgb)
    assert expected.weights.shape == (len(gaussians),)
    assert expected.weights.sum() == pytest.approx(expected.alpha.sum(), rel=1e-5)
    assert_weights_close(actual.weights, expected.weights)


def test_scenes_are_worth_rendering():
    reference_rendering = cache(lambda *args: reference.render(*view(*args)))
    for scene in ("random 0", "random 1", "random 2", "random 3"):
        alpha = reference_rendering(scene, 83, 61).alpha
        assert alpha.min() < 0.3
        assert alpha.max() > 1 - 1e-3
    assert 0.989 < reference_rendering("capped", 83, 61).alpha.max() < 0.9935
    assert 0 < reference_rendering("faint", 83, 61).alpha.max() < 0.012
    assert reference_rendering("behind", 83, 61).alpha.max() == 0


@pytest.mark.parametrize("args", [("random 2", 83, 61), ("exhausted", 130, 17), ("empty", 7, 5)], ids=str)
def test_blend_values(args):
    gaussians, camera = view(*args)
    values = np.random.default_rng(1).uniform(-1, 1, (len(gaussians), 5)).astype(np.float32)
    assert_close(rendering.blend_values(gaussians, camera, values), reference.blend_values(gaussians, camera, values))


@pytest.mark.parametrize("n_labels", [1, 2, 5])
@pytest.mark.parametrize("args", VIEWS, ids=str)
def test_blend_weights(args, n_labels):
    gaussians, camera = view(*args)
    # Labels up to 7: some are n_labels or more, and count nowhere.
    labels = np.random.default_rng(0).integers(0, 8, (camera.height, camera.width)).astype(np.uint8)
    labels[0, 0] = 255
    expected = reference.blend_weights(gaussians, camera, labels, n_labels)
    actual = rendering.blend_weights(gaussians, camera, labels, n_labels)
    assert_weights_close(actual, expected)
    assert np.all(actual >= 0)
    np.testing.assert_array_equal(
        rendering.blend_weights(gaussians, camera, labels, n_labels), actual, "Every time the same."
    )


@pytest.mark.parametrize("k", [1, 4, 200])
@pytest.mark.parametrize("args", [*VIEWS[:8], ("exhausted", 83, 61), ("behind", 7, 5), ("empty", 7, 5)], ids=str)
def test_top_contributors(args, k):
    gaussians, camera = view(*args)
    pixels = np.random.default_rng(0).integers(0, (camera.width, camera.height), (150, 2))
    # One more than asked, to see whether the last one is well separated from the next.
    expected_ids, expected = reference.top_contributors(gaussians, camera, pixels, k + 1)
    ids, weights = rendering.top_contributors(gaussians, camera, pixels, k)
    assert_close(weights, expected[:, :k])
    assert np.all(np.diff(weights, axis=1) <= 0)
    assert np.all((ids == -1) == (weights == 0))
    gap = -np.diff(np.column_stack([np.full(len(pixels), np.inf), expected]), axis=1)
    separated = np.minimum(gap[:, :-1], gap[:, 1:]) > 20 * TOLERANCE
    wrong = ids[separated] != expected_ids[:, :k][separated]
    assert wrong.sum() <= SHARE_OF_FLIPS * wrong.size
    assert separated.sum() >= 0.8 * np.count_nonzero(expected[:, 0])
