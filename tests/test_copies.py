"""A scene with every Gaussian several times, which draws the same picture, is found and selected in as it was."""

import made_room as room
import numpy as np
import pytest
import toy

from gaussian_trimmer.cameras import Viewpoint
from gaussian_trimmer.finding.find import find_objects
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.geometry.copies import distinct_gaussians
from gaussian_trimmer.selecting.marks import Click, Grow
from gaussian_trimmer.selecting.select import select

UP = (0.0, 0.0, 1.0)
VIEW = Viewpoint(toy.camera_at((1, -2.2, 1.8), (1, 1, 0.4), 240))


def copied(scene, times, shift=0.0):
    """Each Gaussian several times, as opaque as it is together, shifted by some of its thickness."""
    rows = np.repeat(np.arange(len(scene)), times)
    logits = scene.opacity_logits[rows].astype(np.float64)
    opacity = 1 - (1 - 1 / (1 + np.exp(-logits))) ** (1 / times)
    thickness = np.exp(scene.log_scales[rows].min(axis=1, keepdims=True))
    means = scene.means[rows] + shift * thickness * np.random.default_rng(1).normal(size=(len(rows), 3))
    logits = np.log(opacity / (1 - opacity)).astype(np.float32)
    return scene.select(rows).replace(means=means.astype(np.float32), opacity_logits=logits), rows


@pytest.fixture(scope="module")
def furnished():
    """A floor with two things, no Gaussian of which has quite the shape of another, as after training."""
    boxes = room.box((-1, -1), (0.9, 0.9, 0.8), room.RED, 1), room.box((1, 1), (0.6, 0.6, 0.5), room.BLUE, 5)
    scene = concatenate([room.floor(), *boxes])
    noise = np.random.default_rng(0).normal(scale=0.01, size=(len(scene), 3))
    return scene.replace(log_scales=(scene.log_scales + noise).astype(np.float32))


def test_copies_count_as_one_in_their_middle_that_is_as_opaque_as_they_are_together(furnished):
    four, rows = copied(furnished, 4, 0.2)
    distinct = distinct_gaussians(four)
    assert np.array_equal(distinct.of, rows) and np.array_equal(rows[distinct.rows], np.arange(len(furnished)))
    assert np.allclose(distinct.gaussians.opacity_logits, furnished.opacity_logits, atol=1e-3)
    off = np.linalg.norm(distinct.gaussians.means - furnished.means, axis=1)
    assert (off < 0.5 * np.exp(furnished.log_scales.min(axis=1))).all()


def test_a_scene_without_copies_is_left_as_it_is(furnished):
    assert distinct_gaussians(furnished).gaussians is furnished
    far = concatenate([furnished, furnished.replace(means=furnished.means + np.float32([0, 0, 9]))])
    assert distinct_gaussians(far).gaussians is far


@pytest.mark.parametrize("times", [2, 4])
def test_objects_and_clicks_are_the_same_with_every_gaussian_several_times(furnished, times):
    many, rows = copied(furnished, times)
    once, found = (find_objects(scene, up=UP) for scene in (furnished, many))
    assert [one.sure for one in once] == [one.sure for one in found] and sum(one.sure for one in once) == 2
    assert np.array_equal(found.labels, once.labels[rows]) and found.surface is not None
    assert [one.gaussians for one in found] == [times * one.gaussians for one in once]
    marks = [Click(120, 120, VIEW), Grow(2.0)]
    masks = [select(scene, marks, up=UP).mask for scene in (furnished, many)]
    assert masks[0].any() and np.array_equal(masks[1], masks[0][rows])
