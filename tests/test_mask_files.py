"""Masks of the user's own, found by the names of the pictures."""

import json

import cv2
import numpy as np
import pytest

from gaussian_trimmer.cameras import Camera, CameraSet, intrinsics
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.masks.mask_files import find_mask, find_masks, ids_of, mask_of, read_masks

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
    edge = np.full((HEIGHT, WIDTH), 127, np.uint8)
    edge[0], edge[1] = 0, 60
    assert cv2.imwrite(str(tmp_path / "b.JPG.png"), edge)
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
    assert [found.name for found, _ in find_masks(cameras, tmp_path)] == ["left/1.png", "2.jpeg"]


def test_object_numbers_are_read_as_they_are(tmp_path):
    save(tmp_path / "a.png", value=7)
    assert set(np.unique(ids_of(camera("a.jpg"), tmp_path / "a.png"))) == {0, 7}
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
        assert set(np.unique(ids_of(camera(f"{name}.png"), tmp_path / f"{name}.png")).tolist()) == ids
    with pytest.raises(InputError, match="grey values of 8 or 16 bits"):
        ids_of(camera("both.png"), tmp_path / "both.png")


def test_mask_of_another_size_is_refused(tmp_path):
    save(tmp_path / "a.png")
    with pytest.raises(InputError, match=r"12 x 8 pixels.*20 x 8"):
        mask_of(camera("a.png", 20), tmp_path / "a.png")


def test_missing_masks_are_refused(tmp_path):
    save(tmp_path / "other.png")
    with pytest.raises(InputError, match=r"No mask in .* such as a.png"):
        find_masks([camera("a.png")], tmp_path)
    save(tmp_path / "mug" / "a.png")
    save(tmp_path / "cup" / "a.png")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"Give the folder of one object, such as '.*cup'\."):
        find_masks([camera("a.png")], tmp_path)
    with pytest.raises(InputError, match=r"no folder"):
        find_masks([camera("a.png")], tmp_path / "nowhere")
    with pytest.raises(InputError, match="need the cameras of their pictures: --cameras"):
        read_masks(tmp_path, None)


def test_two_masks_for_one_picture_are_refused(tmp_path):
    save(tmp_path / "a.png")
    save(tmp_path / "a.jpg")
    with pytest.raises(InputError, match=r"several masks \(a.jpg, a.png\)"):
        find_mask(tmp_path, camera("a.jpg"))


def coloured(mask, colour, behind):
    return np.where(mask[..., None], np.uint8(colour), np.uint8(behind))


MASK = np.zeros((HEIGHT, WIDTH), bool)
MASK[2:6, 4:10] = True
AS_PEOPLE_HAVE_THEM = {
    "0 and 255": ("a.png", MASK * np.uint8(255)),
    "0 and 1": ("a.png", MASK * np.uint8(1)),
    "1 and 2": ("a.png", MASK * np.uint8(1) + np.uint8(1)),
    "0 and 1 in 16 bits": ("a.png", MASK * np.uint16(1)),
    "16 bits": ("a.png", MASK * np.uint16(65535)),
    "alpha": ("a.png", np.dstack([np.full((HEIGHT, WIDTH, 3), 90, np.uint8), MASK * np.uint8(255)])),
    "cut out on black": ("a.png", coloured(MASK, (70, 120, 60), (0, 0, 0))),
    "cut out on white": ("a.png", coloured(MASK, (70, 120, 60), (255, 255, 255))),
    "half as large": ("a.png", MASK[::2, ::2] * np.uint8(255)),
    "twice as large": ("a.png", MASK.repeat(2, 0).repeat(2, 1) * np.uint8(255)),
    "jpg.png": ("a.jpg.png", MASK * np.uint8(255)),
    "mask behind": ("a_mask.png", MASK * np.uint8(255)),
    "mask before": ("mask_a.png", MASK * np.uint8(255)),
    "mask as an ending": ("a.mask.png", MASK * np.uint8(255)),
    "capitals": ("A.PNG", MASK * np.uint8(255)),
    "a folder": ("cam0/a.png", MASK * np.uint8(255)),
}


@pytest.mark.parametrize("name", AS_PEOPLE_HAVE_THEM)
@pytest.mark.parametrize("picture", ["a.jpg", ".\\images\\a.jpg"])
def test_masks_as_people_have_them(tmp_path, name, picture):
    file, pixels = AS_PEOPLE_HAVE_THEM[name]
    (tmp_path / file).parent.mkdir(exist_ok=True)
    assert cv2.imwrite(str(tmp_path / file), pixels)
    ((_, mask),) = read_masks(tmp_path, CameraSet((camera(picture),), None, (True,), False))
    np.testing.assert_array_equal(mask, MASK)


def test_masks_that_a_transforms_json_names(tmp_path):
    save(tmp_path / "other" / "7.png")
    frames = [{"file_path": "a.jpg", "mask_path": "other/7.png"}, {"file_path": "b.jpg", "mask_path": "../c.png"}]
    (tmp_path / "transforms.json").write_text(json.dumps({"frames": [*frames, {"file_path": "c.jpg"}, 3]}))
    found = find_masks([camera(f"{name}.jpg") for name in "abc"], tmp_path / "transforms.json")
    assert [(camera.name, path) for camera, path in found] == [("a.jpg", tmp_path / "other" / "7.png")]


def test_masks_beside_the_pictures_are_those_with_mask_in_their_name(tmp_path):
    save(tmp_path / "a.jpg")
    save(tmp_path / "a_mask.png")
    assert find_mask(tmp_path, camera("a.jpg")) == tmp_path / "a_mask.png"


def test_empty_masks_and_photographs_are_refused(tmp_path):
    cameras = CameraSet((camera("a.png"),), None, (True,), False)
    assert cv2.imwrite(str(tmp_path / "a.png"), np.arange(HEIGHT * WIDTH, dtype=np.uint8).reshape(HEIGHT, WIDTH))
    with pytest.raises(InputError, match="are empty: their largest value is 95"):
        read_masks(tmp_path, cameras)
    photograph = np.random.default_rng(0).integers(20, 200, (HEIGHT, WIDTH, 3), np.uint8)
    assert cv2.imwrite(str(tmp_path / "a.png"), photograph)
    with pytest.raises(InputError, match="not cut out on black or white"):
        read_masks(tmp_path, cameras)


def test_one_mask_for_pictures_of_the_same_name_is_refused(tmp_path):
    save(tmp_path / "a.png")
    with pytest.raises(InputError, match="have one mask in"):
        find_masks([camera("left/a.jpg"), camera("right/a.jpg")], tmp_path)
