"""What a trim writes: splat files, labels, pictures and the report."""

import json

import numpy as np
import pytest
import toy

from gaussian_trimmer import formats
from gaussian_trimmer._version import __version__
from gaussian_trimmer.output.report import describe, sentences
from gaussian_trimmer.output.saving import LABEL_NAMES, write_trim
from gaussian_trimmer.trimming.config import AcceptanceConfig, SplitConfig
from gaussian_trimmer.trimming.result import RowLabel
from gaussian_trimmer.trimming.trim import trim, trim_objects

CONFIG = toy.small_config()


@pytest.fixture(scope="module")
def trimmed():
    scene, truth = toy.ball_on_floor()
    return trim(scene, toy.dilated(scene, truth), config=CONFIG)


@pytest.fixture(scope="module")
def written(trimmed, tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    write_trim(trimmed, describe(trimmed, {"scene": "ball.ply"}, {"read": 0.25}), folder)
    return folder


def test_splat_files_hold_the_object_and_the_background(trimmed, written):
    for name, part in (("object", trimmed.object), ("background", trimmed.background)):
        found = formats.read(written / f"{name}.ply")
        np.testing.assert_array_equal(found.means, part.means)
        np.testing.assert_array_equal(found.opacity_logits, part.opacity_logits)
        assert not found.extras


def test_labels_tell_where_every_row_of_both_files_comes_from(trimmed, written):
    labels = np.load(written / "labels.npz", allow_pickle=False)
    n_object = int(labels["n_object"])
    assert list(labels["label_names"]) == list(LABEL_NAMES)
    assert n_object == len(formats.read(written / "object.ply"))
    rows = np.concatenate([formats.read(written / f"{name}.ply").sh_dc for name in ("object", "background")])
    np.testing.assert_array_equal(rows, trimmed.scene.sh_dc[labels["source_index"]])
    pruned = labels["source_index"][labels["label"] == LABEL_NAMES.index("removed")]
    assert len(pruned)
    assert trimmed.selection[pruned].all()


def test_report_says_how_it_came_about(trimmed, written):
    report = json.loads((written / "report.json").read_text())
    assert report["version"] == __version__
    assert report["inputs"] == {"scene": "ball.ply"}
    assert report["configuration"]["plan"]["size"] == 160
    (entry,) = report["objects"]
    assert entry["up"] == {"direction": [0.0, 0.0, 1.0], "source": "given", "confidence": 1.0}
    assert entry["refused"] is None
    assert (entry["id"], entry["name"], entry["file"]) == (1, "object", "object.ply")
    assert report["seconds"]["read"] == 0.25
    assert set(report["seconds"]) > {"plan", "render", "correct", "segment", "prune"}
    assert len(entry["views"]) == 5
    for listed, view in zip(entry["views"], trimmed.objects[0].views, strict=True):
        assert listed["accepted"] == (not view.rejected)
        assert listed["hidden"] == round(view.view.hidden_share, 3)
        assert listed["judged"] == view.judged
        np.testing.assert_allclose(listed["world_to_camera"], view.view.camera.world_to_camera)


@pytest.mark.parametrize(
    "stages",
    [
        {},
        {"refine": "fit"},
        {"split": SplitConfig("plane")},
        {"acceptance": AcceptanceConfig(max_wrong=0.0)},
    ],
)
def test_every_selected_gaussian_is_counted_once(stages):
    scene, truth = toy.ball_on_floor()
    result = toy.trim_by(toy.tight, scene, toy.dilated(scene, truth), config=toy.small_config(**stages))
    report = describe(result)
    counts = report["counts"] | report["objects"][0]["counts"]
    assert counts["selected"] == np.count_nonzero(result.selection)
    assert counts["selected"] == counts["kept"] + counts["cut"] + counts["removed"] + counts["discarded"]
    assert counts["kept"] + counts["cut"] + counts["added"] == np.count_nonzero(result.object_mask)
    assert (counts["object"], counts["background"]) == (len(result.object), len(result.background))
    parts = result.objects[0].source_index[result.objects[0].label == RowLabel.SPLIT_INSIDE]
    assert counts["cut"] == np.count_nonzero(result.selection[np.unique(parts)])
    assert (counts["split"] > 0) == (result.count(RowLabel.SPLIT_OUTSIDE) > 0) == ("split" in stages)
    assert (counts["removed"] > 0) == (result.objects[0].refused is None or not result.objects[0].refused)


def test_reasons_of_a_refused_trim_are_reported():
    scene, truth = toy.ball_on_floor()
    selection = toy.dilated(scene, truth)
    result = toy.trim_by(toy.empty, scene, selection, config=toy.small_config())
    report = describe(result)
    (entry,) = report["objects"]
    assert "0 of 5 views" in entry["refused"] and sentences(report)[0].startswith("Not trimmed: only 0 of 5 views")
    assert all("overlaps" in view["reason"] and not view["accepted"] for view in entry["views"])
    assert (entry["counts"]["removed"], entry["counts"]["object"]) == (0, np.count_nonzero(selection))


def test_the_object_alone_leaves_no_empty_background_file(tmp_path):
    scene, truth = toy.ball_on_floor()
    ball = scene.select(truth)
    everything = np.ones(len(ball), np.bool_)
    result = toy.trim_by(toy.empty, ball, everything, config=toy.small_config())
    write_trim(result, describe(result), tmp_path, ".splat")
    assert sorted(path.name for path in tmp_path.glob("*.splat")) == ["object.splat"]


def test_numbers_of_labels_in_files_stay_what_they_are():
    assert LABEL_NAMES == ("kept", "removed", "added", "split_inside", "split_outside", "filled", "relit")


def test_sentences_say_what_became_of_each_object_and_of_the_scene():
    entry = describe(toy_result := trimmed_pair())["objects"][0]
    first, second, scene = sentences(describe(toy_result))
    counts = entry["counts"]
    assert first.startswith(f"{entry['gaussians']:,} Gaussians. Of {counts['selected']:,} selected, ")
    assert f"{counts['kept']:,} kept" in first and entry["checked"]["sentence"] in first
    assert second != first
    assert scene.startswith(f"{len(toy_result.background):,} Gaussians") and "Up: 0.000 0.000 1.000 (given" in scene


def trimmed_pair():
    scene, truth = toy.ball_on_floor()
    left = truth & (scene.means[:, 0] < 0)
    return trim_objects(scene, {"left": left, "right": truth & ~left}, config=CONFIG)
