"""Training cameras chosen for their photographs of an object: large, from different sides, cropped to it."""

import numpy as np
import pytest
from toy import gaussians

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.views.photo_views import photo_views, visible_share

BOUNDS = Bounds(np.zeros(3), np.eye(3), np.full(3, 0.5))


def camera(yaw, distance=5.0, name="", target=(0, 0, 0), size=(400, 300)):
    place = distance * np.array([np.cos(yaw), np.sin(yaw), 0.3])
    pose = look_at(place, np.asarray(target, float), np.array([0, 0, 1.0]))
    return Camera(pose, intrinsics(np.radians(60), *size), *size, name=name or f"{np.degrees(yaw):.0f}")


def ring(n=24, **kind):
    return [camera(2 * np.pi * i / n, **kind) for i in range(n)]


def test_views_are_spread_around_the_object():
    chosen = photo_views(ring(), BOUNDS, 4)
    yaws = np.sort([np.arctan2(*c.centre[1::-1]) for c in chosen])
    gaps = np.diff(np.append(yaws, yaws[0] + 2 * np.pi))
    assert len(chosen) == 4
    assert gaps.min() > np.radians(60)


def test_near_views_come_before_far_ones_from_the_same_side():
    near, far = ring(8, distance=3.0), ring(8, distance=9.0, name="far")
    assert all(c.name != "far" for c in photo_views([*far, *near], BOUNDS, 8))


def test_views_that_cut_the_object_off_are_left_out():
    aside = [camera(a, target=(0, 0, 1.9), name="aside") for a in np.linspace(0, 6, 12)]
    assert all(c.name != "aside" for c in photo_views([*aside, *ring(6)], BOUNDS, 12))
    assert photo_views(aside, BOUNDS, 3)  # but where there is nothing better, they are taken


def test_crops_show_the_whole_object_and_fill_the_frame():
    for crop in photo_views(ring(), BOUNDS, 5, size=256, fill=0.75):
        pixels, _ = crop.project(BOUNDS.corners())
        extent = (pixels.max(axis=0) - pixels.min(axis=0)).max()
        assert (crop.width, crop.height) == (256, 256)
        assert pixels.min() > 0 and pixels.max() < 256
        assert extent == pytest.approx(0.75 * 256, rel=1e-6)


def test_small_photographs_are_not_enlarged_without_end():
    (crop,) = photo_views([camera(0, distance=60.0)], BOUNDS, 1, size=512)
    assert crop.K[0, 0] / camera(0).K[0, 0] == pytest.approx(4.0)


def test_without_a_camera_that_sees_it_there_is_no_view():
    behind = look_at(np.array([5.0, 0, 0]), np.array([9.0, 0, 0]), np.array([0, 0, 1.0]))
    assert photo_views([Camera(behind, intrinsics(1.0, 400, 300), 400, 300)], BOUNDS, 3) == []
    assert photo_views([], BOUNDS, 3) == []
    assert photo_views(ring(), BOUNDS, 0) == []


def test_views_in_which_something_hides_the_object_come_last():
    behind = {f"{i}" for i in range(12)}

    def shown(crop):
        return 0.1 if crop.name in behind else 1.0

    cameras = [camera(2 * np.pi * i / 24, name=f"{i}") for i in range(24)]
    assert not behind & {c.name for c in photo_views(cameras, BOUNDS, 5, visible_share=shown)}
    all_hidden = photo_views(cameras[:12], BOUNDS, 5, visible_share=shown)
    assert len(all_hidden) == 5


def test_the_share_of_an_object_that_a_camera_sees():
    ball, fence = np.zeros((1, 3)), np.array([[2.0, 0.0, -0.3]])
    scene = gaussians(np.concatenate([ball, fence]), [[0.3] * 3, [0.05, 3.0, 0.6]], (1, 1, 1), 0.98)
    selection = np.array([True, False])
    before, beside = camera(0.0, target=(0, 0, 0)), camera(np.pi, target=(0, 0, 0))
    assert 0.2 < visible_share(scene, selection, before) < 0.8
    assert visible_share(scene, selection, beside) > 0.98
    away = camera(0.0, target=(10, 10, 0.3))
    assert visible_share(scene, selection, away) == 0.0
