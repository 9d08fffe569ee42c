"""Layouts of published data sets: what is found, what it is bound to, and what is refused."""

from pathlib import Path

import dataset_layouts
import numpy as np
import pytest
from dataset_layouts import write

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.datasets import LAYOUTS, MaskedPicture, Task, camera_of
from gaussian_trimmer.evaluation.trials import find_files

BLANK = np.zeros((4, 4), np.uint8)
TASK = Task("horns", "horns_left", ())


def find(folder, root=None, **patterns):
    return find_files(TASK, folder, root or folder, patterns)


def cameras(*names):
    return [Camera(np.eye(4), np.eye(3), 4, 4, name) for name in names]


def test_nvos_binds_targets_by_the_names_of_their_masks(tmp_path):
    dataset_layouts.save_nvos(tmp_path / "nvos", tmp_path / "method")
    tasks = {task.name: task for task in LAYOUTS["nvos"].find_tasks(tmp_path / "nvos")}
    assert list(tasks) == ["fern", "horns_center", "horns_left"]
    assert [task.scene for task in tasks.values()] == ["fern", "horns", "horns"]
    (target,) = tasks["horns_center"].pictures
    assert (target.view, target.mask.suffix, target.image.name) == ("DJI_0003", ".jpg", "DJI_0003.png")
    assert tasks["fern"].pictures[0].image is None
    assert camera_of(target, cameras("DJI_0001.png", "DJI_0003.png"), "x").name == "DJI_0003.png"  # not the first


@pytest.mark.parametrize("names", [[], ["a_mask.png", "b_mask.png"]])
def test_an_nvos_task_without_its_target_is_named(tmp_path, names):
    (tmp_path / "masks" / "leaves").mkdir(parents=True)
    for name in names:
        write(tmp_path / "masks" / "leaves" / name, BLANK)
    with pytest.raises(InputError, match=r"leaves.*target masks"):
        LAYOUTS["nvos"].find_tasks(tmp_path)


@pytest.mark.parametrize("names", [["a.png"], ["IMG_1.png", "x/IMG_1.png"]])
def test_a_target_must_have_one_camera_of_its_name(names):
    with pytest.raises(InputError, match="mask of 'IMG_1'"):
        camera_of(MaskedPicture("IMG_1", Path("m.png")), cameras(*names), "x")


def test_lerf_mask_numbers_are_those_of_test_pictures(tmp_path):
    dataset_layouts.save_lerf_mask(tmp_path / "lerf", tmp_path / "method")
    tasks = {task.object: task for task in LAYOUTS["lerf-mask"].find_tasks(tmp_path / "lerf")}
    assert [target.view for target in tasks["red ball"].pictures] == ["frame_00001", "frame_00003"]
    assert [target.view for target in tasks["ball's rim"].pictures] == ["frame_00001"]
    assert tasks["red ball"].name == "figurines/red ball"


def test_lerf_mask_folders_may_be_named_like_pictures(tmp_path):
    write(tmp_path / "ramen" / "images" / "frame_7.jpg", BLANK)
    write(tmp_path / "ramen" / "test_mask" / "frame_7" / "egg.png", BLANK)
    (task,) = LAYOUTS["lerf-mask"].find_tasks(tmp_path)
    assert task.pictures[0].view == "frame_7"
    write(tmp_path / "ramen" / "test_mask" / "3" / "egg.png", BLANK)
    with pytest.raises(InputError, match="belong to no known picture"):  # the training pictures are not known
        LAYOUTS["lerf-mask"].find_tasks(tmp_path)


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_folder_of_another_layout_is_refused(tmp_path, name):
    with pytest.raises(InputError, match="give the folder"):
        LAYOUTS[name].find_tasks(tmp_path)


def touch(folder, *paths):
    for path in paths:
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).touch()


def test_files_are_found_in_the_usual_places(tmp_path):
    touch(
        tmp_path,
        "horns/point_cloud/iteration_7000/point_cloud.ply",
        "horns/point_cloud/iteration_30000/point_cloud.ply",
        "horns/cameras.json",
        "horns/segmentation_res/horns_left.pt",
        "horns/segmentation_res/other.pt",
    )
    found = find(tmp_path)
    assert found["scene"].parent.name == "iteration_30000"
    assert found["selection"].name == "horns_left.pt" and found["cameras"].name == "cameras.json"


def test_a_file_that_tasks_share_is_no_ones_selection(tmp_path):
    touch(tmp_path, "horns/scene.ply", "horns/cameras.json", "horns/selection.npy", "horns/segmentation_res/a.pt")
    with pytest.raises(InputError, match=r"no selection of the task 'horns_left'.*--selections.*--ids"):
        find(tmp_path)
    touch(tmp_path, "horns_left.npy")
    assert find(tmp_path)["selection"] == tmp_path / "horns_left.npy"


def test_patterns_name_other_places(tmp_path):
    method, data = tmp_path / "me[th]od", tmp_path / "data"  # brackets are no pattern here
    touch(method, "models/horns/it.ply", "out/horns_left.npy")
    touch(data, "horns/sparse/0/images.bin")
    selection = str(method / "out").replace("[", "[[]") + "/{object}.npy"
    patterns = {"scene": "models/{scene}/*.ply", "selection": selection}
    found = find(method, data, **patterns)
    assert (found["scene"].name, found["selection"].name) == ("it.ply", "horns_left.npy")
    assert found["cameras"] == data / "horns" / "sparse" / "0"
    touch(method, "models/horns/other.ply")
    with pytest.raises(InputError, match="2 files that may be its scene"):
        find(method, data, **patterns)


def test_a_file_of_several_objects_is_the_selection_of_whose_ids_are_known(tmp_path):
    home = tmp_path / "horns"
    home.mkdir()
    for name in ("classifier.pth", "scene.ply", "cameras.json"):
        (home / name).touch()
    assert find_files(TASK, tmp_path, tmp_path, {}, with_ids=True)["selection"] == home / "classifier.pth"
    with pytest.raises(InputError, match="say with --ids FILE"):
        find(tmp_path)
