"""Photographs shown to a segmenter: the right pixels of the right picture, and what cannot be used."""

import tracemalloc
from dataclasses import replace

import cv2
import numpy as np
import pytest
from PIL import Image

from gaussian_trimmer.cameras import Camera, intrinsics
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.masks.photographs import PhotoSegmenter, cameras_with_photos, photo_of
from gaussian_trimmer.masks.silhouette import SilhouetteSegmenter
from gaussian_trimmer.rendering import Rendering
from gaussian_trimmer.views.view import View

WIDTH, HEIGHT = 120, 90
CAMERA = Camera(np.eye(4), intrinsics(1.0, WIDTH, HEIGHT), WIDTH, HEIGHT, name="a/IMG_1.JPG")


def gradient(width=WIDTH, height=HEIGHT):
    """Red grows to the right, green grows down, blue is half; in [0, 1], at pixel centres."""
    x, y = (np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height
    return np.stack([*np.meshgrid(x, y), np.full((height, width), 0.5)], -1)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "a").mkdir()
    write(tmp_path / "a" / "IMG_1.png", gradient())
    return tmp_path


def write(path, rgb):
    cv2.imwrite(str(path), np.round(255 * rgb[..., ::-1]).astype(np.uint8))


def crop(x0, y0, side, size=64):
    scale = size / side
    matrix = np.array([[scale, 0, -x0 * scale], [0, scale, -y0 * scale], [0, 0, 1]])
    return replace(CAMERA, K=matrix @ CAMERA.K, width=size, height=size)


def test_the_whole_photograph_is_what_its_camera_sees(folder):
    np.testing.assert_allclose(photo_of(CAMERA, CAMERA, folder), gradient(), atol=0.003)


@pytest.mark.parametrize(("side", "factor"), [(16, 1), (60, 1), (16, 2), (32, 2), (60, 24)])
def test_crops_are_in_place_also_in_photographs_of_other_sizes(folder, side, factor):
    write(folder / "a" / "IMG_1.png", gradient(factor * WIDTH, factor * HEIGHT))
    shown = photo_of(crop(20, 10, side), CAMERA, folder)
    centres = (np.arange(64) + 0.5) / 64 * side
    np.testing.assert_allclose(shown[32, :, 0], (20 + centres) / WIDTH, atol=0.006)
    np.testing.assert_allclose(shown[:, 32, 1], (10 + centres) / HEIGHT, atol=0.006)


def test_memory_follows_from_the_pixels_and_not_from_copies_of_them(tmp_path):
    """A scan of one bit a pixel: a kilobyte of file, and 36 MB of colours of 8 bits."""
    width, height = 4000, 3000
    Image.new("1", (width, height)).save(tmp_path / "a.tif", compression="group4")
    small, large = (Camera(np.eye(4), intrinsics(1.0, w, h), w, h, "a") for w, h in ((80, 60), (width, height)))
    tracemalloc.start()
    try:
        assert photo_of(small, small, tmp_path).shape == (60, 80, 3)
        assert photo_of(replace(small, K=large.K), large, tmp_path).shape == (60, 80, 3)
        assert tracemalloc.get_traced_memory()[1] < 8 * width * height
    finally:
        tracemalloc.stop()


def test_beyond_the_edge_it_is_black(folder):
    shown = photo_of(crop(-32, 0, 64), CAMERA, folder)
    assert not shown[:, :30].any()
    assert shown[:, 34:, 2].min() > 0.4


def test_segmenters_see_the_photograph_and_all_else_is_left_as_it_was(folder):
    seen = []

    class Watching:
        name = "watching"

        def segment(self, views):
            seen.extend(views)
            return [np.zeros((64, 64), np.bool_) for _ in views]

    blank = np.zeros((64, 64), np.float32)
    prior = np.random.default_rng(0).random((64, 64)).astype(np.float32)
    picture = Rendering(np.zeros((64, 64, 3), np.float32), blank + 1, blank + 3)
    view = View(crop(20, 10, 32), picture, blank, blank, prior, (0, 0, 64, 64))
    segmenter = PhotoSegmenter(Watching(), folder, [CAMERA])
    segmenter.segment([view])
    np.testing.assert_array_equal(seen[0].rgb, photo_of(view.camera, CAMERA, folder))
    assert seen[0].object_prior is prior
    assert (seen[0].depth == 3).all()
    assert "photographs" in segmenter.describe()
    assert segmenter.mask_source == "photographs"
    assert PhotoSegmenter(SilhouetteSegmenter(), folder, [CAMERA]).mask_source == "labels"
    with pytest.raises(InputError, match="not a training camera"):
        segmenter.segment([replace(view, camera=replace(view.camera, name=""))])


def test_cameras_without_a_photograph_are_left_out_and_none_at_all_is_refused(folder):
    other = replace(CAMERA, name="IMG_2")
    assert cameras_with_photos([other, CAMERA], folder) == [CAMERA]
    with pytest.raises(InputError, match="No picture in"):
        cameras_with_photos([other], folder)
    with pytest.raises(InputError, match="no folder"):
        cameras_with_photos([CAMERA], folder / "nowhere")


def test_photographs_that_cannot_be_used_are_named(folder):
    path = folder / "a" / "IMG_1.png"
    write(path, gradient(WIDTH, WIDTH))
    with pytest.raises(InputError, match="other proportions"):
        photo_of(CAMERA, CAMERA, folder)
    path.unlink()
    with pytest.raises(InputError, match="no photograph of the camera"):
        photo_of(CAMERA, CAMERA, folder)
