"""Judgements by hand, and laws that hold for any evidence."""

from functools import cache

import numpy as np
import pytest
from toy import ball_on_floor, eroded, jaccard, object_rows, one_thread, small_config

from gaussian_trimmer.trimming.config import PlanConfig, SplitConfig
from gaussian_trimmer.trimming.evidence import EvidenceConfig
from gaussian_trimmer.trimming.paper import classify_gaussians
from gaussian_trimmer.trimming.result import RowLabel
from gaussian_trimmer.trimming.trim import trim

COARSE, OTHER = True, False


@pytest.mark.parametrize(
    ("inside", "outside", "probability", "coarse", "config", "kept"),
    [
        (10, 0, 0.5, COARSE, {}, True),
        (0, 10, 0.5, COARSE, {}, False),
        (6, 4, 0.8, COARSE, {}, True),
        (6, 4, 0.3, COARSE, {}, False),  # 0.1 by the masks, -0.2 by the label
        (6, 4, 0.3, COARSE, {"prior": 0.2}, True),
        (6, 4, 0.9, OTHER, {}, True),
        (6, 4, 0.3, OTHER, {}, False),
        (6, 4, 0.9, OTHER, {"recover": False}, False),
        (4, 6, 0.7, COARSE, {"recover": False}, True),
        (6, 4, 0.0, COARSE, {"prior": 0.0}, True),  # the masks alone
        (4, 6, 1.0, COARSE, {"prior": 0.0}, False),
        (0, 0, 0.9, COARSE, {"prior": 0.0}, True),  # no view shows it: the label alone
        (0, 0, 0.1, COARSE, {}, False),
        (0, 5e-4, 0.9, COARSE, {}, True),  # next to nothing is nothing
        (0, 0, 0.9, OTHER, {"recover": False}, False),
    ],
)
def test_judgement(inside, outside, probability, coarse, config, kept):
    weights, label = np.array([[outside, inside]], np.float32), np.array([probability], np.float32)
    assert classify_gaussians(weights, label, np.array([coarse]), EvidenceConfig(**config)).tolist() == [kept]


def some_evidence(n=2000):
    rng = np.random.default_rng(0)
    weights = rng.exponential(2, (n, 2)) * rng.integers(0, 2, (n, 2))
    return weights.astype(np.float32), rng.random(n).astype(np.float32), rng.random(n) < 0.5


def test_more_weight_inside_or_a_likelier_label_never_prunes():
    weights, probability, coarse = some_evidence()
    seen = weights.sum(axis=1) > 1e-3
    kept = classify_gaussians(weights, probability, coarse, EvidenceConfig())
    assert classify_gaussians(weights + np.float32([0, 1]), probability, coarse, EvidenceConfig())[kept & seen].all()
    assert classify_gaussians(weights, np.minimum(probability + 0.1, 1), coarse, EvidenceConfig())[kept].all()


@cache
def sparse_ball(n_ball, seed):
    return ball_on_floor(seed, n_ball)


@one_thread()
def trimmed(selection, n_ball, seed, views=5, **evidence):
    config = small_config(
        split=SplitConfig("none"), plan=PlanConfig(size=160, views=views), evidence=EvidenceConfig(**evidence)
    )
    return trim(sparse_ball(n_ball, seed)[0], selection, config=config)


THROUGH_GAPS = [(300, 0, 5), (300, 1, 3)]
"""Balls with gaps behind which the masks alone take the floor for the ball."""


@pytest.mark.parametrize(("n_ball", "seed", "views"), [*THROUGH_GAPS, (700, 0, 3), (700, 1, 5), (700, 2, 5)])
def test_what_is_only_seen_through_the_object_is_not_recovered(n_ball, seed, views):
    truth = sparse_ball(n_ball, seed)[1]
    result = trimmed(truth, n_ball, seed, views)
    assert result.count(RowLabel.ADDED) == 0
    assert jaccard(object_rows(result), truth) >= 0.98


@pytest.mark.parametrize("n_ball", [100, 200, 300])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_sparse_ball_that_is_selected_exactly_stays_whole(n_ball, seed):
    truth = sparse_ball(n_ball, seed)[1]
    result = trimmed(truth, n_ball, seed)
    assert (result.objects[0].refused, result.objects[0].floaters) == (None, 0)
    assert jaccard(object_rows(result), truth) >= 0.95


@pytest.mark.parametrize("seed", [0, 1])
def test_recovery_can_be_left_out(seed):
    rough = eroded(*sparse_ball(700, seed), 0.5)
    both, no_recovery = (trimmed(rough, 700, seed, **part) for part in ({}, {"recover": False}))
    assert both.count(RowLabel.ADDED) > 0
    assert no_recovery.count(RowLabel.ADDED) == 0
    assert not (object_rows(no_recovery) & ~rough).any()


@pytest.mark.parametrize("n_ball", [300, pytest.param(700, marks=pytest.mark.slow), 1500])
@pytest.mark.parametrize("depth", [0.1, 0.3, 0.6])
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))])
def test_a_hollow_ball_that_misses_a_cap_is_hardly_made_worse(n_ball, depth, seed):
    """Of the rim of a large hole the scene shows little, since the cap that was missed covers it."""
    scene, truth = sparse_ball(n_ball, seed)
    rough = eroded(scene, truth, depth)
    result = trimmed(rough, n_ball, seed)
    assert result.objects[0].refused is None
    assert jaccard(object_rows(result), truth) >= jaccard(rough, truth) - (0.03 if depth > 0.5 else 0)
