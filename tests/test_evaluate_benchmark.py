"""`gaussian-trimmer evaluate benchmark` on the ball in the layout of the benchmark, and `benchmarks/quality.py`."""

import importlib.util
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import run, save_ball

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.benchmark import BenchmarkOptions, benchmark_tasks
from gaussian_trimmer.evaluation.variants import VIEW_COUNTS, chosen_variants, variants

QUALITY = Path(__file__).parents[1] / "benchmarks" / "quality.py"


@pytest.fixture
def root(tmp_path):
    folder = tmp_path / "data" / "ball"
    folder.mkdir(parents=True)
    _, truth = save_ball(folder)
    (folder / "masks").rename(folder / "all")
    (folder / "masks" / "ball").mkdir(parents=True)
    (folder / "images").mkdir()
    listing = json.loads((folder / "cameras.json").read_text())
    for i, frame in enumerate(listing["frames"]):
        frame["split"] = "test" if i < 2 else "train"
        if i < 2:
            mask = cv2.imread(str(folder / "all" / f"{i}.png"), cv2.IMREAD_GRAYSCALE)
            cv2.imwrite(str(folder / "masks" / "ball" / f"{i}.png"), mask)
            cv2.imwrite(str(folder / "images" / f"{i}.png"), np.repeat(mask[..., None], 3, axis=2))
    (folder / "cameras.json").write_text(json.dumps(listing))
    (folder / "coarse" / "ball").mkdir(parents=True)
    np.save(folder / "coarse" / "ball" / "exact.npy", truth)
    np.save(folder / "coarse" / "ball" / "dilated.npy", np.load(folder / "rough.npy"))
    np.save(folder / "coarse" / "ball" / "tiny.npy", truth & (np.cumsum(truth) <= 5))
    return tmp_path / "data"


def test_tasks_hold_no_ground_truth_for_the_trimmer(root):
    left_out = []
    tasks = {task.kind: task for task in benchmark_tasks(root, BenchmarkOptions(), left_out.append)}
    assert set(tasks) == {"dilated", "exact"} and "tiny" in left_out[0]
    task = tasks["dilated"]
    assert [camera.name for camera in task.cameras.cameras] == ["2.png", "3.png", "4.png"]
    assert [view.camera.name for view in task.views] == ["0.png", "1.png"]
    assert task.up == (0, 0, 1)
    (task,) = benchmark_tasks(root, BenchmarkOptions(kinds=("box",), without_cameras=True))
    assert task.cameras is None and task.up is None and task.selection.any()
    assert list(benchmark_tasks(root, BenchmarkOptions(objects=("cup",)))) == []


def test_the_command_measures_and_writes(root, capsys):
    out = root.parent / "out"
    arguments = ["--kinds", "dilated", "--variants", "default", "views-1", "--output", out]
    assert run("evaluate", "benchmark", root, *arguments) == 0
    printed = capsys.readouterr().out
    assert "views-1, by scene" in printed and "alpha > 0.5" in printed
    runs = json.loads((out / "runs.json").read_text())
    assert [entry["variant"] for entry in runs] == ["default", "views-1"]
    assert runs[0]["after"]["iou"] > runs[0]["before"]["iou"] + 1
    assert [view["view"] for view in runs[0]["views"]] == ["0.png", "1.png"]
    assert (out / "default-kinds.tex").is_file() and (out / "sheets" / "default" / "ball_ball_dilated.png").is_file()
    assert run("evaluate", "benchmark", root, "--kinds", "dilated", "--format", "csv", "--no-fidelity") == 0
    assert capsys.readouterr().out.startswith("# default, by kind")  # no lines on trims in between


def test_the_script_is_the_command_on_the_data_of_the_repository(root, capsys):
    spec = importlib.util.spec_from_file_location("quality", QUALITY)
    quality = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(quality)
    assert QUALITY.parent / "data" == quality.DATA
    assert quality.run([str(root), "--kinds", "exact", "--no-fidelity"]) == 0
    assert "by kind of selection" in capsys.readouterr().out
    quality.DATA = root
    assert quality.run(["--kinds", "nothing"]) == 2
    assert "nothing" in capsys.readouterr().err


def test_unknown_names_are_refused(root, capsys):
    with pytest.raises(InputError, match="'fast'; available"):
        chosen_variants(("fast",))
    assert run("evaluate", "benchmark", root, "--objects", "cup") == 2
    assert "Nothing to measure" in capsys.readouterr().err


def test_variants_are_what_their_names_say():
    named = variants()
    assert chosen_variants(("ablations",)) == named and next(iter(named)) == "default"
    assert named["no-background"].config.context_radius == 0 and named["neither"].training_views == 5
    assert [named[f"views-{n}"].config.plan.views for n in VIEW_COUNTS] == list(VIEW_COUNTS)
