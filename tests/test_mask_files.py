"""Masks of the user's own, found by the names of the pictures."""

import cv2
import numpy as np
import pytest

from gaussian_trimmer.cameras import Camera, CameraSet, intrinsics
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.reading import is_file
from gaussian_trimmer.masks import mask_files
from gaussian_trimmer.masks.mask_files import (
    cameras_with_masks,
    find_mask,
    ids_of,
    mask_of,
    read_masks,
)

WIDTH, HEIGHT = 12, 8


def camera(name, width=WIDTH):
    return Camera(np.eye(4), intrinsics(1.0, width, HEIGHT), width, HEIGHT, name)


def save(path, columns=3, value=255):
    path.parent.mkdir(exist_ok=True)
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[:, :columns] = value
    assert cv2.imwrite(str(path), mask)


def test_masks_are_found_by_name_and_cut_at_half(tmp_path):
    save(tmp_path / "a.png", columns=3, value=128)
    save(tmp_path / "b.JPG.png", columns=5, value=127)
    cameras = [camera("a.jpg"), camera("none.jpg"), camera("b.JPG")]
    (at_first, first), (at_second, second) = read_masks(tmp_path, CameraSet(tuple(cameras), None, (True,) * 3, False))
    assert [at_first, at_second] == [cameras[0], cameras[2]]
    assert first[:, :3].all()
    assert not first[:, 3:].any()
    assert not second.any()


def test_pictures_without_a_mask_are_passed_over(tmp_path):
    save(tmp_path / "left" / "1.png")
    save(tmp_path / "2.png")
    cameras = [camera(name) for name in ("left/1.png", "right/1.png", "2.jpeg", "3.png", "")]
    assert [found.name for found in cameras_with_masks(cameras, tmp_path)] == ["left/1.png", "2.jpeg"]


def test_object_numbers_are_read_as_they_are(tmp_path):
    save(tmp_path / "a.png", value=7)
    assert set(np.unique(ids_of(camera("a.jpg"), tmp_path))) == {0, 7}
    deep = np.full((HEIGHT, WIDTH), 40_000, np.uint16)
    colours = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    colours[2:, :] = 3, 2, 1  # blue, green, red
    assert cv2.imwrite(str(tmp_path / "deep.png"), deep)
    assert cv2.imwrite(str(tmp_path / "colours.png"), colours)
    assert cv2.imwrite(str(tmp_path / "clear.png"), np.dstack([colours, np.full((HEIGHT, WIDTH), 9, np.uint8)]))
    assert cv2.imwrite(str(tmp_path / "grey.png"), np.full((HEIGHT, WIDTH, 3), 7, np.uint8))
    assert cv2.imwrite(str(tmp_path / "both.png"), np.dstack([deep] * 3))
    expected = {"deep": {40_000}, "colours": {0, 1 + 2 * 256 + 3 * 65536}, "grey": {7}}
    for name, ids in {**expected, "clear": expected["colours"]}.items():
        assert set(np.unique(ids_of(camera(f"{name}.png"), tmp_path)).tolist()) == ids
    with pytest.raises(InputError, match="grey values of 8 or 16 bits"):
        ids_of(camera("both.png"), tmp_path)


def test_mask_of_another_size_is_refused(tmp_path):
    save(tmp_path / "a.png")
    with pytest.raises(InputError, match=r"12 x 8 pixels.*20 x 8"):
        mask_of(camera("a.png", 20), tmp_path)


def test_missing_masks_are_refused(tmp_path):
    save(tmp_path / "other.png")
    with pytest.raises(InputError, match=r"no mask for the view 'a.png'"):
        mask_of(camera("a.png"), tmp_path)
    with pytest.raises(InputError, match=r"No mask in .* such as a.png"):
        cameras_with_masks([camera("a.png")], tmp_path)
    save(tmp_path / "mug" / "a.png")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"Give the folder of one object, such as '.*mug'\."):
        cameras_with_masks([camera("a.png")], tmp_path)
    with pytest.raises(InputError, match=r"no folder"):
        cameras_with_masks([camera("a.png")], tmp_path / "nowhere")
    with pytest.raises(InputError, match="need the cameras of their pictures: --cameras"):
        read_masks(tmp_path, None)


def test_two_masks_for_one_picture_are_refused(tmp_path):
    save(tmp_path / "a.png")
    save(tmp_path / "a.jpg")
    with pytest.raises(InputError, match=r"several masks \(a.jpg, a.png\)"):
        find_mask(tmp_path, camera("a.jpg"))


def test_masks_of_many_cameras_are_looked_up_in_one_list(tmp_path, monkeypatch):
    save(tmp_path / "7.png")
    looked = []
    monkeypatch.setattr(mask_files, "is_file", lambda path: looked.append(path) or is_file(path))
    found = cameras_with_masks([camera(f"{i}.JPG") for i in range(100)], tmp_path)
    assert [camera.name for camera in found] == ["7.JPG"]
    assert len(looked) == 14
