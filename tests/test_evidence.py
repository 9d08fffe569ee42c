"""Judgements by hand, and laws that hold for any evidence."""

import numpy as np
import pytest

from gaussian_trimmer.evidence import EvidenceConfig, judge, shows_outside

COARSE, OTHER = True, False


@pytest.mark.parametrize(
    ("inside", "outside", "probability", "coarse", "config", "kept"),
    [
        (10, 0, 0.5, COARSE, {}, True),
        (0, 10, 0.5, COARSE, {}, False),
        (6, 4, 0.8, COARSE, {}, True),
        (6, 4, 0.3, COARSE, {}, False),  # 0.1 by the masks, -0.2 by the label
        (4, 6, 0.7, OTHER, {}, True),  # -0.1 by the masks, 0.2 by the label
        (4, 6, 0.7, OTHER, {"recover": False}, False),
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
    arrays = [np.array([value], np.float32) for value in (inside, outside, probability)]
    assert judge(*arrays, np.array([coarse]), EvidenceConfig(**config)).tolist() == [kept]


@pytest.mark.parametrize(
    ("inside", "outside", "seen", "shown"),
    [
        (4, 6, 1.0, True),
        (6, 4, 1.0, False),
        (6, 4, 0.0, True),  # the scene hides it: 0.4 is above its lower limit of 0.3
        (8, 2, 0.0, False),
        (0, 0, 0.0, False),
        (0, 5e-4, 0.0, False),
        (5, 5, 1.0, False),  # a limit is the largest share that is allowed
    ],
)
def test_what_shows_outside_when_alone(inside, outside, seen, shown):
    arrays = [np.array([value], np.float32) for value in (inside, outside, seen)]
    config = EvidenceConfig(alone_limit=0.5, hidden_limit=0.3)
    assert shows_outside(*arrays, config).tolist() == [shown]


def some_evidence(n=2000):
    rng = np.random.default_rng(0)
    inside, outside = rng.exponential(2, (2, n)) * rng.integers(0, 2, (2, n))
    return inside.astype(np.float32), outside.astype(np.float32), rng.random(n).astype(np.float32), rng.random(n) < 0.5


@pytest.mark.parametrize("prior", [0.0, 1.0, 5.0])
def test_without_recovery_nothing_is_added_and_otherwise_nothing_changes(prior):
    inside, outside, probability, coarse = some_evidence()
    free = judge(inside, outside, probability, coarse, EvidenceConfig(prior=prior))
    bound = judge(inside, outside, probability, coarse, EvidenceConfig(prior=prior, recover=False))
    assert (free & ~coarse).any()
    np.testing.assert_array_equal(bound, free & coarse)


def test_more_weight_inside_or_a_likelier_label_never_prunes():
    inside, outside, probability, coarse = some_evidence()
    seen = inside + outside > 1e-3
    kept = judge(inside, outside, probability, coarse, EvidenceConfig())
    assert judge(inside + 1, outside, probability, coarse, EvidenceConfig())[kept & seen].all()
    assert judge(inside, outside, np.minimum(probability + 0.1, 1), coarse, EvidenceConfig())[kept].all()


def test_judgements_do_not_depend_on_the_size_of_the_pictures():
    inside, outside, probability, coarse = some_evidence()
    keep = judge(inside, outside, probability, coarse, EvidenceConfig())
    np.testing.assert_array_equal(keep, judge(4 * inside, 4 * outside, probability, coarse, EvidenceConfig()))


def test_looser_limits_show_less():
    inside, outside, _, coarse = some_evidence()
    seen = np.where(coarse, 1, 0).astype(np.float32)
    strict = shows_outside(inside, outside, seen, EvidenceConfig(alone_limit=0.3, hidden_limit=0.1))
    loose = shows_outside(inside, outside, seen, EvidenceConfig(alone_limit=0.6, hidden_limit=0.4))
    assert np.count_nonzero(loose) < np.count_nonzero(strict)
    assert not (loose & ~strict).any()


def test_nothing_in_nothing_out():
    none, mask = np.zeros(0, np.float32), np.zeros(0, np.bool_)
    assert judge(none, none, none, mask, EvidenceConfig()).shape == (0,)
    assert shows_outside(none, none, none, EvidenceConfig()).shape == (0,)
