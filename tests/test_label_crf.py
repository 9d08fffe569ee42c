"""Correction of labels over patches of coloured Gaussians."""

import numpy as np
import pytest
from toy import BLUE, RED, gaussians

from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.trimming.label_crf import LabelCrfConfig, correct_labels

CONFIG = LabelCrfConfig()


def patch(seed=0, n=900, noise=0.01):
    """A flat square [-1, 1]^2, red at the left and blue at the right, and which of it is red."""
    rng = np.random.default_rng(seed)
    means = rng.uniform(-1, 1, (n, 3)) * [1, 1, 0]
    red = means[:, 0] < 0
    colours = np.where(red[:, None], RED, BLUE) + rng.normal(0, noise, (n, 3))
    return gaussians(means, (0.03,) * 3, colours), red


def visible(thing, weight=5.0):
    return np.full(len(thing), weight, np.float32)


def corrected(thing, selection, seen=None, radius=1.0, config=CONFIG):
    """The patch stands upright, so it is no surface that anything could rest on."""
    upright = Bounds(np.zeros(3), np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), np.array([0, radius, 0]))
    return correct_labels(thing, selection, visible(thing) if seen is None else seen, upright, config)


def test_wrong_labels_inside_uniform_blobs_are_corrected():
    thing, red = patch()
    wrong = np.zeros(len(red), np.bool_)
    wrong[np.flatnonzero(np.abs(thing.means[:, 0]) > 0.3)[::40]] = True
    assert wrong[red].any()
    assert wrong[~red].any()
    np.testing.assert_array_equal(corrected(thing, red ^ wrong) > 0.5, red)


@pytest.mark.parametrize("shift", [-0.1, 0.1])
def test_a_boundary_beside_a_colour_edge_moves_to_the_edge(shift):
    thing, red = patch()
    rough = thing.means[:, 0] < shift
    assert np.count_nonzero(rough != red) > 30
    assert np.count_nonzero((corrected(thing, rough) > 0.5) != red) <= 3


def test_where_nearly_everything_is_selected_nobody_knows_the_colours_of_the_rest():
    """Two Gaussians of a dark spot on a speckled patch are not selected, and hardly seen."""
    thing, _ = patch()
    colours = np.random.default_rng(1).uniform(-1.5, 1.5, thing.sh_dc.shape).astype(np.float32)
    spot = np.flatnonzero(np.linalg.norm(thing.means[:, :2] - 0.4, axis=1) < 0.2)
    colours[spot] = -1.6
    selection, seen = np.ones(len(thing), np.bool_), visible(thing)
    selection[spot[:2]], seen[spot[:2]] = False, 0.2
    changed = corrected(thing.replace(sh_dc=colours), selection, seen) < 0.5
    assert len(spot) > 20
    assert not changed[selection].any()


def test_a_plinth_of_the_colour_of_the_ground_keeps_its_foot():
    """A column stands on a red ground; its foot is as red, what is above it blue."""
    rng = np.random.default_rng(0)
    floor = rng.uniform(-2, 2, (6000, 3)) * [1, 1, 0]
    floor = floor[np.linalg.norm(floor[:, :2], axis=1) > 0.5]
    height, turn = rng.uniform(0, 1.2, 600), rng.uniform(0, 2 * np.pi, 600)
    wall = np.stack([0.5 * np.cos(turn), 0.5 * np.sin(turn), height], axis=1)
    means = np.concatenate([floor, wall])
    colours = np.where(means[:, 2:] < 0.2, RED, BLUE) + rng.normal(0, 0.01, means.shape)
    of_column = np.arange(len(means)) >= len(floor)
    bounds = Bounds(np.array([0, 0, 0.6]), np.eye(3), np.array([0.5, 0.5, 0.6]))
    thing = gaussians(means, (0.03,) * 3, colours)
    kept = correct_labels(thing, of_column, visible(thing), bounds, CONFIG) > 0.5
    assert kept[of_column & (means[:, 2] > 0.1)].all()
    assert not kept[~of_column].any()


def test_a_straight_boundary_without_any_colour_edge_stays_about_where_it_is():
    thing, _ = patch()
    plain = thing.replace(sh_dc=np.zeros_like(thing.sh_dc))
    selection = plain.means[:, 0] < 0.2
    changed = (corrected(plain, selection) > 0.5) != selection
    assert (np.abs(plain.means[changed, 0] - 0.2) < 0.15).all()


@pytest.mark.parametrize("side", [1, -1])
def test_labels_are_believed_as_far_as_others_of_their_side_are_right(side):
    thing, red = patch(n=2500, noise=0.12)
    x = side * thing.means[:, 0]
    truth, near = x < 0, np.abs(x) < 0.1
    assert (truth == (red if side > 0 else ~red)).all()

    def certainty(selection):
        probability = corrected(thing, selection)
        assert np.count_nonzero((probability > 0.5) != truth) <= 2
        odds = np.abs(np.log(probability / (1 - probability + 1e-9) + 1e-9))
        return np.median(odds[near & truth]), np.median(odds[near & ~truth])

    right, wide, narrow = (certainty(x < edge) for edge in (0, 0.15, -0.15))
    assert wide[1] < 0.6 * right[1]
    assert wide[1] < 0.6 * wide[0]
    assert narrow[0] < 0.6 * right[0]
    assert narrow[0] < 0.6 * narrow[1]


def with_hidden():
    """The patch with a ninth of it wrongly labelled and shown by no view: both labels, visible weights, what is."""
    thing, red = patch()
    hidden = np.arange(len(red)) % 9 == 0
    return thing, red, red ^ hidden, np.where(hidden, 0, visible(thing)).astype(np.float32), hidden


def test_what_no_view_shows_follows_what_surrounds_it():
    thing, red, rough, seen, hidden = with_hidden()
    probability = corrected(thing, rough, seen)
    deep = hidden & (np.abs(thing.means[:, 0]) > 0.3)
    # The log-odds are 4 by all neighbours, and 1 by a label of its own.
    np.testing.assert_array_equal(probability[deep] > 0.5, red[deep])
    np.testing.assert_allclose(probability[deep & red], 1 / (1 + np.exp(-3)), atol=0.01)
    right = corrected(thing, red, seen)
    np.testing.assert_allclose(right[deep & red], 1 / (1 + np.exp(-5)), atol=0.01)


def test_between_two_sides_the_label_of_what_no_view_shows_decides():
    means = np.concatenate([np.random.default_rng(0).normal(side, 0.02, (40, 3)) for side in (-0.3, 0.3)])
    middle = np.zeros((2, 3), np.float32)
    thing = gaussians(np.concatenate([means, middle]), (0.03,) * 3, np.full((82, 3), 0.5))
    selection = np.concatenate([np.arange(80) < 40, [True, False]])
    seen = np.concatenate([np.full(80, 5.0), [0, 0]]).astype(np.float32)
    every = LabelCrfConfig(k_neighbours=80, position_sigma=1.0)
    np.testing.assert_allclose(corrected(thing, selection, seen, config=every)[-2:], [0.73, 0.27], atol=0.1)


def test_labels_of_what_no_view_shows_tell_nothing_of_what_is_seen():
    thing, red, rough, seen, hidden = with_hidden()
    np.testing.assert_array_equal(corrected(thing, rough, seen)[~hidden], corrected(thing, red, seen)[~hidden])


@pytest.mark.parametrize("n_seen", [2, 5])
def test_more_hidden_neighbours_than_visible_gaussians(n_seen):
    thing, red = patch()
    seen = np.zeros(len(red), np.float32)
    seen[np.flatnonzero(red)[: n_seen - 1]] = seen[np.flatnonzero(~red)[0]] = 5
    probability = corrected(thing, red, seen)
    assert ((probability >= 0) & (probability <= 1)).all()


def test_disabled_it_returns_the_selection():
    thing, red = patch()
    rough = red ^ (np.arange(len(red)) % 7 == 0)
    np.testing.assert_array_equal(corrected(thing, rough, config=LabelCrfConfig(enabled=False)), rough)


@pytest.mark.parametrize("label", [True, False])
def test_with_one_label_only_there_is_nothing_to_correct(label):
    thing, red = patch()
    np.testing.assert_array_equal(corrected(thing, np.full_like(red, label)), np.full(len(red), float(label)))


@pytest.mark.parametrize("n", [2, 3, 17])
def test_fewer_gaussians_than_neighbours(n):
    thing = gaussians(np.arange(3.0 * n).reshape(n, 3), (0.1,) * 3, np.linspace(RED, BLUE, n))
    selection = np.arange(n) < n // 2
    probability = corrected(thing, selection)
    assert np.isfinite(probability).all()
    assert probability[0] > probability[-1]


def test_gaussians_on_one_spot_and_of_one_colour():
    thing = gaussians(np.zeros((50, 3)), (0.1,) * 3, RED)
    probability = corrected(thing, np.arange(50) < 40)
    assert np.isfinite(probability).all()
