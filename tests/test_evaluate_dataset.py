"""From a method's output folder to its row before and after trimming, in one command, on small folders."""

import csv
import json
from dataclasses import replace

import cv2
import dataset_layouts
import numpy as np
import pytest
import toy
from command_line import SMALL, run
from dataset_layouts import SIZE
from selection_builders import checkpoint_state, classifier_state, identity_columns, save_ply

from gaussian_trimmer import formats
from gaussian_trimmer.cameras import Camera, intrinsics
from gaussian_trimmer.evaluation.datasets import LAYOUTS
from gaussian_trimmer.evaluation.ground_truth import TestView


def rows_of(path):
    with path.open() as file:
        return {next(iter(row.values())): row for row in csv.DictReader(file)}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_nvos_in_one_command(folder, capsys):
    dataset_layouts.save_nvos(folder / "nvos", folder / "SAGA")
    assert run("evaluate", "nvos", "nvos", "--predictions", "SAGA", "--output", "out", *SMALL) == 0
    printed = capsys.readouterr().out
    assert "NVOS with and without trimming" in printed and "occlusion counts" in printed
    assert "3 tasks, where NVOS has 8" in printed
    tasks = rows_of(folder / "out" / "nvos-SAGA.csv")
    assert list(tasks) == ["fern", "horns_center", "horns_left", "mean"]
    # Of the wrong picture, IoU would be far below this; the left half's selection is half of the target's mask.
    assert float(tasks["fern"]["IoU alone (%) after"]) > 90
    assert float(tasks["horns_center"]["IoU in scene (%) after"]) > 90
    assert float(tasks["horns_left"]["IoU alone (%) before"]) < 75
    alone = [float(tasks[name]["IoU alone (%) after"]) for name in ("fern", "horns_center", "horns_left")]
    assert float(tasks["mean"]["IoU alone (%) after"]) == pytest.approx(np.mean(alone), abs=1e-3)
    table = json.loads((folder / "out" / "nvos.json").read_text())
    assert [(row["method"], row["rule"]) for row in table["rows"]] == [("SAGA", "alone"), ("SAGA", "in scene")]
    assert table["rows"][0]["IoU + ours"] == pytest.approx(np.mean(alone), abs=1e-3)
    assert len(json.loads((folder / "out" / "runs.json").read_text())) == 3


def test_lerf_mask_takes_means_by_scene(folder, capsys):
    dataset_layouts.save_lerf_mask(folder / "lerf", folder / "grouping")
    assert run("evaluate", "lerf-mask", "lerf", "--predictions", "grouping", "--output", "out", *SMALL) == 0
    rows = rows_of(folder / "out" / "lerf-mask-grouping.csv")
    assert list(rows) == ["figurines/ball's rim", "figurines/red ball", "figurines, mean", "mean"]
    assert rows["figurines/red ball"]["views"] == "2"
    assert float(rows["mean"]["IoU alone (%) after"]) > 90
    assert "boundary IoU + ours" in (folder / "out" / "lerf-mask.csv").read_text()
    statistics = rows_of(folder / "out" / "lerf-mask-statistics.csv")
    assert statistics["grouping"]["scenes"] == "1"
    assert "1 tasks" not in capsys.readouterr().out


def test_several_methods_share_a_table(folder, capsys):
    for method in ("SAGA", "SAGD"):
        dataset_layouts.save_nvos(folder / "nvos", folder / method)
    arguments = ["--predictions", "SAGA", "SAGD", "--tasks", "fern", "--preset", "paper", "--json", *SMALL]
    assert run("evaluate", "nvos", "nvos", *arguments) == 0
    tasks, _, means, statistics = json.loads(capsys.readouterr().out)  # one document for all tables
    before, after = (tasks["rows"][0][f"IoU alone (%) {when}"] for when in ("before", "after"))
    assert tasks["rows"][0]["views"] == 1 and after > before + 1
    rules = [(row["method"], row["rule"]) for row in means["rows"]]
    assert rules == [(method, rule) for method in ("SAGA", "SAGD") for rule in ("alone", "in scene")]
    assert any("preset 'paper', 5 views" in note for note in means["notes"])
    (row,) = (row for row in statistics["rows"] if row["method"] == "SAGD" and row["metric"] == "IoU")
    assert row["gain mean"] == pytest.approx(after - before, abs=1e-3) and row["gain low"] is None
    assert row["losing"] == 0 and row["worst object"] == "fern/fern"
    assert any("made by gaussian-trimmer" in note for note in statistics["notes"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--predictions", "nowhere"], "'nowhere/fern"),
        (["--predictions", "SAGA", "other/SAGA"], "different names"),
        (["--predictions", "SAGA", "--tasks", "trex"], "no task 'trex'"),
        ([], "needs --predictions"),
        (["--predictions", "SAGA", "--protocol", "usual"], "available: own, cob-gs, saga, sa3d"),
        (["--predictions", "SAGA", "--protocol", "sa3d", "--threshold", "0.2"], "'sa3d' has the threshold 0.1"),
        (["--predictions", "SAGA", "--ids", "nowhere.csv"], "nowhere.csv"),
        (["--predictions", "SAGA", "--threshold", "-1"], "threshold"),
        (["--predictions", "SAGA", "--selections", "{scene}/*.npy"], "files that may be its selection"),
    ],
)
def test_what_cannot_be_used_is_found_before_the_first_trim(folder, capsys, arguments, message):
    dataset_layouts.save_nvos(folder / "nvos", folder / "SAGA")
    assert run("evaluate", "nvos", "nvos", *arguments, *SMALL) == 2
    captured = capsys.readouterr()
    assert message in captured.err and not captured.out


def test_an_object_that_is_not_the_scenes_cannot_be_trimmed(folder, capsys):
    dataset_layouts.save_nvos(folder / "nvos", folder / "method")
    home = folder / "method" / "fern"
    strange = formats.read(home / "scene.ply").select(slice(0, 50))
    (home / "selection.npy").unlink()
    formats.write(strange.replace(means=strange.means * 3 + 1, sh_dc=strange.sh_dc + 5), home / "object.ply")
    assert run("evaluate", "nvos", "nvos", "--predictions", "method", "--tasks", "fern", *SMALL) == 2
    assert "cannot start" in capsys.readouterr().err


def test_a_protocol_has_its_own_rule_and_threshold(folder, capsys):
    dataset_layouts.save_nvos(folder / "nvos", folder / "SAGA")
    arguments = ["--predictions", "SAGA", "--tasks", "fern", "--output", "out", "--protocol", "cob-gs"]
    assert run("evaluate", "nvos", "nvos", *arguments, *SMALL) == 0
    table = json.loads((folder / "out" / "nvos.json").read_text())
    assert [row["rule"] for row in table["rows"]] == ["alone"]  # the one rule of occlusion of this protocol
    assert "ZestfulJX/COB-GS" in capsys.readouterr().out
    settings = json.loads((folder / "out" / "settings.json").read_text())
    assert settings["protocol"] == "cob-gs" and settings["config"]["plan"]["views"] == 5
    assert any("cob-gs" in note for note in settings["tables"]["nvos"]["notes"])  # beside the CSV, which has none


def test_views_are_rendered_at_the_protocols_size():
    camera = Camera(np.eye(4), intrinsics(1.0, 40, 30), 40, 30, "a.jpg")
    coverage = np.full((60, 80), 128 / 255, np.float32)
    view = TestView(replace(camera, width=80, height=60), None, coverage, coverage > 0)
    seen = LAYOUTS["nvos"].protocol("cob-gs").view(view, camera)
    assert (seen.camera.width, seen.camera.height) == (1008, 756)
    assert seen.camera.K[0, 0] == pytest.approx(camera.K[0, 0] * 1008 / 40)
    assert not seen.coverage.any()  # 128 is not above 128
    seen = LAYOUTS["lerf-mask"].protocol("gaussian-grouping").view(view, camera)
    assert (seen.camera.width, seen.camera.height) == (40, 30)
    assert LAYOUTS["nvos"].protocol("own").view(view, camera).camera.width == 80


@pytest.mark.needs("torch")
def test_one_classifier_serves_all_tasks_of_a_scene(folder, capsys):
    import torch

    dataset_layouts.save_lerf_mask(folder / "lerf", folder / "grouping")
    home = folder / "grouping" / "figurines"
    for name in ("red ball.npy", "ball's rim.npy"):
        (home / name).unlink()
    scene, truth = toy.ball_on_floor()
    scene = scene.replace(extras=identity_columns(toy.dilated(scene, truth).astype(int).tolist()))
    (home / "scene.ply").unlink()
    place = home / "point_cloud" / "iteration_30000"
    place.mkdir(parents=True)
    save_ply(place / "point_cloud.ply", scene)
    torch.save(classifier_state(8), place / "classifier.pth")
    (folder / "ids.csv").write_text("task,id\nfigurines/red ball,1\nfigurines/ball's rim,1\n")
    command = ("evaluate", "lerf-mask", "lerf", "--predictions", "grouping", *SMALL)
    assert run(*command, "--ids", "ids.csv", "--output", "out") == 0
    assert float(rows_of(folder / "out" / "lerf-mask-grouping.csv")["mean"]["IoU alone (%) after"]) > 90
    (folder / "ids.csv").write_text("figurines/red ball,1\n")
    assert run(*command, "--ids", "ids.csv") == 2
    assert "no row of the task 'figurines/ball's rim'" in capsys.readouterr().err
    (folder / "ids.csv").write_text("figurines/red ball,one\n")
    assert run(*command, "--ids", "ids.csv") == 2
    assert "'figurines/red ball' without ids" in capsys.readouterr().err


@pytest.mark.needs("torch")
def test_a_cob_gs_checkpoint_is_scene_and_selection(folder):
    import torch

    dataset_layouts.save_nvos(folder / "nvos", folder / "COB-GS")
    home = folder / "COB-GS" / "fern"
    scene, truth = toy.ball_on_floor()
    (home / "selection.npy").unlink()
    (home / "scene.ply").unlink()
    logits = torch.where(torch.tensor(toy.dilated(scene, truth)), 4.0, -4.0)
    (home / "masks" / "fern").mkdir(parents=True)
    for iteration in (40, 220):
        torch.save((checkpoint_state(scene, logits), iteration), home / "masks" / "fern" / f"chkpnt{iteration}.pth")
    command = ("evaluate", "nvos", "nvos", "--predictions", "COB-GS", "--tasks", "fern", "--output", "out", *SMALL)
    assert run(*command) == 0
    assert float(rows_of(folder / "out" / "nvos-COB-GS.csv")["fern"]["IoU alone (%) after"]) > 90


def test_lerf_ovs_has_polygons(folder, capsys):
    masks, _ = dataset_layouts.save_capture(
        folder / "method" / "ramen", ["frame_00006.jpg", "frame_00024.jpg"], "egg.npy"
    )
    for name, mask in masks.items():
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        objects = [{"category": "egg", "bbox": [], "segmentation": c[:, 0].tolist()} for c in contours]
        objects += [{"category": "corner", "bbox": [], "segmentation": [[0, 0], [9, 0], [9, 9], [0, 9]]}] * 2
        info = {"name": name, "width": SIZE, "height": SIZE}
        file = folder / "lerf_ovs" / "label" / "ramen" / name.replace(".jpg", ".json")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps({"info": info, "objects": objects}))
    arguments = ["lerf_ovs", "--predictions", "method", "--tasks", "ramen/egg", "--output", "out"]
    assert run("evaluate", "lerf-ovs", *arguments, *SMALL) == 0
    assert float(rows_of(folder / "out" / "lerf-ovs-method.csv")["ramen/egg"]["IoU in scene (%) after"]) > 90
    assert "all objects in all views of a scene, then over scenes" in capsys.readouterr().out
    file.write_text(
        '{"info": {"width": 5, "height": 5}, "objects": [{"category": "egg", "segmentation": [[1e30, 2]]}]}'
    )
    assert run("evaluate", "lerf-ovs", *arguments, "--overwrite", *SMALL) == 2
    assert "holds no polygons" in capsys.readouterr().err
