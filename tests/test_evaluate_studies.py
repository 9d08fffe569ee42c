"""The paper's studies as commands: ablation, number of views with its plot, and sheets of captures."""

import json
import xml.etree.ElementTree as ET

import cv2
import dataset_layouts
import numpy as np
import pytest
from command_line import SMALL, run
from dataset_layouts import write
from test_evaluate_benchmark import root  # noqa: F401  the ball in the layout of the benchmark

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.captures import find_capture
from gaussian_trimmer.evaluation.plots import Curve, two_curves
from gaussian_trimmer.evaluation.predictions import PredictionPatterns
from gaussian_trimmer.evaluation.studies import PUBLISHED_ABLATION, PUBLISHED_VIEW_COUNTS
from gaussian_trimmer.evaluation.variants import VIEW_COUNTS, Variant, without_planning_or_background


def test_ablation_of_benchmark_scenes(root, capsys):  # noqa: F811
    out = root.parent / "out"
    assert run("evaluate", "ablation", root, "--kinds", "dilated", "--output", out, *SMALL) == 0
    assert "| Full GaussianTrimmer" in capsys.readouterr().out
    rows = {row["method"]: row for row in json.loads((out / "ablation.json").read_text())["rows"]}
    assert list(rows) == list(PUBLISHED_ABLATION)
    full, before = rows["Full GaussianTrimmer"], rows["before trimming"]
    assert full["gain"] == pytest.approx(full["mIoU (%)"] - before["mIoU (%)"], abs=2e-4)
    assert full["gain"] > rows["No background augmentation"]["gain"]
    assert full["paper: mIoU (%)"] == 92.1 and before["gain"] is None
    assert {entry["variant"] for entry in json.loads((out / "runs.json").read_text())} == set(rows) - {
        "before trimming"
    }


def test_view_counts_of_a_published_data_set(tmp_path, capsys):
    dataset_layouts.save_nvos(tmp_path / "nvos", tmp_path / "SAGA")
    arguments = [
        "--layout",
        "nvos",
        "--predictions",
        tmp_path / "SAGA",
        "--tasks",
        "fern",
        "--output",
        tmp_path / "out",
    ]
    assert run("evaluate", "view-counts", tmp_path / "nvos", *arguments, *SMALL) == 0
    assert "paper: latency" in capsys.readouterr().out
    rows = json.loads((tmp_path / "out" / "view-counts.json").read_text())["rows"]
    assert [row["views"] for row in rows] == list(VIEW_COUNTS) == list(PUBLISHED_VIEW_COUNTS)
    assert all(row["mIoU gain"] > 5 and row["latency (ms)"] > 0 for row in rows)
    assert ET.parse(tmp_path / "out" / "view-counts.svg").getroot().tag.endswith("svg")


def test_ablations_change_what_their_names_say():
    ablated = without_planning_or_background(Variant())
    assert {name: (v.training_views, v.config.context_radius) for name, v in ablated.items()} == {
        "No VCP": (5, 1.8),
        "No background augmentation": (0, 0.0),
        "No VCP and BA": (5, 0.0),
        "Full GaussianTrimmer": (0, 1.8),
    }


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--layout", "nvos"], "--predictions"),
        (["--predictions", "x"], "--predictions"),
        (["--objects", "cup"], "Nothing to measure"),
    ],
)
def test_what_a_study_cannot_use(root, capsys, arguments, message):  # noqa: F811
    assert run("evaluate", "ablation", root, *arguments) == 2
    assert message in capsys.readouterr().err


def circles(svg):
    found = [e for e in ET.fromstring(svg).iter() if e.tag.endswith("circle")]
    return [(float(e.get("cx")), float(e.get("cy"))) for e in found]


def test_a_plot_puts_points_in_their_places():
    svg = two_curves("<t>", "n", [1, 2, 10], Curve("a", [0, 50, 100], "red"), Curve("b", [2, 2, 2], "blue"))
    points = circles(svg)
    first, second = points[:3], points[3:]
    assert first[0][1] > first[1][1] > first[2][1]  # up the picture
    assert first[1][1] == pytest.approx((first[0][1] + first[2][1]) / 2, abs=0.1)
    assert (first[1][0] - first[0][0]) * 8 == pytest.approx(first[2][0] - first[1][0], abs=1)
    assert len({y for _, y in second}) == 1 and "&lt;t&gt;" in svg
    circles(two_curves("t", "n", [1], Curve("a", [0], "red"), Curve("b", [-1], "blue")))  # nothing divides by zero


def capture(folder, cameras="cameras.json", images="images"):
    names = [f"IMG_{i}.JPG" for i in range(5)]
    _, pictures = dataset_layouts.save_capture(folder, names)
    for name, picture in pictures.items():
        write(folder / images / name, cv2.resize(picture, (192, 192)))
    (folder / "cameras.json").rename(folder / cameras)
    return folder


def touch(folder, *paths):
    for path in paths:
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).touch()


@pytest.mark.parametrize(
    ("files", "cameras", "images"),
    [
        (["sparse/0/images.bin", "images/a.jpg", "images_4/a.jpg"], "sparse/0", "images_4"),  # mip-NeRF 360
        (["transforms.json", "images/a.jpg"], "transforms.json", "images"),  # Instruct-NeRF2NeRF
        (["colmap/sparse/0/images.bin", "images/a.jpg"], "colmap/sparse/0", "images"),
        (["sparse/images.bin", "images/a.png"], "sparse", "images"),
    ],
)
def test_layouts_of_captures(tmp_path, files, cameras, images):
    touch(tmp_path, *files, "point_cloud/iteration_7/point_cloud.ply", "selection.npy")
    found = find_capture(tmp_path, PredictionPatterns())
    assert (found.cameras, found.images) == (tmp_path / cameras, tmp_path / images)
    assert found.scene.parent.name == "iteration_7" and found.selection == tmp_path / "selection.npy"


def test_the_first_frame_of_a_sequence_is_taken(tmp_path):
    for frame in ("000000", "000005"):
        touch(tmp_path / "dance" / "data_COLMAP" / frame, "sparse/images.bin", "images/image_c_000_f_0.png")
        touch(tmp_path / "dance" / "data_COLMAP" / frame, "scene.ply", "selection.npy")
    found = find_capture(tmp_path / "dance", PredictionPatterns())
    assert found.name == "dance" and found.scene.parent.name == "000000"


def test_what_a_capture_lacks_is_named(tmp_path):
    with pytest.raises(InputError, match="no folder"):
        find_capture(tmp_path / "nowhere", PredictionPatterns())
    touch(tmp_path, "scene.ply", "selection.npy")
    with pytest.raises(InputError, match="no cameras"):
        find_capture(tmp_path, PredictionPatterns())
    touch(tmp_path, "cameras.json")
    with pytest.raises(InputError, match="no photographs"):
        find_capture(tmp_path, PredictionPatterns())


def test_sheets_of_captures(tmp_path, capsys):
    folders = [capture(tmp_path / "garden"), capture(tmp_path / "kitchen", images="images_2")]
    arguments = ["--output", tmp_path / "sheets", "--rows", 2, *SMALL]
    assert run("evaluate", "sheets", *folders, *arguments) == 0
    assert "kitchen.png" in capsys.readouterr().out
    for name in ("garden", "kitchen"):
        sheet = cv2.imread(str(tmp_path / "sheets" / f"{name}.png"))
        assert sheet.shape[1] == 4 * 280 and 2 * 280 < sheet.shape[0] < 2 * 280 + 50
        assert sheet.std() > 20
    assert run("evaluate", "sheets", *folders, *arguments) == 2
    assert "not empty" in capsys.readouterr().err
    assert run("evaluate", "sheets", folders[0], "--rows", 0) == 2


def test_sheets_need_photographs_of_the_cameras(tmp_path, capsys):
    folder = capture(tmp_path / "garden")
    (folder / "images" / "IMG_0.JPG").rename(folder / "images" / "other.JPG")
    assert run("evaluate", "sheets", folder, "--output", tmp_path / "sheets", *SMALL) == 2
    assert "IMG_0.JPG" in capsys.readouterr().err and not (tmp_path / "sheets").exists()
    with pytest.raises(InputError, match="2 files"):
        np.save(folder / "scene2.npy", np.zeros(3))
        find_capture(folder, PredictionPatterns(selections="*.npy"))
