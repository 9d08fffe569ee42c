"""Found, missed, false, split and merged objects, and the panoptic quality, for counts that are known."""

import numpy as np
import pytest

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
