"""`gaussian-trimmer evaluate` on the ball: what is printed and written, and what is refused."""

import csv
import json
import shutil

import cv2
import numpy as np
import pytest
from command_line import SMALL, run, save_ball

from gaussian_trimmer import formats


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene, truth = save_ball(tmp_path)
    np.save(tmp_path / "truth.npy", truth)
    formats.write(scene.select(truth), tmp_path / "object.ply")
    return tmp_path


def evaluate(*arguments):
    return run("evaluate", "scene.ply", *arguments, "--masks", "masks", "--cameras", "cameras.json")


def rows_of(path):
    with path.open() as file:
        return {row["view"]: row for row in csv.DictReader(file)}


def test_a_trim_is_compared_with_what_it_began_with(folder, capsys):
    more = ["--up", "z", "--quiet", "--background", "exact", *SMALL]
    assert run("trim", "scene.ply", "rough.npy", "--output", "t", *more) == 0
    assert evaluate("t", "--output", "out") == 0
    printed = capsys.readouterr().out
    assert "| mean" in printed and " -> " in printed and "alpha > 0.5" in printed
    names = {path.name for path in (folder / "out").iterdir()}
    assert names == {"scores.md", "scores.csv", "scores.json", "scores.tex", "settings.json", "manifest.json"}
    rows = rows_of(folder / "out" / "scores.csv")
    assert list(rows) == ["0.png", "1.png", "2.png", "3.png", "mean"]
    mean = rows["mean"]
    assert float(mean["IoU (%) after"]) > float(mean["IoU (%) before"]) + 1
    assert float(mean["IoU (%) after"]) == pytest.approx(
        np.mean([float(rows[f"{i}.png"]["IoU (%) after"]) for i in range(4)]), abs=1e-3
    )
    assert float(mean["IoU in scene (%) after"]) > float(mean["IoU in scene (%) before"]) + 1
    assert float(mean["fidelity (dB)"]) == 100


def test_any_object_is_measured(folder, capsys):
    assert evaluate("object.ply", "--before", "rough.npy", "--json") == 0
    table = json.loads(capsys.readouterr().out)
    mean = table["rows"][-1]
    assert mean["IoU (%) after"] > 97 > mean["IoU (%) before"]
    assert mean["fidelity (dB)"] == 100
    assert evaluate("truth.npy", "--format", "csv") == 0
    assert "IoU (%),accuracy (%)" in capsys.readouterr().out  # nothing before


def test_rules_are_named_and_photographs_bring_the_extraction_psnr(folder, capsys):
    assert evaluate("object.ply", "--threshold", 0.9, "--images", "masks") == 0
    printed = capsys.readouterr().out
    assert r"alpha > 0.9" in printed and "occlusion counts" in printed and "extraction PSNR (dB)" in printed


def test_latex_has_a_row_for_the_method(folder, capsys):
    assert evaluate("object.ply", "--before", "rough.npy", "--format", "latex") == 0
    lines = capsys.readouterr().out.splitlines()
    assert r"method & rule & IoU (\%) & IoU + ours & IoU gain \\" in lines
    assert [line.split(" & ")[:2] for line in lines if "$" in line and line[0] != "%"] == [
        ["object", "alone"],
        ["object", "in scene"],
    ]
    assert evaluate("truth.npy", "--format", "latex") == 0
    assert r"method & rule & IoU (\%) \\" in capsys.readouterr().out


def test_views_count_that_have_a_photograph_and_those_that_show_the_object(folder, capsys):
    (folder / "photographs").mkdir()
    for name in ("0.png", "1.png"):
        shutil.copy(folder / "masks" / name, folder / "photographs")
    cv2.imwrite("masks/1.png", np.zeros_like(cv2.imread("masks/1.png")))
    assert evaluate("object.ply", "--images", "photographs", "--json") == 0
    table = json.loads(capsys.readouterr().out)
    assert [row["view"] for row in table["rows"]] == ["0.png", "1.png", "mean"]
    shown, hidden, mean = table["rows"]
    assert hidden["IoU (%)"] is None and mean["IoU (%)"] == shown["IoU (%)"] > 90
    assert any("show nothing of the object, which count for the accuracy alone: 1" in note for note in table["notes"])


def test_an_object_of_no_known_rows_is_measured_alone(folder, capsys):
    scene = formats.read("object.ply")
    formats.write(scene.replace(means=scene.means[::-1] * 3, sh_dc=scene.sh_dc + 5), folder / "strange.ply")
    assert evaluate("strange.ply", "--json") == 0
    table = json.loads(capsys.readouterr().out)
    assert "IoU (%)" in table["rows"][-1] and "IoU in scene (%)" not in table["rows"][-1]
    assert any("match no row" in note for note in table["notes"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["object.ply", "--threshold", 2], "threshold"),
        (["nowhere.ply"], "nowhere.ply"),
        (["masks"], "did not write the folder"),
        (["object.ply", "--images", "nowhere"], "nowhere"),
        (["object.ply", "--output", "masks"], "not empty"),
    ],
)
def test_what_cannot_be_used_is_one_sentence(folder, capsys, arguments, message):
    assert evaluate(*arguments) == 2
    error = capsys.readouterr().err
    assert message in error and len(error.splitlines()) == 1


def test_each_of_several_objects_is_compared_with_what_is_most_like_it(folder, capsys):
    truth = np.load("truth.npy")
    (folder / "all").mkdir()
    (folder / "masks").rename(folder / "all" / "ball")
    half = truth & (np.cumsum(truth) % 2 == 0)
    np.save("right.npy", truth.astype(np.int32))
    np.save("wrong.npy", np.where(half, 1, np.where(truth, 2, 0)).astype(np.int32))
    command = ["--masks", "all", "--cameras", "cameras.json", "--json"]
    found = {}
    for name in ("right", "wrong"):
        assert run("evaluate", "scene.ply", f"{name}.npy", *command) == 0
        found[name], mean = json.loads(capsys.readouterr().out)["rows"]
        assert found[name]["true object"] == "ball" and mean["IoU (%)"] == found[name]["IoU (%)"]
    assert found["right"]["found as"] == 1 and found["right"]["IoU (%)"] > 90 > 80 > found["wrong"]["IoU (%)"]
    assert run("evaluate", "scene.ply", "right.npy", *command, "--threshold", 0.4) == 2
    assert "--threshold" in capsys.readouterr().err
