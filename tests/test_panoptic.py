"""Found, missed, false, split and merged objects, and the panoptic quality, for counts that are known."""

import json

import numpy as np
import pytest
from command_line import run, save_ball

from gaussian_trimmer.evaluation.panoptic import PanopticScores


@pytest.mark.parametrize(
    ("common", "states", "false", "quality"),
    [
        ([[100, 0, 0], [0, 50, 0], [0, 0, 30]], ["found", "found"], [False, False], 1.0),
        # The first has 90 of its 100 pixels, the second none; the second that was found lies on nothing.
        ([[500, 0, 20], [10, 90, 0], [40, 0, 0]], ["found", "missed"], [False, True], 0.9 / (1 + 0.5 + 0.5)),
        ([[0, 0, 0], [0, 55, 45]], ["poor, split"], [False, True], 0.55 / 1.5),
        ([[0, 0], [0, 60], [0, 40]], ["poor, merged with others", "missed, merged with others"], [False], 0.6 / 1.5),
        ([[10], [20]], ["missed"], [], 0.0),
    ],
)
def test_what_became_of_each_object(common, states, false, quality):
    scores = PanopticScores(np.array(common))
    assert scores.states() == states and scores.false.tolist() == false
    assert scores.quality == pytest.approx(quality)
    counts = scores.counts()
    assert counts["true objects"] == len(states) and counts["false"] == sum(false)
    assert counts["merged"] == any("merged" in state for state in states)


def test_one_command_says_what_was_found_of_several(tmp_path, capsys):
    _, truth = save_ball(tmp_path)
    (tmp_path / "all").mkdir()
    (tmp_path / "masks").rename(tmp_path / "all" / "ball")
    half = truth & (np.cumsum(truth) % 2 == 0)
    np.save(tmp_path / "right.npy", truth.astype(np.int32))
    np.save(tmp_path / "wrong.npy", np.where(half, 1, np.where(truth, 2, 0)).astype(np.int32))
    command = ["--masks", tmp_path / "all", "--cameras", tmp_path / "cameras.json", "--json"]
    scores = {}
    for name in ("right", "wrong"):
        assert run("evaluate", tmp_path / "scene.ply", tmp_path / f"{name}.npy", *command) == 0
        scores[name], objects = (table["rows"] for table in json.loads(capsys.readouterr().out))
    assert (scores["right"][0]["found"], scores["right"][0]["false"]) == (1, 0)
    assert scores["right"][0]["panoptic quality (%)"] > 90
    assert (scores["wrong"][0]["found"], scores["wrong"][0]["split"]) == (0, 1)
    assert objects[0]["true object"] == "ball" and "split" in objects[0]["state"]
    assert run("evaluate", tmp_path / "scene.ply", tmp_path / "right.npy", *command, "--threshold", 0.4) == 2
    assert "--threshold" in capsys.readouterr().err
