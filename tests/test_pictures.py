"""Pictures of views, and of the object before and after."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import toy

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.output.pictures import cameras_around, draw_before_after, draw_view, write_picture
from gaussian_trimmer.output.report import checked_sides, middle_degree
from gaussian_trimmer.rendering import Rendering
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.views.view import TrimmedView, View
from gaussian_trimmer.views.virtual_cameras import PlanConfig

SIZE = 96
CAMERA = Camera(
    look_at(np.array([0.0, 0, -4]), np.zeros(3), np.array([0.0, -1, 0])), intrinsics(1.0, SIZE, SIZE), SIZE, SIZE
)


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


def test_what_stands_before_the_object_is_told():
    free = view(square(30, 60), square(30, 60))
    behind = replace(free, view=replace(free.view, hidden=square(30, 50)))
    assert behind.view.hidden_share == pytest.approx(4 / 9)
    assert not np.array_equal(draw_view(free, 0)[SIZE:], draw_view(behind, 0)[SIZE:])


def test_long_reasons_are_made_to_fit():
    lines = draw_view(view(square(30, 60), square(30, 60), "the mask is " + 20 * "very " + "small"), 0)[SIZE:]
    ink = lines.max(axis=2) > 60
    assert ink.any()
    assert not ink[:, -3:].any()


CELL, STEP = 320, 324


def frames(picture):
    """Which of the six columns of the first row of pictures are framed in red."""
    line = picture[54].astype(int)  # the second line of the first picture, below two lines of words
    return [bool(line[STEP * i + 100, 2] - line[STEP * i + 100, 0] > 100) for i in range(6)]


def test_before_after_shows_the_object_from_all_around():
    scene, truth = toy.ball_on_floor()
    picture = draw_before_after(trim(scene, toy.dilated(scene, truth), config=toy.small_config(), views=12))
    assert picture.shape[1] == 6 * CELL + 5 * 4
    red = (picture[..., 2].astype(int) - picture[..., 0]) > 60
    for i in range(6):
        before, after, without = np.split(red[26:-26, STEP * i : STEP * i + CELL], 3)
        assert min(before.sum(), after.sum()) > 10_000 > 10 * without.sum()
    assert frames(picture) == [False] * 6
    rows = np.flatnonzero(red[52:372, STEP * 4 : STEP * 4 + CELL].any(axis=1))
    assert rows[0] > 0 and rows[-1] < 319, "the low view cuts the object off"


def test_the_scene_goes_on_behind_the_object_and_a_wall_before_it_is_left_out():
    scene, truth = toy.ball_on_floor(n_floaters=0)
    across, heights = np.meshgrid(np.linspace(-12, 12, 60), np.linspace(-4, 12, 40))
    far, near = (np.stack([np.full(across.shape, x), across, heights], -1).reshape(-1, 3) for x in (-9, 1.6))
    green = toy.gaussians(far, 0.3, (0.1, 0.9, 0.1), 0.95)
    violet = toy.gaussians(near, 0.3, (0.8, 0.1, 0.9), 0.95)
    room = concatenate([scene, green, violet])
    result = trim(room, np.append(truth, np.zeros(len(room) - len(scene), np.bool_)), config=toy.small_config(), up="z")
    last_row = draw_before_after(result)[-26 - CELL : -26].astype(int)
    opposite = [last_row[:, STEP * i : STEP * i + CELL] for i in range(4)]
    shares = [np.mean((cell[..., 1] > 120) & (cell[..., 0] < 90) & (cell[..., 2] < 90)) for cell in opposite]
    assert max(shares) > 0.15, "neither is the far wall shown nor the near one cut away"


def test_thin_ends_of_the_object_are_within_the_picture():
    scene, truth = toy.ball_on_floor()
    heights = np.linspace(1, 3, 12)[:, None]
    mast = toy.gaussians(toy.CENTRE + heights * toy.UP, (0.03, 0.03, 0.09), (0.8, 0.1, 0.1), 0.95)
    result = trim(concatenate([scene, mast]), np.append(truth, np.ones(12, np.bool_)), config=toy.small_config())
    (part,) = result.objects
    assert result.object.means[:, 2].max() > part.bounds.centre[2] + 1.5 * part.bounds.half_extents[2]
    first = middle_degree(checked_sides(part, result.cameras)[0])
    yaws, cameras = cameras_around(part, result.scene.select(part.selected_rows), first, 4, 100, (4, 65))
    assert len(cameras) == len(yaws) + 2
    for camera in cameras:
        pixels, _ = camera.project(result.object.means.astype(np.float64))
        assert pixels.min() > 0 and pixels.max() < 100


def test_before_after_frames_the_directions_that_were_not_judged():
    scene, truth = toy.ball_on_floor()
    config = toy.small_config(plan=PlanConfig(size=160, yaw_range_degrees=(20, 100)))
    result = trim(scene, truth, config=config)
    assert frames(draw_before_after(result)) == [False, True, True, True, False, False]


def test_written_picture_is_read_back_and_failure_is_one_sentence(tmp_path):
    picture = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    write_picture(picture, tmp_path / "a.png")
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "a.png")), picture)
    with pytest.raises(InputError, match="Cannot write"):
        write_picture(picture, tmp_path / "nowhere" / "a.png")
