"""Contours of small masks by hand, and single Gaussians across a straight edge."""

import numpy as np
import pytest
from toy import accepted_view, gaussians

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.trimming.config import BoundaryConfig
from gaussian_trimmer.trimming.straddlers import contour_pixels, find_straddlers, signed_distance

SIZE = 64
UP = np.array([0.0, -1, 0])
CAMERA = Camera(look_at(np.array([0.0, 0, -4]), np.zeros(3), UP), intrinsics(0.9, SIZE, SIZE), SIZE, SIZE)
PIXEL = 4 / CAMERA.K[0, 0]
"""Size of a pixel at the world's origin, in scene units."""
LEFT = np.arange(SIZE)[None].repeat(SIZE, 0) < SIZE // 2
"""The half of the picture in which x < 0: the cut plane is x = 0."""
GREY = (0.5, 0.5, 0.5)


def needle(x=0.0, y=0.0, scales=(0.3, 0.08, 0.08)):
    return gaussians([[x, y, 0]], scales, GREY)


def straddlers(thing, masks=(LEFT,), cameras=(CAMERA,)):
    views = [accepted_view(camera, mask) for camera, mask in zip(cameras, masks, strict=True)]
    return find_straddlers(thing, np.ones(len(thing), np.bool_), views, BoundaryConfig())


def square_mask():
    mask = np.zeros((7, 7), np.bool_)
    mask[2:5, 2:5] = True
    return mask


def as_image(pixels, shape=(7, 7)):
    image = np.zeros(shape, np.bool_)
    image[pixels[:, 1], pixels[:, 0]] = True
    return image


def test_contour_of_a_square_is_a_ring_two_pixels_wide():
    expected = np.zeros((7, 7), np.bool_)
    expected[1:6, 1:6] = True
    expected[3, 3] = False
    np.testing.assert_array_equal(as_image(contour_pixels(square_mask(), 1)), expected)
    np.testing.assert_array_equal(contour_pixels(square_mask(), 2).shape, (49, 2))


@pytest.mark.parametrize("value", [True, False])
def test_the_edge_of_the_image_is_no_contour(value):
    assert contour_pixels(np.full((7, 7), value), 2).shape == (0, 2)


def test_signed_distance_is_half_a_pixel_on_either_side_of_the_contour():
    mask = np.zeros((5, 7), np.bool_)
    mask[:, :3] = True
    np.testing.assert_allclose(signed_distance(mask), np.tile(2.5 - np.arange(7.0), (5, 1)))
    inner = signed_distance(square_mask())
    assert inner[3, 3] == 1.5
    assert inner[0, 0] == pytest.approx(0.5 - np.hypot(2, 2), abs=1e-6)


@pytest.mark.parametrize("x", [-0.12, -0.03, 0.0, 0.08])
@pytest.mark.parametrize("y", [0.0, 0.5])
def test_a_needle_across_the_edge_is_cut_at_the_edge(x, y):
    found = straddlers(needle(x, y))
    assert found.rows.tolist() == [0]
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1)
    np.testing.assert_allclose(found.normals[0], [-1, 0, 0], atol=0.02)
    assert found.offsets[0] == pytest.approx(-x / 0.3, abs=0.05 * PIXEL / 0.3)


def test_a_plane_passes_through_the_camera_and_the_slanted_edge():
    camera = Camera(look_at(np.array([2.0, -1, -3]), np.zeros(3), UP), CAMERA.K, SIZE, SIZE)
    rows, columns = np.mgrid[:SIZE, :SIZE] + 0.5
    slanted = columns + 0.5 * rows < 48
    thing = gaussians([[0.1, 0.02, 0.1]], (0.25, 0.25, 0.25), GREY)
    found = straddlers(thing, [slanted], [camera])
    normal, offset = found.normals[0], found.offsets[0] * 0.25
    assert normal @ (thing.means[0] - camera.centre) == pytest.approx(offset, abs=1e-6)
    on_edge = camera.ray_directions(np.array([[32.0, 32], [30, 36]]))  # two points of x + y / 2 = 48
    assert np.abs(on_edge @ normal).max() < 1 / camera.K[0, 0]
    inside = camera.ray_directions(np.array([[10.0, 20]]))
    assert inside[0] @ normal > 0


@pytest.mark.parametrize(("x", "mask"), [(1.2, LEFT), (-1.2, LEFT), (0, np.ones_like(LEFT)), (0, np.zeros_like(LEFT))])
def test_what_lies_on_one_side_is_no_straddler(x, mask):
    assert len(straddlers(needle(x), [mask]).rows) == 0


def test_only_candidates_straddle():
    pair = concatenate([needle(0.05), needle(0.05, 0.5)])
    views = [accepted_view(CAMERA, LEFT)]
    found = find_straddlers(pair, np.array([False, True]), views, BoundaryConfig())
    assert found.rows.tolist() == [1]


def test_the_view_that_sees_most_of_the_minor_side_cuts():
    off_centre = np.arange(SIZE)[None].repeat(SIZE, 0) < SIZE // 2 - 3
    alone, far = straddlers(needle()), straddlers(needle(), [off_centre])
    assert far.minor_weight[0] < alone.minor_weight[0]
    for masks in ([off_centre, LEFT], [LEFT, off_centre]):
        both = straddlers(needle(), masks, [CAMERA] * 2)
        assert both.rows.tolist() == [0]
        np.testing.assert_allclose(both.offsets, alone.offsets)
        np.testing.assert_allclose(both.minor_weight, alone.minor_weight)
