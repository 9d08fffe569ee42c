"""A benchmark scene written by the test, opened again, and those that come with the project."""

import json

import cv2
import numpy as np
import pytest
from benchmark_data import OWN, find_scenes, open_scene
from toy import gaussians

from gaussian_trimmer.errors import InputError
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
    size = {"width": WIDTH, "height": HEIGHT}
    return {"file": file, "split": split, **size, "K": K, "world_to_camera": np.eye(4).tolist(), **more}


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
    frames = [frame("t1.png", "train"), frame("t2.png", "train")]
    frames += [frame("a.png", "test"), frame("far.png", "test", kind="far")]
    (folder / "cameras.json").write_text(json.dumps({"up": [0, 0, 2.0], "frames": frames}))
    return folder


def test_a_scene_has_cameras_objects_and_selections(folder):
    scene = open_scene(folder)
    np.testing.assert_array_equal(scene.up, [0, 0, 2])
    assert [camera.name for camera in scene.training_cameras] == ["t1.png", "t2.png"]
    assert [(camera.name, far) for camera, far in scene.test_frames] == [("a.png", False), ("far.png", True)]
    assert scene.objects == ["ant", "cup"] and scene.coarse_kinds("cup") == ["dilated", "exact"]
    assert scene.coarse("cup", "dilated").tolist() == [True, False, True]


def test_both_truths_of_a_view(folder):
    """In scene all pixels count; alone those behind other objects are left out, unless there is an `alone` mask."""
    alone = COVERAGE.copy()
    alone[2:5, 4:7] = 255  # the part that the other object hides
    (folder / "alone" / "cup").mkdir(parents=True)
    cv2.imwrite(str(folder / "alone" / "cup" / "far.png"), alone)
    near, far = open_scene(folder).test_views("cup")
    np.testing.assert_array_equal(near.image, np.broadcast_to([1.0, 0, 0], (HEIGHT, WIDTH, 3)))
    for view in (near, far):
        visible, known = view.in_scene
        np.testing.assert_allclose(visible, COVERAGE / 255, rtol=1e-6)
        assert known.all()
    np.testing.assert_array_equal(near.coverage, near.in_scene[0])
    np.testing.assert_array_equal(near.counted, OTHER <= 25)
    np.testing.assert_array_equal(near.picture_counted, near.counted)
    np.testing.assert_allclose(far.coverage, alone / 255, rtol=1e-6)
    assert far.counted.all()
    np.testing.assert_array_equal(far.picture_counted, alone == COVERAGE)  # elsewhere it shows the other object


def test_selections_may_be_packed_and_must_fit_the_scene(folder):
    wide = np.array([True, True, False])
    np.savez_compressed(folder / "coarse" / "ant.npz", wide=wide, short=wide[:2], numbers=wide.astype(int))
    scene = open_scene(folder)
    assert scene.coarse_kinds("ant") == ["numbers", "short", "wide"]
    np.testing.assert_array_equal(scene.coarse("ant", "wide"), wide)
    for kind in ("short", "numbers"):
        with pytest.raises(InputError, match=r"bool \(3,\) is needed"):
            scene.coarse("ant", kind)
    for name, kind in (("ant", "other"), ("plate", "wide")):
        with pytest.raises(InputError, match=f"no selection '{kind}' of '{name}'"):
            scene.coarse(name, kind)


def test_several_sets_of_objects_may_share_one_scene(folder):
    handles = folder.parent / "handles"
    (handles / "masks" / "handle").mkdir(parents=True)
    (handles / "coarse" / "handle").mkdir(parents=True)
    for view in ("a.png", "far.png"):
        cv2.imwrite(str(handles / "masks" / "handle" / view), COVERAGE)
    (handles / "meta.json").write_text(json.dumps({"scene_folder": "../kitchen"}))
    scene = open_scene(handles)
    assert (scene.name, scene.objects, len(scene.gaussians)) == ("handles", ["handle"], 3)
    view = next(scene.test_views("handle"))
    assert view.counted.all()  # the objects of the other folder are another set
    assert find_scenes(folder.parent) == [handles, folder] and find_scenes(handles) == [handles]
    (handles / "meta.json").write_text(json.dumps({"scene_folder": "../nowhere"}))
    with pytest.raises(InputError, match="nowhere"):
        open_scene(handles)


@pytest.mark.skipif(not OWN.is_dir(), reason="a source distribution comes without benchmark scenes")
def test_the_projects_own_scenes_are_whole():
    assert [folder.name for folder in find_scenes(OWN)] == ["flat", "parts", "tabletop"]
    for folder in find_scenes(OWN):
        scene = open_scene(folder)
        for name in scene.objects:
            kinds = scene.coarse_kinds(name)
            assert kinds == ["centre_vote", "dilated", "eroded", "exact", "three_views", "wobbly"]
            assert all(scene.coarse(name, kind).any() for kind in kinds)
            views = list(scene.test_views(name))
            assert len(views) == 8 and any(view.visible.any() for view in views)
