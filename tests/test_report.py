"""What a trim writes: splat files, labels, pictures and the report."""

import json

import cv2
import numpy as np
import pytest
import toy

from gaussian_trimmer import formats
from gaussian_trimmer._version import __version__
from gaussian_trimmer.output.report import LABEL_NAMES, count, describe, write_results
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.trimming.trim import AcceptanceConfig, trim

RENDERER = get_renderer("numba")
CONFIG = toy.small_config()


@pytest.fixture(scope="module")
def trimmed():
    scene, truth = toy.ball_on_floor()
    selection = toy.dilated(scene, truth)
    return trim(scene, selection, config=CONFIG, renderer=RENDERER), selection


@pytest.fixture(scope="module")
def written(trimmed, tmp_path_factory):
    result, selection = trimmed
    folder = tmp_path_factory.mktemp("results")
    report = describe(result, selection, CONFIG, {"scene": "ball.ply"}, seconds={"read": 0.25})
    write_results(result, selection, report, folder, RENDERER)
    return folder


def test_splat_files_hold_the_object_and_the_background(trimmed, written):
    result, _ = trimmed
    for name, part in (("object", result.object), ("background", result.background)):
        found = formats.read(written / f"{name}.ply")
        np.testing.assert_array_equal(found.means, part.means)
        np.testing.assert_array_equal(found.opacity_logits, part.opacity_logits)
        assert not found.extras


def test_labels_tell_where_every_row_of_both_files_comes_from(trimmed, written):
    result, selection = trimmed
    labels = np.load(written / "labels.npz", allow_pickle=False)
    n_object = int(labels["n_object"])
    assert list(labels["label_names"]) == list(LABEL_NAMES)
    assert n_object == len(formats.read(written / "object.ply"))
    rows = np.concatenate([formats.read(written / f"{name}.ply").sh_dc for name in ("object", "background")])
    np.testing.assert_array_equal(rows, result.scene.sh_dc[labels["source_index"]])
    pruned = labels["source_index"][labels["label"] == LABEL_NAMES.index("pruned")]
    assert len(pruned)
    assert selection[pruned].all()


def test_report_says_how_it_came_about(trimmed, written):
    result, _ = trimmed
    report = json.loads((written / "report.json").read_text())
    assert report["version"] == __version__
    assert report["inputs"] == {"scene": "ball.ply"}
    assert report["configuration"]["plan"]["size"] == 160
    assert report["up"] == {"direction": [0.0, 0.0, 1.0], "source": "given", "confidence": 1.0}
    assert (report["renderer"], report["segmenter"], report["refused"]) == ("numba", "silhouette", "")
    assert report["seconds"]["read"] == 0.25
    assert set(report["seconds"]) > {"plan", "render", "segment", "weigh", "split"}
    assert len(report["views"]) == 5
    for entry, view in zip(report["views"], result.views, strict=True):
        assert entry["accepted"] == (not view.rejected)
        np.testing.assert_allclose(entry["world_to_camera"], view.view.camera.world_to_camera)


def test_counts_add_up(trimmed):
    result, selection = trimmed
    counts = count(result, selection)
    assert counts["selected"] == np.count_nonzero(selection)
    assert counts["object"] == counts["kept"] + counts["recovered"] + counts["split"] == len(result.object)
    assert counts["background"] == len(result.background)
    assert counts["object"] + counts["background"] == counts["scene"] + len(result.outside_parts)
    assert counts["pruned"] > 0


def test_there_is_a_picture_of_every_view_and_one_of_before_and_after(written):
    assert sorted(path.name for path in (written / "views").iterdir()) == [f"{i:02d}.png" for i in range(5)]
    assert cv2.imread(str(written / "views" / "00.png")).shape[1] == 160
    assert cv2.imread(str(written / "before_after.png")).shape[2] == 3


def test_settings_and_reasons_of_a_refused_trim_are_reported(tmp_path):
    scene, truth = toy.ball_on_floor()
    selection = toy.dilated(scene, truth)
    config = toy.small_config(acceptance=AcceptanceConfig(min_silhouette=10**6))
    result = trim(scene, selection, config=config, renderer=RENDERER)
    report = describe(result, selection, config, {}, segmenter="a better name")
    write_results(result, selection, report, tmp_path, RENDERER)
    assert "0 of 5 views" in report["refused"]
    assert all("pixels" in view["reason"] and not view["accepted"] for view in report["views"])
    assert report["segmenter"] == "a better name"
    assert (report["counts"]["pruned"], report["counts"]["object"]) == (0, np.count_nonzero(selection))


def test_the_object_alone_leaves_no_empty_background_file(tmp_path):
    scene, truth = toy.ball_on_floor()
    ball = scene.select(truth)
    config = toy.small_config(acceptance=AcceptanceConfig(min_silhouette=10**6))
    everything = np.ones(len(ball), np.bool_)
    result = trim(ball, everything, config=config, renderer=RENDERER)
    write_results(result, everything, {}, tmp_path, RENDERER, ".splat")
    assert sorted(path.name for path in tmp_path.glob("*.splat")) == ["object.splat"]


def test_numbers_of_labels_in_files_stay_what_they_are():
    assert LABEL_NAMES == ("kept", "pruned", "recovered", "split_inside", "split_outside", "filled")
