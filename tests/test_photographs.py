"""Photographs shown to a segmenter: the right pixels of the right picture, and what cannot be used."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from gaussian_trimmer.cameras import Camera, intrinsics
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.rendering import Rendering
from gaussian_trimmer.segmentation.segmenters.photographs import PhotoSegmenter, cameras_with_photos, photo_of
from gaussian_trimmer.segmentation.segmenters.silhouette import SilhouetteSegmenter
from gaussian_trimmer.views import View

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


@pytest.mark.parametrize("side", [16, 32, 60])
@pytest.mark.parametrize("factor", [1, 2])
def test_crops_are_in_place_also_in_photographs_of_other_sizes(folder, side, factor):
    write(folder / "a" / "IMG_1.png", gradient(factor * WIDTH, factor * HEIGHT))
    shown = photo_of(crop(20, 10, side), CAMERA, folder)
    centres = (np.arange(64) + 0.5) / 64 * side
    np.testing.assert_allclose(shown[32, :, 0], (20 + centres) / WIDTH, atol=0.006)
    np.testing.assert_allclose(shown[:, 32, 1], (10 + centres) / HEIGHT, atol=0.006)


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
    view = View(crop(20, 10, 32), Rendering(np.zeros((64, 64, 3), np.float32), blank + 1, blank + 3), blank, blank, prior, (0, 0, 64, 64))  # fmt: skip  # noqa: E501
    segmenter = PhotoSegmenter(Watching(), folder, [CAMERA])
    segmenter.segment([view])
    np.testing.assert_array_equal(seen[0].rgb, photo_of(view.camera, CAMERA, folder))
    assert seen[0].object_prior is prior
    assert (seen[0].depth == 3).all()
    assert "photographs" in segmenter.describe()
    assert segmenter.mask_source == "photographs"
    assert PhotoSegmenter(SilhouetteSegmenter(), folder, [CAMERA]).mask_source == "labels"
    with pytest.raises(InputError, match="of no training camera"):
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
    for content in (b"", b"no picture", path.read_bytes()[:60]):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"IMG_1\.png"):
            photo_of(CAMERA, CAMERA, folder)
    path.unlink()
    with pytest.raises(InputError, match="no photograph of the camera"):
        photo_of(CAMERA, CAMERA, folder)
