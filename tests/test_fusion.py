"""Masks and silhouettes fused: which is followed where, by confidence and by the other views."""

import numpy as np
import pytest
import toy

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.gaussians import Gaussians, concatenate
from gaussian_trimmer.masks.fusion import fuse_with_silhouettes
from gaussian_trimmer.rendering import Rendering, blend_values
from gaussian_trimmer.views.view import View

SIZE = 96


def wall():
    """A dense square of small Gaussians in the plane z = 0, from -1 to 1."""
    x, y = np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-1, 1, 41))
    means = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], -1)
    n = len(means)
    return Gaussians.from_arrays(
        means, np.tile([1.0, 0, 0, 0], (n, 1)), np.zeros((n, 1, 3)), scales=np.full((n, 3), 0.03),
        opacities=np.full(n, 0.95),
    )  # fmt: skip


def cameras(n=4, size=SIZE):
    K = intrinsics(np.radians(60), size, size)
    places = [np.array([np.sin(a), 0.2, -np.cos(a)]) * 3 for a in np.linspace(-0.5, 0.5, n)]
    return [Camera(look_at(place, np.zeros(3), np.array([0.0, -1, 0])), K, size, size) for place in places]


def masks_of(inside, shown, scene=None):
    """What the cameras see of the Gaussians that are inside, as masks."""
    part = inside.astype(np.float32)[:, None]
    return [blend_values(scene or SCENE, camera, part)[..., 0] > 0.5 for camera in shown]


def views_of(shown, silhouettes):
    """Views of which nothing is known but the silhouettes of the labels."""
    return [
        View(camera, Rendering(blank := np.zeros((camera.height, camera.width, 3), np.float32), blank[..., 0],
                               blank[..., 0]), blank[..., 0], blank[..., 0], silhouette.astype(np.float32),
             (0, 0, camera.width, camera.height))
        for camera, silhouette in zip(shown, silhouettes, strict=True)
    ]  # fmt: skip


SCENE = wall()
CAMERAS = cameras()
LEFT = SCENE.means[:, 0] < 0
WIDER = SCENE.means[:, 0] < 0.4
NARROWER = SCENE.means[:, 0] < -0.4


def logits_of(masks, confidence=4.0):
    return [np.where(mask, confidence, -confidence).astype(np.float32) for mask in masks]


def fuse(silhouettes, logits):
    return fuse_with_silhouettes(views_of(CAMERAS, silhouettes), logits, SCENE)


@pytest.mark.parametrize("truth", [WIDER, NARROWER], ids=["adds", "removes"])
def test_sure_masks_that_agree_from_view_to_view_are_followed(truth):
    silhouettes, right = masks_of(LEFT, CAMERAS), masks_of(truth, CAMERAS)
    fused = fuse(silhouettes, logits_of(right))
    assert min(toy.jaccard(mask, truth) for mask, truth in zip(fused, right, strict=True)) > 0.97


@pytest.mark.parametrize("wrong", [WIDER, NARROWER], ids=["adds", "removes"])
def test_a_mask_that_the_other_views_contradict_is_not(wrong):
    silhouettes = masks_of(LEFT, CAMERAS)
    masks = [masks_of(wrong, CAMERAS)[0], *silhouettes[1:]]
    fused = fuse(silhouettes, logits_of(masks, 2.0))
    for mask, silhouette in zip(fused, silhouettes, strict=True):
        assert toy.jaccard(mask, silhouette) > 0.97


def test_unsure_masks_are_not_followed():
    silhouettes = masks_of(LEFT, CAMERAS)
    masks = [*masks_of(WIDER, CAMERAS)[:2], *silhouettes[2:]]
    fused = fuse(silhouettes, logits_of(masks, 0.1))
    assert all(toy.jaccard(mask, silhouette) > 0.97 for mask, silhouette in zip(fused, silhouettes, strict=True))


@pytest.mark.parametrize(("half_width", "stays"), [(0.008, True), (0.1, False)], ids=["rod", "bar"])
def test_what_is_too_thin_for_masks_is_not_removed_by_them(half_width, stays):
    """Half of the wall with a rod, or a wide bar, to its right, which no mask shows."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(0.0, 0.8, 0.01), np.arange(-half_width, half_width, 0.008)))
    n = len(x)
    bar = Gaussians.from_arrays(
        np.stack([x, y, np.zeros(n)], -1), np.tile([1.0, 0, 0, 0], (n, 1)), np.zeros((n, 1, 3)),
        scales=np.full((n, 3), 0.006), opacities=np.full(n, 0.95),
    )  # fmt: skip
    scene, shown = concatenate([SCENE.select(LEFT), bar]), cameras(size=512)
    wall_alone = np.arange(len(scene)) < np.count_nonzero(LEFT)
    silhouettes, masks = masks_of(np.ones(len(scene), np.bool_), shown, scene), masks_of(wall_alone, shown, scene)
    fused = fuse_with_silhouettes(views_of(shown, silhouettes), logits_of(masks), scene)
    for mask, silhouette, without in zip(fused, silhouettes, masks, strict=True):
        beside = silhouette & ~without
        assert np.count_nonzero(beside) > 30
        assert (mask[beside].mean() > 0.9) if stays else (mask[beside].mean() < 0.05)


def test_masks_of_something_else_are_set_aside_and_say_nothing_to_the_others():
    silhouettes = masks_of(LEFT, CAMERAS)
    fused = fuse(silhouettes, logits_of([~silhouettes[0], *silhouettes[1:]], 9.0))
    for mask, silhouette in zip(fused, silhouettes, strict=True):
        np.testing.assert_array_equal(mask, silhouette)


def test_equal_masks_change_nothing_and_inputs_are_left_alone():
    silhouettes = masks_of(LEFT, CAMERAS)
    logits = logits_of(silhouettes)
    before = [mask.copy() for mask in silhouettes], [logit.copy() for logit in logits]
    fused = fuse(silhouettes, logits)
    for arrays, kept in zip((silhouettes, logits), before, strict=True):
        for array, copy in zip(arrays, kept, strict=True):
            np.testing.assert_array_equal(array, copy)
    for mask, silhouette in zip(fused, silhouettes, strict=True):
        np.testing.assert_array_equal(mask, silhouette)
