"""Found, missed, false, split and merged objects, and the panoptic quality, for counts that are known."""

import json

import numpy as np
import pytest
from command_line import run, save_ball

from gaussian_trimmer.evaluation.panoptic import counts_of, panoptic_scores


def table(*rows):
    return np.array(rows)


def test_all_found_is_perfect():
    scores = panoptic_scores(table([100, 0, 0], [0, 50, 0], [0, 0, 30]))
    assert scores.quality == 1 and scores.found.all() and not scores.false.any()


def test_one_found_one_missed_one_false():
    # The first has 90 of its 100 pixels, the second none; the second that was found lies on nothing.
    scores = panoptic_scores(table([500, 0, 20], [10, 90, 0], [40, 0, 0]))
    counts = counts_of(scores)
    assert (counts["found"], counts["missed"], counts["false"]) == (1, 1, 1)
    assert scores.quality == pytest.approx(0.9 / (1 + 0.5 + 0.5))


def test_an_object_in_two_pieces_is_split():
    scores = panoptic_scores(table([0, 0, 0], [0, 55, 45]))
    assert scores.split.tolist() == [True] and scores.false.tolist() == [False, True]


def test_two_objects_in_one_are_merged():
    scores = panoptic_scores(table([0, 0], [0, 60], [0, 40]))
    assert scores.merged.tolist() == [True]
    assert scores.missed.tolist() == [False, True] and scores.best.tolist() == [0.6, 0.4]


def test_nothing_found_is_no_error():
    counts = counts_of(panoptic_scores(table([10], [20])))
    assert (counts["found"], counts["missed"], counts["panoptic quality (%)"]) == (0, 1, 0)


def test_the_command_says_what_was_found(tmp_path, capsys):
    _, truth = save_ball(tmp_path)
    (tmp_path / "all").mkdir()
    (tmp_path / "masks").rename(tmp_path / "all" / "ball")
    half = truth & (np.cumsum(truth) % 2 == 0)
    np.save(tmp_path / "right.npy", truth.astype(np.int32))
    np.save(tmp_path / "wrong.npy", np.where(half, 1, np.where(truth, 2, 0)).astype(np.int32))
    command = ["--masks", tmp_path / "all", "--cameras", tmp_path / "cameras.json", "--json"]
    scores = {}
    for name in ("right", "wrong"):
        assert run("evaluate", "objects", tmp_path / "scene.ply", tmp_path / f"{name}.npy", *command) == 0
        scores[name] = json.loads(capsys.readouterr().out)[0]["rows"][0]
    assert (scores["right"]["found"], scores["right"]["false"]) == (1, 0)
    assert scores["right"]["panoptic quality (%)"] > 90
    assert (scores["wrong"]["found"], scores["wrong"]["split"]) == (0, 1)


def test_masks_without_folders_are_refused(tmp_path, capsys):
    save_ball(tmp_path)
    files = [tmp_path / "scene.ply", tmp_path / "rough.npy", "--cameras", tmp_path / "cameras.json"]
    assert run("evaluate", "objects", *files, "--masks", tmp_path / "masks") == 2
    assert "has no folders" in capsys.readouterr().err
