"""Silhouettes that move only to where the picture has an edge."""

import numpy as np
import pytest

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.rendering import Rendering
from gaussian_trimmer.segmentation.segmenters import get_segmenter
from gaussian_trimmer.segmentation.segmenters.silhouette import SilhouetteConfig
from gaussian_trimmer.segmentation.supported_changes import supported_silhouette
from gaussian_trimmer.views import View, bounding_box

SIDE = 80
X = np.indices((SIDE, SIDE))[1]
EDGE = 40
"""Column at which the picture changes from red to grey: the object ends there."""


def view(selected, corrected, certainty=0.2, rgb=None):
    """A red object on the left; the selection ends at one column and the corrected labels at another."""
    if rgb is None:
        rgb = np.where((X < EDGE)[..., None], (0.8, 0.1, 0.1), (0.5, 0.5, 0.5)).astype(np.float32)
    visible = (selected > X).astype(np.float32)
    prior = np.where(corrected > X, 0.5 + certainty, 0.5 - certainty).astype(np.float32)
    camera = Camera(np.eye(4), np.array([[80.0, 0, 40], [0, 80, 40], [0, 0, 1]]), SIDE, SIDE)
    picture = Rendering(rgb, np.ones((SIDE, SIDE), np.float32), np.ones((SIDE, SIDE), np.float32))
    return View(camera, picture, visible, visible, prior, bounding_box(visible > 0.5))


def width(mask):
    """Columns that the mask fills; they begin at the left."""
    assert (mask == mask[:1]).all()
    return int(mask[0].sum())


@pytest.mark.parametrize("selected", [32, 48])
def test_the_outline_moves_to_the_edge_from_either_side(selected):
    assert width(supported_silhouette(view(selected, EDGE))) == EDGE


@pytest.mark.parametrize("corrected", [32, 48])
def test_the_outline_stays_on_the_edge_whatever_the_labels_say(corrected):
    assert width(supported_silhouette(view(EDGE, corrected))) == EDGE


def test_without_any_edge_only_certain_labels_are_followed():
    plain = np.full((SIDE, SIDE, 3), 0.5, np.float32)
    assert width(supported_silhouette(view(48, 40, certainty=0.1, rgb=plain))) == 48
    assert width(supported_silhouette(view(48, 40, certainty=0.45, rgb=plain))) == 40


def test_a_piece_of_its_own_is_followed_if_the_labels_are_certain():
    one = view(EDGE, EDGE)
    for certainty, count in ((0.1, 0), (0.4, 100)):
        prior = one.object_prior.copy()
        prior[30:40, 60:70] = 0.5 + certainty
        apart = View(one.camera, one.picture, one.object_alpha, one.object_visible, prior, one.box)
        assert np.count_nonzero(supported_silhouette(apart)[:, EDGE:]) == count


def test_equal_silhouettes_are_kept_without_a_look():
    assert width(supported_silhouette(view(48, 48))) == 48


def test_each_region_is_decided_by_itself():
    one = view(EDGE, EDGE)
    prior = one.object_prior.copy()
    prior[:20, :48] = 0.7  # the labels leave the edge in the upper quarter
    moved = View(one.camera, one.picture, one.object_alpha, one.object_visible, prior, one.box)
    visible = moved.object_visible.copy()
    visible[60:, 32:] = 0  # the selection has not reached it in the lower quarter
    mask = supported_silhouette(View(one.camera, one.picture, one.object_alpha, visible, prior, one.box))
    np.testing.assert_array_equal(mask, X < EDGE)


def test_what_lies_far_from_a_change_has_no_part_in_it():
    one = view(48, EDGE)
    around = [np.pad(image, 40, mode="edge") for image in (one.object_visible, one.object_prior, one.depth)]
    rgb = np.pad(one.rgb, ((40, 40), (40, 40), (0, 0)), mode="edge")
    rgb[:10] = np.random.default_rng(0).uniform(0, 1, rgb[:10].shape)
    around[1][30:40, :80] = 1
    larger = View(one.camera, Rendering(rgb, np.ones_like(around[2]), around[2]), around[0], *around[:2], one.box)
    np.testing.assert_array_equal(supported_silhouette(larger)[60:100, 40:120], supported_silhouette(one)[20:60])


def test_the_default_segmenter_checks_edges_unless_told_otherwise():
    leaving = view(EDGE, 48)
    assert width(get_segmenter("silhouette").segment([leaving])[0]) == EDGE
    assert width(get_segmenter("silhouette", SilhouetteConfig(check_edges=False)).segment([leaving])[0]) == 48
