"""GrabCut on drawn pictures."""

import numpy as np
import pytest
import toy

from gaussian_trimmer.cameras import Camera, intrinsics
from gaussian_trimmer.masks.sam import grabcut_masks
from gaussian_trimmer.rendering import Rendering
from gaussian_trimmer.views.view import View

HEIGHT, WIDTH = 96, 128


def disc(x=64.0, y=48.0, radius=25.0):
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    return np.hypot(columns - x, rows - y) < radius


def picture(mask, noise=0.03, seed=0):
    rng = np.random.default_rng(seed)
    rgb = np.where(mask[..., None], (0.8, 0.2, 0.1), (0.2, 0.4, 0.7)) + rng.normal(0, noise, (*mask.shape, 3))
    return rgb.astype(np.float32)


def view(expected, rgb=None):
    """A view whose expected share of the object is given, and nothing else that GrabCut needs."""
    expected = np.asarray(expected, np.float32)
    height, width = expected.shape
    blank = np.zeros((height, width), np.float32)
    rgb = picture(expected > 0.5) if rgb is None else rgb
    camera = Camera(np.eye(4), intrinsics(1.0, width, height), width, height)
    return View(camera, Rendering(rgb, blank + 1, blank), blank, blank, expected, (0, 0, width, height))


def masks_of(views):
    return [mask for _, mask in grabcut_masks(views)]


@pytest.mark.parametrize(("x", "radius"), [(64, 24), (64, 26), (65.5, 25)])
def test_grabcut_finds_the_disc_from_a_rough_silhouette(x, radius):
    truth, rough = disc(), disc(x, radius=radius)
    (mask,) = masks_of([view(rough, picture(truth))])
    assert mask.shape == truth.shape
    assert toy.jaccard(mask, truth) > max(0.98, toy.jaccard(rough, truth))


def test_grabcut_stays_near_the_expected_silhouette_and_within_the_picture():
    twins, truth = disc(35, radius=20) | disc(95, radius=20), disc(5)
    near, at_edge, nothing, everything, bright = masks_of([
        view(disc(35, radius=20), picture(twins)), view(disc(5, radius=24), picture(truth)),
        view(np.zeros((HEIGHT, WIDTH))), view(np.ones((HEIGHT, WIDTH)), picture(disc())),
        view(disc(radius=24), 3 * picture(disc()) - 0.5),
    ])  # fmt: skip
    assert not near[:, 64:].any() and toy.jaccard(near, disc(35, radius=20)) > 0.98
    assert at_edge[48, 0] and toy.jaccard(at_edge, truth) > 0.97
    assert not nothing.any() and everything.all() and toy.jaccard(bright, disc()) > 0.97


@pytest.mark.parametrize("pixels", [1, 2, 5, 30])
def test_grabcut_works_on_the_smallest_objects_and_backgrounds(pixels):
    few = np.zeros((40, 40))
    few.flat[820 : 820 + pixels] = 1
    rgb = np.random.default_rng(0).random((40, 40, 3)).astype(np.float32)
    small, large = masks_of([view(few, rgb), view(1 - few, rgb)])
    assert np.count_nonzero(small) < 200
    assert np.count_nonzero(large) > 1400


def test_grabcut_gives_the_same_mask_every_time_and_in_any_order():
    rough = view(disc(66), picture(disc(), noise=0.3))
    other = view(disc(40), picture(disc(42), noise=0.3, seed=1))
    first, second = masks_of([rough, other])
    reverse = masks_of([other, rough])
    np.testing.assert_array_equal(reverse[1], first)
    np.testing.assert_array_equal(reverse[0], second)
