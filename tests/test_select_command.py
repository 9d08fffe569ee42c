"""Tests of `gaussian-trimmer select` on the command line."""

import json
import re
import shutil

import cv2
import numpy as np
import pytest
import toy
from command_line import SMALL, run, within

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_camera_set


def middle_of(folder, name="0.png", point=toy.CENTRE):
    camera = next(camera for camera in read_camera_set(folder / "cameras.json").cameras if camera.name == name)
    return [int(value) for value in camera.project(np.array([point]))[0][0]]


def test_click_in_a_given_view(ball, tmp_path, capsys):
    folder, _, truth = ball
    command = ["select", folder / "scene.ply", "--cameras", folder / "cameras.json", "--click", *middle_of(folder)]
    for number, view in enumerate((["--view", "0.png"], ["--view", "0"], ["--view-index", 0])):
        output = tmp_path / f"{number}.npy"
        assert run(*command, *view, "--output", output) == 0
        assert toy.jaccard(np.load(output), truth) > 0.9
        printed = capsys.readouterr().out
        assert "stands on a surface" in printed
        lengths = re.search(r"Gaussians, (\S+) x (\S+) x (\S+),", printed).groups()
        assert [float(length) for length in lengths] == pytest.approx([2 * toy.RADIUS] * 3, rel=0.15)
        assert f"gaussian-trimmer trim {folder / 'scene.ply'} {output} --cameras" in printed
        assert f"{number}.png shows it" in printed


def test_a_picture_of_each_marked_view_shows_the_marks_and_what_they_took(ball, tmp_path):
    folder, _, _ = ball
    command = ["select", folder / "scene.ply", "--cameras", folder / "cameras.json", "--output", tmp_path / "a.npy"]
    x, y = middle_of(folder)
    command += ["--view", "0", "--click", x, y, "--view", "2", "--remove-click", *middle_of(folder, "2.png", (1, 1, 0))]
    assert run(*command, "--quiet") == 0
    picture = cv2.imread(str(tmp_path / "a.png")).astype(int)
    camera = read_camera_set(folder / "cameras.json").cameras[0]
    scale = len(picture) / camera.height
    assert picture.shape[1] > 2 * round(scale * camera.width)  # one beside the other
    blue, green, red = picture[round(scale * y), round(scale * x)]
    assert green > blue and green > red  # the mark that adds
    blue, green, red = picture[round(scale * y) + 30, round(scale * x)]
    assert blue > red  # a red ball, tinted


def test_cameras_that_look_away_from_the_scene_are_refused(ball, tmp_path, capsys):
    folder, _, _ = ball
    cameras = []
    for number, camera in enumerate(read_camera_set(folder / "cameras.json").cameras):
        pose = np.linalg.inv(camera.world_to_camera)
        views = {"id": number, "img_name": camera.name, "width": camera.width, "height": camera.height}
        views |= {"fx": camera.K[0, 0], "fy": camera.K[1, 1], "position": pose[:3, 3].tolist()}
        cameras.append(views | {"rotation": (pose[:3, :3] * (1, -1, -1)).tolist()})
    (tmp_path / "opengl.json").write_text(json.dumps(cameras))
    command = ["select", folder / "scene.ply", "--cameras", tmp_path / "opengl.json"]
    for what in (["--list-views", tmp_path / "views"], ["--masks", folder / "masks", "--output", tmp_path / "a.npy"]):
        assert run(*command, *what) == 2
        assert "look away from the scene" in capsys.readouterr().err
    assert not (tmp_path / "views").exists() and not (tmp_path / "a.npy").exists()
    assert run("info", folder / "scene.ply", tmp_path / "opengl.json") == 0
    assert "OpenGL" in capsys.readouterr().out
    assert run("info", folder / "scene.ply", folder / "cameras.json") == 0
    assert "OpenGL" not in capsys.readouterr().out


def test_views_have_the_axes_where_up_is_a_guess(ball, tmp_path):
    _, scene, truth = ball
    formats.write(scene.select(truth), tmp_path / "ball.ply")
    for options in ([], ["--up", "-y"]):
        out = tmp_path / f"views{len(options)}"
        assert run("select", tmp_path / "ball.ply", *options, "--list-views", out, "--quiet") == 0
    guessed, given = (cv2.imread(str(tmp_path / name / "000.png")) for name in ("views0", "views2"))
    lower_left = np.s_[-120:, :120]
    assert (guessed[lower_left] != given[lower_left]).any() and not given[lower_left].any()


def test_a_second_try_replaces_its_own_files_and_no_others(ball, tmp_path, capsys):
    folder, scene, truth = ball
    command = ["select", folder / "scene.ply", "--cameras", folder / "cameras.json", "--view", "0", "--quiet"]
    command += ["--click", *middle_of(folder), "--output"]
    files = [tmp_path / "a.npy", "--trim", tmp_path / "out", *SMALL, "--views", 3]
    assert run(*command, *files) == 0
    assert run(*command, *files, "--intersect", within(tmp_path / "top.npy", scene, (0, 0, 1.6), 0.7)) == 0
    assert np.load(tmp_path / "a.npy").sum() < 0.6 * truth.sum()
    np.save(tmp_path / "a.npy", np.arange(3))  # somebody else's now
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "notes.txt").write_text("mine")
    before = (tmp_path / "out" / "manifest.json").read_bytes()
    for output, said in (
        ([tmp_path / "a.npy"], "a.npy' exists"),
        ([tmp_path / "b.npy", "--trim", tmp_path / "foreign"], "is not empty"),
        ([tmp_path / "b.npy", "--trim", tmp_path / "out"], "is not empty"),
    ):
        assert run(*command, *output) == 2
        assert said in capsys.readouterr().err
    assert len(np.load(tmp_path / "a.npy")) == 3
    assert (tmp_path / "out" / "manifest.json").read_bytes() == before


def test_a_selection_has_its_scenes_name_and_one_of_another_scene_is_kept(ball, tmp_path, monkeypatch, capsys):
    folder, _, _ = ball
    monkeypatch.chdir(tmp_path)
    for name in ("seal", "wolf"):
        shutil.copy(folder / "scene.ply", tmp_path / f"{name}.ply")
    everything = ["--up", 0, 0, 1, "--add", folder / "rough.npy", "--quiet"]
    for name in ("seal", "wolf", "seal"):  # a second try in the same scene replaces the first
        assert run("select", f"{name}.ply", *everything) == 0
    assert {path.name for path in tmp_path.glob("*.npy")} == {"seal_selection.npy", "wolf_selection.npy"}
    before = (tmp_path / "seal_selection.json").read_bytes()
    assert json.loads(before)["scene"] == "seal.ply"
    assert run("select", "wolf.ply", *everything, "--output", "seal_selection.npy") == 2
    error = capsys.readouterr().err
    assert "another scene" in error and "seal.ply" in error and "--overwrite" in error
    assert (tmp_path / "seal_selection.json").read_bytes() == before
    assert run("select", "wolf.ply", *everything, "--output", "seal_selection.npy", "--overwrite") == 0
    assert json.loads((tmp_path / "seal_selection.json").read_bytes())["scene"] == "wolf.ply"


def test_marks_belong_to_the_view_before_them(ball, tmp_path, capsys):
    folder, scene, truth = ball
    floor, behind = middle_of(folder, point=(1.5, 1.5, 0.0)), middle_of(folder, "2.png")
    command = ["select", folder / "scene.ply", "--cameras", folder / "cameras.json", "--output", tmp_path / "a.npy"]
    below = scene.means[:, 2] < 0.1
    np.save(tmp_path / "all.npy", below | truth)
    marks = ["--view", "0", "--click", *floor, "--add", tmp_path / "all.npy", "--view=2", "--remove-click", *behind]
    assert run(*command, *marks) == 0
    selection = np.load(tmp_path / "a.npy")
    assert (selection >= (below & ~truth)).all()
    assert np.mean(selection[truth & ~below]) < 0.1
    document = json.loads((tmp_path / "a.json").read_text())
    assert [mark["mark"] for mark in document["marks"]] == ["click", "file", "click"]
    assert [document["views"][mark["view"]]["name"] for mark in document["marks"] if "view" in mark] == [
        "0.png",
        "2.png",
    ]
    two = ["--view", "0", "--click", *floor, "--view", "2", "--click", *behind]
    assert run(*command, "--click", *floor, *two) == 2
    assert "before the first" in capsys.readouterr().err


def test_files_and_rims(ball, tmp_path, capsys):
    folder, scene, truth = ball
    np.save(tmp_path / "ids.npy", np.where(truth, 3, 5) + 4 * (scene.means[:, 2] > 1))
    command = ["select", folder / "scene.ply", "--up", 0, 0, 1, "--quiet", "--output", tmp_path / "a.npy"]
    height = scene.means[:, 2]
    np.save(tmp_path / "above.npy", height > 0.5)
    options = ["--add", f"{tmp_path / 'ids.npy'}#3,7", "--intersect", tmp_path / "above.npy"]
    assert run(*command, *options) == 0
    assert np.array_equal(np.load(tmp_path / "a.npy"), truth & (height > 0.5))
    assert run(*command, *options, "--subtract", f"{tmp_path / 'ids.npy'}#7") == 0
    kept = truth & (height > 0.5) & (height <= 1)
    assert np.array_equal(np.load(tmp_path / "a.npy"), kept)
    assert run(*command, *options, "--subtract", f"{tmp_path / 'ids.npy'}#7", "--grow", 2) == 0
    grown = np.load(tmp_path / "a.npy")
    assert (grown >= kept).all() and kept.sum() < grown.sum() < truth.sum()
    assert run(*command, "--add", tmp_path / "ids.npy") == 2
    assert "several objects" in capsys.readouterr().err
    assert run(*command, "--shrink", 1) == 2
    assert "nothing is selected before it" in capsys.readouterr().err


def test_trim_takes_marks_on_top_of_a_file(ball, tmp_path):
    folder, scene, truth = ball
    np.save(tmp_path / "rough.npy", toy.dilated(scene, truth))
    out, inside = tmp_path / "out", within(tmp_path / "in.npy", scene, (0, 0, 1), 1.2)
    assert run("trim", folder / "scene.ply", tmp_path / "rough.npy", "--cameras", folder / "cameras.json", *SMALL,
               "--intersect", inside, "--output", out, "--quiet") == 0  # fmt: skip
    kept = toy.dilated(scene, truth) & (np.linalg.norm(scene.means - toy.CENTRE, axis=1) <= 1.2)
    assert json.loads((out / "report.json").read_text())["objects"][0]["counts"]["selected"] == kept.sum()
    assert run("select", folder / "scene.ply", "--marks", out / "selection.json", "--output", tmp_path / "a.npy") == 0
    assert np.array_equal(np.load(tmp_path / "a.npy"), kept)


def test_select_then_trim_reads_the_scene_once(ball, tmp_path, monkeypatch):
    folder, _, truth = ball
    opened, read = [], formats.read
    monkeypatch.setattr(formats, "read", lambda path, **options: opened.append(path) or read(path, **options))
    mask = cv2.imread(str(folder / "masks" / "1.png"), cv2.IMREAD_GRAYSCALE) > 127
    x0, y0, width, height = cv2.boundingRect(mask.astype(np.uint8))
    command = ["select", folder / "scene.ply", "--cameras", folder / "cameras.json", "--view", "1", "--quiet"]
    command += ["--box", x0, y0, x0 + width, y0 + height, "--output", tmp_path / "a.npy", "--trim", tmp_path / "out"]
    assert run(*command) == 0
    assert opened == [folder / "scene.ply"] and toy.jaccard(np.load(tmp_path / "a.npy"), truth) > 0.9
    assert (tmp_path / "out" / "selection.json").is_file()
    assert run("trim", folder / "scene.ply", tmp_path / "a.npy", "--cameras", folder / "cameras.json", "--output",
               tmp_path / "again", "--quiet") == 0  # fmt: skip
    for name in ("object.ply", "background.ply", "labels.npz"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "again" / name).read_bytes()


def test_an_up_vector_that_was_found_is_not_called_given(ball, tmp_path, capsys):
    folder = ball[0]
    command = ["select", folder / "scene.ply", "--add", folder / "rough.npy", "--output", tmp_path / "a.npy", *SMALL]
    assert run(*command, "--trim", tmp_path / "out") == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    up = report["objects"][0]["up"]
    assert (up["source"], "--up" in report["command"]) == ("ground plane", True)
    assert 0.4 <= up["confidence"] < 1 and "(given" not in capsys.readouterr().out
    again = ["trim", "--config", tmp_path / "out" / "report.json", "--output", tmp_path / "again", "--quiet"]
    assert run(*again) == 0
    assert json.loads((tmp_path / "again" / "report.json").read_text())["objects"][0]["up"]["source"] == "found before"


def test_click_in_a_planned_view(ball, tmp_path, capsys):
    """Without cameras: the views are listed as pictures, the ball is found in one by its colour, and clicked."""
    folder, _, truth = ball
    command = ["select", folder / "scene.ply", "--up", 0, 0, 1]
    assert run(*command, "--list-views", tmp_path / "views") == 0
    pictures = sorted((tmp_path / "views").glob("*.png"))
    assert [path.name for path in pictures] == [f"{i:03d}.png" for i in range(8)]
    printed = capsys.readouterr().out
    assert "up: 0.000 0.000 1.000 (given, confidence 1.00)" in printed
    assert f"select {folder / 'scene.ply'} --up 0 0 1 --view-index N --click X Y" in printed
    plain = pictures[2].read_bytes()
    assert run(*command, "--list-views", tmp_path / "views", "--grid", "--quiet") == 0
    assert pictures[2].read_bytes() != plain
    assert run(*command, "--list-views", tmp_path / "views", "--overwrite", "--quiet") == 0
    red = cv2.imread(str(pictures[2]))[..., 2] > 2.0 * cv2.imread(str(pictures[2]))[..., 1] + 40
    y, x = (int(np.median(axis)) for axis in np.nonzero(red))
    assert run(*command, "--view-index", 2, "--click", x, y, "--output", tmp_path / "a.npy") == 0
    assert toy.jaccard(np.load(tmp_path / "a.npy"), truth) > 0.9
    assert "--up 0 0 1" in capsys.readouterr().out


def test_object_numbers_give_all_objects_in_one_pass(ball, tmp_path, capsys):
    folder, _, truth = ball
    (tmp_path / "ids").mkdir()
    for path in (folder / "masks").iterdir():
        mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) > 127
        assert cv2.imwrite(str(tmp_path / "ids" / path.name), np.where(mask, 3, 7).astype(np.uint8))
    command = ["select", folder / "scene.ply", "--masks", tmp_path / "ids", "--cameras", folder / "cameras.json"]
    output = tmp_path / "labels.npy"
    assert run(*command, "--object-ids", "--output", output) == 0
    labels = np.load(output)
    assert set(np.unique(labels)) == {0, 3, 7}
    assert np.mean(truth[labels == 3]) > 0.9
    assert not truth[labels == 7].any() or np.mean(truth[labels == 7]) < 0.1
    assert f"--labels {output}" in capsys.readouterr().out
    assert run(*command, "--object-ids", "--output", tmp_path / "b.npy", "--trim", tmp_path / "out") == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "Say what to select"),
        (["--grow", 2, "--list-views", "views"], "leave the marks out"),
        (["--grow", 0], "--grow is 0.0; it must be a number from 0.01"),
        (["--marks", "nowhere.json"], "no file 'nowhere.json'"),
        (["--masks", "masks"], "--cameras PATH"),
        (["--click", 5, 5], "--view-index INT"),
        (["--click", 5, 5, "--view-index", 99], "no view 99"),
        (["--click", 5, 5, "--view", "nowhere"], "No view is named 'nowhere'"),
        (["--click", 5, 5, "--view-index", 0, "--object-ids"], "--masks"),
        (["--click", 9999, 5, "--view-index", 0], "outside the view"),
        (["--click", 5, 5, "--view-index", 0, "--output", "a.txt"], "ending"),
    ],
)
def test_what_cannot_be_meant(ball, tmp_path, capsys, options, message):
    folder, _, _ = ball
    output = [] if "--output" in options else ["--output", tmp_path / "a.npy"]
    assert run("select", folder / "scene.ply", *options, *output) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())
