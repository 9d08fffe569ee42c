"""A benchmark scene written by the test, opened again."""

import json

import cv2
import numpy as np
import pytest
from toy import gaussians

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.datasets import find_scenes, open_scene
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


def test_an_alone_mask_is_the_truth_and_every_pixel_counts(folder):
    alone = COVERAGE.copy()
    alone[2:5, 4:7] = 255  # the part that the other object hides
    (folder / "alone" / "cup").mkdir(parents=True)
    cv2.imwrite(str(folder / "alone" / "cup" / "a.png"), alone)
    view, far = open_scene(folder).test_views("cup")
    np.testing.assert_allclose(view.coverage, alone / 255, rtol=1e-6)
    assert view.valid.all()
    np.testing.assert_array_equal(view.picture_valid, alone == COVERAGE)  # elsewhere the picture shows the other object
    np.testing.assert_allclose(far.coverage, COVERAGE / 255, rtol=1e-6)  # this view has no such mask
    np.testing.assert_array_equal(far.valid, OTHER <= 127)
    np.testing.assert_array_equal(far.picture_valid, far.valid)


def test_selections_may_be_packed_in_one_file_for_an_object(folder):
    wide, narrow = np.array([True, True, False]), np.array([False, True, False])
    np.savez_compressed(folder / "coarse" / "ant.npz", wide=wide, narrow=narrow)
    scene = open_scene(folder)
    assert scene.coarse_kinds("ant") == ["narrow", "wide"]
    np.testing.assert_array_equal(scene.coarse("ant", "wide"), wide)
    np.testing.assert_array_equal(scene.coarse("ant", "narrow"), narrow)
    with pytest.raises(InputError, match="'other'"):
        scene.coarse("ant", "other")
    with pytest.raises(InputError, match="'plate'"):
        scene.coarse("plate", "wide")


@pytest.mark.parametrize("wrong", [np.zeros(4, bool), np.zeros(3, np.uint8), np.zeros((3, 1), bool)])
@pytest.mark.parametrize("packed", [False, True])
def test_selections_of_another_shape_or_type_are_refused(folder, wrong, packed):
    if packed:
        np.savez_compressed(folder / "coarse" / "ant.npz", wrong=wrong)
    else:
        np.save(folder / "coarse" / "ant" / "wrong.npy", wrong)
    with pytest.raises(InputError, match=r"bool \(3,\) is needed"):
        open_scene(folder).coarse("ant", "wrong")


def test_packed_selections_cannot_hide_a_huge_array(folder):
    np.savez_compressed(folder / "coarse" / "ant.npz", huge=np.zeros(100_000, bool))
    with pytest.raises(InputError, match="larger than the scene of 3"):
        open_scene(folder).coarse("ant", "huge")


def test_several_sets_of_objects_may_share_one_scene(folder):
    handles = folder.parent / "handles"
    (handles / "masks" / "handle").mkdir(parents=True)
    (handles / "coarse" / "handle").mkdir(parents=True)
    for view in ("a.png", "far.png"):
        cv2.imwrite(str(handles / "masks" / "handle" / view), COVERAGE)
    np.save(handles / "coarse" / "handle" / "exact.npy", np.array([True, False, False]))
    (handles / "meta.json").write_text(json.dumps({"scene_folder": "../kitchen"}))
    scene = open_scene(handles)
    assert (scene.name, scene.objects, len(scene.gaussians)) == ("handles", ["handle"], 3)
    assert scene.cameras_file.samefile(folder / "cameras.json")
    assert [camera.name for camera in scene.training_cameras] == ["t1.png", "t2.png"]
    view = next(scene.test_views("handle"))
    np.testing.assert_array_equal(view.image[0, 0], [1, 0, 0])
    assert view.valid.all()  # the other folder's objects hide nothing here: they are another set
    assert find_scenes(folder.parent) == [handles, folder]
    assert find_scenes(handles) == [handles]


def test_a_shared_scene_that_is_missing_is_named(folder):
    (folder / "meta.json").write_text(json.dumps({"scene_folder": "../nowhere"}))
    with pytest.raises(InputError, match="nowhere"):
        open_scene(folder)
    (folder / "meta.json").write_text(json.dumps({"scene_folder": 3}))
    with pytest.raises(InputError, match="scene_folder"):
        open_scene(folder)
