"""A benchmark scene written by the test, opened again."""

import json

import cv2
import numpy as np
import pytest
from toy import gaussians

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.datasets import open_scene
from gaussian_trimmer.formats import write

HEIGHT, WIDTH = 6, 8
COVERAGE = np.zeros((HEIGHT, WIDTH), np.uint8)
COVERAGE[2:5, 1:4] = 255
COVERAGE[1, 1:4] = 51
OTHER = np.zeros((HEIGHT, WIDTH), np.uint8)
OTHER[:, 6:] = 255
OTHER[:, 5] = 100


def frame(file, split, **more):
    K = [[10.0, 0, 4], [0, 11.0, 3], [0, 0, 1]]
    pose = np.eye(4)
    pose[2, 3] = 5 + len(file)
    size = {"width": WIDTH, "height": HEIGHT}
    return {"file": file, "split": split, **size, "K": K, "world_to_camera": pose.tolist(), **more}


@pytest.fixture
def folder(tmp_path):
    """Two objects, two training views, and two test views, of which one is far."""
    folder = tmp_path / "kitchen"
    for name, mask in {"cup": COVERAGE, "ant": OTHER}.items():
        (folder / "masks" / name).mkdir(parents=True)
        (folder / "coarse" / name).mkdir(parents=True)
        for view in ("a.png", "far.png"):
            cv2.imwrite(str(folder / "masks" / name / view), mask)
    (folder / "images").mkdir()
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[..., 2] = 255  # red, in OpenCV's order
    for view in ("a.png", "far.png"):
        cv2.imwrite(str(folder / "images" / view), image)
    write(gaussians(np.eye(3), (0.1,) * 3, (0.5,) * 3), folder / "scene.ply")
    for kind in ("exact", "dilated"):
        np.save(folder / "coarse" / "cup" / f"{kind}.npy", np.array([True, False, kind == "dilated"]))
    frames = [frame("t1.png", "train"), frame("t2.png", "train"), frame("a.png", "test"),
              frame("far.png", "test", kind="far")]  # fmt: skip
    (folder / "cameras.json").write_text(json.dumps({"up": [0, 0, 2.0], "frames": frames}))
    return folder


def test_a_scene_is_opened_with_its_cameras(folder):
    scene = open_scene(folder)
    assert scene.name == "kitchen"
    assert len(scene.gaussians) == 3
    np.testing.assert_array_equal(scene.up, [0, 0, 2])
    assert [camera.name for camera in scene.training_cameras] == ["t1.png", "t2.png"]
    assert [(camera.name, far) for camera, far in scene.test_frames] == [("a.png", False), ("far.png", True)]
    camera = scene.test_frames[0][0]
    assert (camera.width, camera.height) == (WIDTH, HEIGHT)
    np.testing.assert_array_equal(camera.K, [[10, 0, 4], [0, 11, 3], [0, 0, 1]])
    np.testing.assert_array_equal(camera.world_to_camera[:3, 3], [0, 0, 10])


def test_objects_and_coarse_selections_are_listed_by_name(folder):
    scene = open_scene(folder)
    assert scene.objects == ["ant", "cup"]
    assert scene.coarse_kinds("cup") == ["dilated", "exact"]
    assert scene.coarse_kinds("ant") == []
    assert scene.coarse("cup", "dilated").tolist() == [True, False, True]


def test_test_views_carry_picture_coverage_and_what_others_hide(folder):
    views = list(open_scene(folder).test_views("cup"))
    assert [view.far for view in views] == [False, True]
    np.testing.assert_array_equal(views[0].image, np.broadcast_to([1.0, 0, 0], (HEIGHT, WIDTH, 3)))
    np.testing.assert_allclose(views[0].coverage, COVERAGE / 255, rtol=1e-6)
    assert views[0].coverage[1, 1] == pytest.approx(0.2)
    np.testing.assert_array_equal(views[0].valid, OTHER <= 127)
    np.testing.assert_array_equal(next(open_scene(folder).test_views("ant")).valid, COVERAGE <= 127)


def test_a_scene_may_have_no_up_vector(folder):
    listing = json.loads((folder / "cameras.json").read_text())
    for up in ({"up": None}, {}):
        (folder / "cameras.json").write_text(json.dumps({"frames": listing["frames"], **up}))
        assert open_scene(folder).up is None


@pytest.mark.parametrize("missing", ["cameras.json", "scene.ply"])
def test_folders_that_lack_a_file_are_refused(folder, missing):
    (folder / missing).unlink()
    with pytest.raises(InputError, match=missing):
        open_scene(folder)


@pytest.mark.parametrize("broken", ["images/a.png", "masks/cup/a.png"])
def test_pictures_that_cannot_be_read_are_refused(folder, broken):
    (folder / broken).write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"a\.png"):
        list(open_scene(folder).test_views("cup"))


def test_coarse_selections_are_never_unpickled(folder):
    np.save(folder / "coarse" / "cup" / "evil.npy", np.array([{"a": 1}], dtype=object))
    with pytest.raises(ValueError, match="allow_pickle"):
        open_scene(folder).coarse("cup", "evil")
