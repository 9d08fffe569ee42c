"""`gaussian-trimmer evaluate removal` on the ball and its floor, whose picture without the ball is known."""

import csv

import numpy as np
import pytest
import toy
from command_line import run
from dataset_layouts import save_capture, write

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.evaluation.ground_truth import views_in
from gaussian_trimmer.evaluation.metrics import likeness, similarity_map
from gaussian_trimmer.rendering import render
from gaussian_trimmer.views.view import grown

NAMES = ["IMG_1.png", "IMG_2.png", "IMG_3.png"]
SIZE = 96


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The scene, its floor alone, and of each view the ball's mask and the pictures with and without it."""
    monkeypatch.chdir(tmp_path)
    masks, pictures = save_capture(tmp_path, NAMES)
    scene, truth = toy.ball_on_floor()
    floor = scene.select(~truth)
    formats.write(floor, tmp_path / "floor.ply")
    for camera in read_camera_set(tmp_path).cameras:
        picture = render(floor, camera).rgb[..., ::-1]
        write(tmp_path / "without" / camera.name, np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8))
        write(tmp_path / "masks" / camera.name, masks[camera.name])
        write(tmp_path / "images" / camera.name, pictures[camera.name])
    return tmp_path


def evaluate(*arguments):
    given = [] if "--masks" in arguments else ["--masks", "masks"]
    given += ["--without", "without", "--cameras", "cameras.json"]
    return run("evaluate", "removal", *given, *arguments)


def rows_of(path):
    with path.open() as file:
        return {row["view"]: row for row in csv.DictReader(file)}


def test_a_perfect_background_is_told_from_the_scene_with_the_object(folder, capsys):
    (folder / "trimmed").mkdir()
    formats.write(formats.read("floor.ply"), folder / "trimmed" / "background.ply")
    assert evaluate("trimmed", "--images", "images", "--output", "perfect") == 0
    assert evaluate("scene.ply", "--output", "untouched") == 0
    said = capsys.readouterr().out
    assert "grown by 6\n" in said and "to ignore" not in said
    assert evaluate("floor.ply", "--ignore", "masks") == 0
    assert "grown by 6, where no mask to ignore exceeds 0.1" in capsys.readouterr().out
    assert {path.name for path in (folder / "perfect").iterdir()} >= {"removal.md", "removal.csv", "removal.json"}
    perfect, untouched = (rows_of(folder / name / "removal.csv") for name in ("perfect", "untouched"))
    assert list(perfect) == [*NAMES, "mean"]
    assert float(perfect["mean"]["PSNR (dB)"]) > 50 and float(perfect["mean"]["SSIM"]) > 0.99
    assert float(untouched["mean"]["PSNR (dB)"]) < 20 and float(untouched["mean"]["SSIM"]) < 0.7
    painted = float(perfect["mean"]["inpainting, PSNR (dB)"])
    assert float(untouched["mean"]["PSNR (dB)"]) < painted < 40
    assert "inpainting, SSIM" not in untouched["mean"]  # nothing to paint over
    views = [float(untouched[name]["PSNR (dB)"]) for name in NAMES]
    assert float(untouched["mean"]["PSNR (dB)"]) == pytest.approx(np.mean(views), abs=1e-3)


def test_masks_are_grown_and_pixels_of_other_objects_left_out(folder):
    square, other = np.zeros((SIZE, SIZE), np.uint8), np.zeros((SIZE, SIZE), np.uint8)
    square[40:60, 40:60] = 200
    other[:, 50:] = 30  # faint, as at the edge of an object
    for name in NAMES:
        write(folder / "square" / name, square)
        write(folder / "other" / name, other)
        if name != "IMG_3.png":  # a view in which the other object is not
            write(folder / "some" / name, other)

    def pixels(name, *arguments):
        assert evaluate("floor.ply", "--output", name, "--masks", "square", *arguments) == 0
        rows = rows_of(folder / name / "removal.csv")
        return [int(rows[view]["pixels"]) for view in NAMES]

    assert pixels("exact", "--grow", 0) == [400] * 3
    assert pixels("one", "--grow", 1) == [20 * 20 + 4 * 20] * 3  # without the corners
    assert 32 * 32 - 4 * 36 < pixels("six")[0] < 32 * 32
    assert pixels("left", "--grow", 0, "--ignore", "other", "some") == [200] * 3
    assert pixels("some_left", "--grow", 0, "--ignore", "some") == [200, 200, 400]


def test_only_the_pixels_that_count_are_compared(folder):
    cameras = read_camera_set(folder).cameras
    _, views = views_in(cameras, folder / "masks", folder / "without")
    for view in views:
        picture, counted = view.image.copy(), grown(view.coverage > 0.5, 3)
        picture[~counted] = 0.5
        assert likeness(picture, view.image, counted)[0] == 100
        picture[counted] += 0.1 * (picture[counted] < 0.5) - 0.1 * (picture[counted] >= 0.5)
        assert likeness(picture, view.image, counted)[0] == pytest.approx(20, abs=1e-3)


def test_a_view_in_which_others_hide_the_object_does_not_count(folder):
    for name in NAMES:
        write(folder / "other" / name, np.full((SIZE, SIZE), 255 if name == NAMES[0] else 0, np.uint8))
    assert evaluate("floor.ply", "--ignore", "other", "--output", "out") == 0
    rows = rows_of(folder / "out" / "removal.csv")
    assert rows[NAMES[0]]["pixels"] == "0" and rows[NAMES[0]]["PSNR (dB)"] == ""
    views = [float(rows[name]["PSNR (dB)"]) for name in NAMES[1:]]
    assert float(rows["mean"]["PSNR (dB)"]) == pytest.approx(np.mean(views), abs=1e-3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere.ply"], "nowhere.ply"),
        (["masks"], "'masks' holds no background file"),
        (["floor.ply", "--ignore", "nowhere"], "no folder 'nowhere'"),
        (["floor.ply", "--images", "nowhere"], "no folder 'nowhere'"),
        (["floor.ply", "--images", "few"], "'few' has no picture named like the camera 'IMG_2.png', which has a mask"),
        (["floor.ply", "--ignore", "small"], "different sizes"),
        (["floor.ply", "--masks", "others"], "No mask in 'others'"),
        (["floor.ply", "--masks", "nowhere"], "no folder 'nowhere'"),
        (["floor.ply", "--grow", "-1"], "grow"),
    ],
)
def test_what_cannot_be_used_is_one_sentence(folder, capsys, arguments, message):
    write(folder / "few" / "IMG_1.png", np.zeros((SIZE, SIZE), np.uint8))
    write(folder / "small" / "IMG_1.png", np.zeros((SIZE // 2, SIZE // 2), np.uint8))
    write(folder / "others" / "IMG_9.png", np.zeros((SIZE, SIZE), np.uint8))
    assert evaluate(*arguments) == 2
    error = capsys.readouterr().err
    assert message in error and len(error.splitlines()) == 1


def test_views_count_that_have_both_a_picture_and_a_mask(folder, capsys):
    (folder / "masks" / "IMG_1.png").unlink()
    (folder / "without" / "IMG_3.png").unlink()
    assert evaluate("floor.ply") == 0
    assert "views: 1, those of 3 cameras" in capsys.readouterr().out


def test_structural_similarity_has_known_values():
    rng = np.random.default_rng(0)
    a, b = rng.uniform(0, 1, (2, 31, 31, 3))
    assert similarity_map(a, a) == pytest.approx(np.ones((31, 31)))
    flat = similarity_map(np.full((9, 9, 3), 0.2), np.full((9, 9, 3), 0.6))
    assert flat == pytest.approx(np.full((9, 9), (2 * 0.12 + 1e-4) / (0.04 + 0.36 + 1e-4)))
    assert (similarity_map(a, b) == pytest.approx(similarity_map(b, a))) and similarity_map(a, b).max() < 1
    with pytest.raises(ValueError, match="shapes"):
        similarity_map(a, b[1:])
