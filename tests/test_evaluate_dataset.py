"""From a method's output folder to its row before and after trimming, in one command, on small folders."""

import csv
import json

import dataset_layouts
import numpy as np
import pytest
from command_line import SMALL, run

from gaussian_trimmer import formats


def rows_of(path):
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return {next(iter(row.values())): row for row in csv.DictReader(lines)}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_nvos_in_one_command(folder, capsys):
    dataset_layouts.save_nvos(folder / "nvos", folder / "SAGA")
    assert run("evaluate", "nvos", "nvos", "--predictions", "SAGA", "--output", "out", *SMALL) == 0
    printed = capsys.readouterr().out
    assert "NVOS with and without trimming" in printed and "occlusion counts" in printed
    assert "3 tasks, where NVOS has 8" in printed and "renderer: numba" in printed
    tasks = rows_of(folder / "out" / "nvos-SAGA.csv")
    assert list(tasks) == ["fern", "horns_center", "horns_left", "mean"]
    # Of the wrong picture, IoU would be far below this; the left half's selection is half of the target's mask.
    assert float(tasks["fern"]["IoU alone (%) after"]) > 90
    assert float(tasks["horns_center"]["IoU in scene (%) after"]) > 90
    assert float(tasks["horns_left"]["IoU alone (%) before"]) < 75
    alone = [float(tasks[name]["IoU alone (%) after"]) for name in ("fern", "horns_center", "horns_left")]
    assert float(tasks["mean"]["IoU alone (%) after"]) == pytest.approx(np.mean(alone), abs=1e-3)
    table = json.loads((folder / "out" / "nvos.json").read_text())
    published = {row["method"]: row for row in table["rows"] if row["figures"] == "published"}
    assert published["SAGA"]["mIoU (%)"] == {"before": 90.9, "after": 92.1} and len(published) == 8
    measured = [row for row in table["rows"] if row["figures"].startswith("measured")]
    assert [row["figures"] for row in measured] == ["measured, alone", "measured, in scene"]
    assert len(json.loads((folder / "out" / "runs.json").read_text())) == 3


def test_lerf_mask_takes_means_by_scene(folder, capsys):
    dataset_layouts.save_lerf_mask(folder / "lerf", folder / "grouping")
    assert run("evaluate", "lerf-mask", "lerf", "--predictions", "grouping", "--output", "out", *SMALL) == 0
    rows = rows_of(folder / "out" / "lerf-mask-grouping.csv")
    assert list(rows) == ["figurines/ball's rim", "figurines/red ball", "figurines, mean", "mean"]
    assert rows["figurines/red ball"]["views"] == "2"
    assert float(rows["mean"]["IoU alone (%) after"]) > 90
    assert "mBIoU" in (folder / "out" / "lerf-mask.csv").read_text()
    assert "no published figures" in capsys.readouterr().out


def test_several_methods_share_a_table(folder, capsys):
    for method in ("SAGA", "SAGD"):
        dataset_layouts.save_spin_nerf(folder / "spin", folder / method)
    arguments = ["--predictions", "SAGA", "SAGD", "--preset", "paper", "--format", "json", *SMALL]
    assert run("evaluate", "spin-nerf", "spin", *arguments) == 0
    tasks, _, means = json.loads(capsys.readouterr().out)  # one document for all tables
    iou = tasks["rows"][0]["IoU alone (%)"]
    assert tasks["rows"][0]["views"] == 2 and iou["after"] > iou["before"] + 5
    measured = [(row["method"], row["figures"]) for row in means["rows"] if "measured" in row["figures"]]
    assert measured == [(method, f"measured, {rule}") for method in ("SAGA", "SAGD") for rule in ("alone", "in scene")]
    assert any("preset 'paper', 5 views, grabcut" in note for note in means["notes"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--predictions", "nowhere"], "no folder 'nowhere'"),
        (["--predictions", "SAGA", "other/SAGA"], "different names"),
        (["--predictions", "SAGA", "--tasks", "trex"], "no task 'trex'"),
        (["--predictions", "SAGA", "--threshold", "-1"], "threshold"),
        (["--predictions", "SAGA", "--selections", "{scene}/*.npy"], "files that may be its selection"),
    ],
)
def test_what_cannot_be_used_is_found_before_the_first_trim(folder, capsys, arguments, message):
    dataset_layouts.save_nvos(folder / "nvos", folder / "SAGA")
    assert run("evaluate", "nvos", "nvos", *arguments, *SMALL) == 2
    captured = capsys.readouterr()
    assert message in captured.err and not captured.out


def test_a_target_that_the_cameras_lack_is_named(folder, capsys):
    dataset_layouts.save_nvos(folder / "nvos", folder / "SAGA")
    cameras = folder / "SAGA" / "fern" / "cameras.json"
    cameras.write_text(cameras.read_text().replace("IMG_4027", "IMG_5000"))
    assert run("evaluate", "nvos", "nvos", "--predictions", "SAGA", *SMALL) == 2
    assert "IMG_4027" in capsys.readouterr().err


def test_an_object_that_is_not_the_scenes_cannot_be_trimmed(folder, capsys):
    dataset_layouts.save_spin_nerf(folder / "spin", folder / "method")
    scene = formats.read(folder / "method" / "lego" / "scene.ply")
    (folder / "method" / "lego" / "selection.npy").unlink()
    strange = scene.select(slice(0, 50)).replace(means=scene.means[50:100] * 3, sh_dc=scene.sh_dc[:50] + 5)
    formats.write(strange, folder / "method" / "lego" / "object.ply")
    assert run("evaluate", "spin-nerf", "spin", "--predictions", "method", *SMALL) == 2
    assert "cannot start" in capsys.readouterr().err
