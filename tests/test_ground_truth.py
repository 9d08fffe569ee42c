"""Masks and photographs of held-out views, as people have them."""

import zlib

import cv2
import numpy as np
import pytest

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.ground_truth import (
    at_size,
    find_picture,
    read_mask,
    read_photograph,
    view_of,
    views_in,
)

WIDTH, HEIGHT = 24, 16


def camera(name="IMG_7.JPG", width=WIDTH, height=HEIGHT):
    K = np.array([[20.0, 0, width / 2], [0, 20.0, height / 2], [0, 0, 1]])
    return Camera(np.eye(4), K, width, height, name)


def square(width=WIDTH, height=HEIGHT, value=255):
    mask = np.zeros((height, width), np.uint8)
    mask[height // 4 : height // 2, width // 4 : width // 2] = value
    return mask


@pytest.mark.parametrize(("grey", "coverage"), [(51, 0.2), (255, 1), (1, 1)])
def test_grey_values_are_coverage_and_zeros_and_ones_labels(tmp_path, grey, coverage):
    cv2.imwrite(str(tmp_path / "a.png"), square(value=grey))
    np.testing.assert_allclose(read_mask(tmp_path / "a.png"), coverage * (square() > 0), rtol=1e-6)


def test_a_jpeg_is_cut_at_one_half(tmp_path):
    cv2.imwrite(str(tmp_path / "a.jpg"), square(), [cv2.IMWRITE_JPEG_QUALITY, 30])
    raw = cv2.imread(str(tmp_path / "a.jpg"), cv2.IMREAD_GRAYSCALE)
    assert ((raw > 0) & (raw < 127)).any()  # noise that a threshold of zero would count
    mask = read_mask(tmp_path / "a.jpg")
    assert set(np.unique(mask)) == {0, 1}
    np.testing.assert_array_equal(mask, square() / 255)


def test_a_picture_that_claims_to_be_huge_is_refused_before_it_is_decoded(tmp_path):
    _, data = cv2.imencode(".png", np.zeros((8, 8), np.uint8))
    data[16:24] = np.array([60000, 60000], ">u4").view(np.uint8)
    data[29:33] = np.array([zlib.crc32(data[12:29])], ">u4").view(np.uint8)
    (tmp_path / "a.png").write_bytes(data.tobytes())
    with pytest.raises(InputError, match="60000 x 60000"):
        read_mask(tmp_path / "a.png")


def test_a_mask_of_another_size_brings_the_camera_to_it(tmp_path):
    cv2.imwrite(str(tmp_path / "m.png"), square(2 * WIDTH, 2 * HEIGHT))
    view = view_of(camera(), tmp_path / "m.png")
    assert (view.camera.width, view.camera.height) == (48, 32)
    np.testing.assert_allclose(view.camera.K, [[40, 0, 24], [0, 40, 16], [0, 0, 1]])
    assert view.coverage.shape == (32, 48) and view.counted.all()


def test_a_mask_of_another_shape_is_refused(tmp_path):
    with pytest.raises(InputError, match="another shape"):
        at_size(camera(), 24, 24, tmp_path / "m.png")


def test_photographs_are_brought_to_the_size_of_the_mask(tmp_path):
    cv2.imwrite(str(tmp_path / "m.png"), square())
    picture = np.zeros((2 * HEIGHT, 2 * WIDTH, 3), np.uint8)
    picture[..., 2] = 255  # red, in OpenCV's order
    cv2.imwrite(str(tmp_path / "p.png"), picture)
    view = view_of(camera(), tmp_path / "m.png", tmp_path / "p.png")
    assert view.image.shape == (HEIGHT, WIDTH, 3)
    np.testing.assert_allclose(view.image[3, 3], [1, 0, 0])
    with pytest.raises(InputError, match="must show the same"):
        read_photograph(tmp_path / "p.png", 24, 24)


def test_masks_bind_to_cameras_by_name_and_ignored_pixels_do_not_count(tmp_path):
    for folder in ("masks", "others"):
        (tmp_path / folder).mkdir()
    cv2.imwrite(str(tmp_path / "masks" / "IMG_7.png"), square())
    other = np.zeros((HEIGHT, WIDTH), np.uint8)
    other[:, :5], other[:, 5:9] = 26, 25  # 0.1 of 255 lies between
    cv2.imwrite(str(tmp_path / "others" / "IMG_7.png"), other)
    cameras = [camera("IMG_1.JPG"), camera(), camera("IMG_9.JPG")]
    found, views = views_in(cameras, tmp_path / "masks", ignored=[tmp_path / "others"])
    assert [c.name for c in found] == ["IMG_7.JPG"]
    np.testing.assert_array_equal(next(views).counted, other < 26)
    cv2.imwrite(str(tmp_path / "others" / "IMG_7.png"), other[:-1])
    _, views = views_in([camera()], tmp_path / "masks", ignored=[tmp_path / "others"])
    with pytest.raises(InputError, match="different sizes"):
        next(views)


def test_a_photograph_that_is_missing_is_named(tmp_path):
    with pytest.raises(InputError, match=r"IMG_7\.JPG"):
        find_picture(tmp_path, camera())
    cv2.imwrite(str(tmp_path / "IMG_7.png"), square())
    assert find_picture(tmp_path, camera()).name == "IMG_7.png"
    with pytest.raises(InputError, match="no folder"):
        views_in([camera()], tmp_path, images=tmp_path / "nowhere")
