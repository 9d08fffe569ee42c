"""Pictures of views, and of the object before and after."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import toy

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.output.pictures import close_up, draw_before_after, draw_view, write_picture
from gaussian_trimmer.pipeline import TrimmedView, trim
from gaussian_trimmer.rendering import Rendering, get_renderer
from gaussian_trimmer.views import View

SIZE = 96
CAMERA = Camera(
    look_at(np.array([0.0, 0, -4]), np.zeros(3), np.array([0.0, -1, 0])), intrinsics(1.0, SIZE, SIZE), SIZE, SIZE
)
BOUNDS = Bounds(np.zeros(3), np.eye(3), np.full(3, 0.5))


def square(low, high):
    mask = np.zeros((SIZE, SIZE), np.bool_)
    mask[low:high, low:high] = True
    return mask


def view(mask, coarse, rejected="", camera=CAMERA):
    black, share = np.zeros((SIZE, SIZE, 3), np.float32), coarse.astype(np.float32)
    whole = np.ones((SIZE, SIZE), np.float32)
    seen = View(camera, Rendering(black, whole, whole), share, share, share, (0, 0, SIZE, SIZE))
    return TrimmedView(seen, mask, rejected)


def test_outlines_of_mask_and_coarse_selection_have_colours_of_their_own():
    picture = draw_view(view(square(30, 60), square(20, 80)), 0)
    mask_edge, coarse_edge = picture[45, 30], picture[50, 20]
    assert mask_edge.max() > 200
    assert coarse_edge.max() > 200
    assert np.abs(mask_edge.astype(int) - coarse_edge).max() > 100
    assert picture[45, 45].max() == picture[5, 5].max() == 0


def test_rejected_view_is_framed_and_gives_the_reason():
    good, bad = (draw_view(view(square(30, 60), square(30, 60), reason), 3) for reason in ("", "too small"))
    assert good[0, 40].max() == 0
    assert bad[0, 40, 2] > 200
    assert not np.array_equal(good[-20:], bad[-20:])


def test_long_reasons_are_made_to_fit():
    lines = draw_view(view(square(30, 60), square(30, 60), "the mask is " + 20 * "very " + "small"), 0)[SIZE:]
    ink = lines.max(axis=2) > 60
    assert ink.any()
    assert not ink[:, -3:].any()


def test_close_up_centres_the_mask():
    camera = close_up(view(square(20, 40), square(20, 40)), BOUNDS, 200)
    # The middle of the mask, pixel (30, 30), becomes the middle of the picture.
    middle = CAMERA.ray_directions(np.array([[30.0, 30.0]]))
    pixels, _ = camera.project(camera.centre + middle)
    np.testing.assert_allclose(pixels, [[100, 100]], atol=1e-9)
    assert (camera.width, camera.height) == (200, 200)
    assert camera.K[0, 0] / CAMERA.K[0, 0] == pytest.approx(camera.K[1, 1] / CAMERA.K[1, 1])


@pytest.mark.parametrize("mask", [square(0, 0), square(10, 12)])
def test_close_up_of_a_rejected_mask_shows_the_bounds(mask):
    camera = close_up(view(mask, mask, "rejected"), BOUNDS, 200)
    pixels, _ = camera.project(BOUNDS.corners())
    assert pixels.min() > 0
    assert pixels.max() < 200
    np.testing.assert_allclose((pixels.min(axis=0) + pixels.max(axis=0)) / 2, 100)


def test_close_up_from_inside_the_bounds_keeps_the_image_whole():
    inside = Bounds(CAMERA.centre, np.eye(3), np.ones(3))
    camera = close_up(view(square(0, 0), square(0, 0)), inside, 2 * SIZE)
    corners, _ = camera.project(camera.centre + CAMERA.ray_directions(np.array([[0.0, 0], [SIZE, SIZE]])))
    assert corners.min() > 0
    assert corners.max() < 2 * SIZE


def test_before_after_has_a_column_for_every_view_up_to_five():
    scene, truth = toy.ball_on_floor()
    selection, renderer = toy.dilated(scene, truth), get_renderer("numba")
    config = toy.small_config()
    widths = []
    for n in (2, 7):
        result = trim(scene, selection, config=replace(config, plan=replace(config.plan, views=n)), renderer=renderer)
        picture = draw_before_after(result, selection, renderer)
        widths.append(picture.shape[1])
        cell = 320
        red = (picture[..., 2].astype(int) - picture[..., 0]) > 60
        before, after, without = np.split(red[:, :cell], 3)
        assert min(before.sum(), after.sum()) > 10_000 > 10 * without.sum()
    assert widths == [2 * 320 + 4, 5 * 320 + 4 * 4]


def test_written_picture_is_read_back_and_failure_is_one_sentence(tmp_path):
    picture = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    write_picture(picture, tmp_path / "a.png")
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "a.png")), picture)
    with pytest.raises(InputError, match="Cannot write"):
        write_picture(picture, tmp_path / "nowhere" / "a.png")
