"""What hangs in the air without the object: things stay and are told, or leave with it; remnants go."""

from dataclasses import replace

import numpy as np
import toy

from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.trimming.trim import trim

SCENE, TRUTH = toy.ball_on_floor(n_ball=1500)
RNG = np.random.default_rng(0)
SPLINTER = toy.gaussians([[1.06, 0, 1.2], [1.1, 0, 1.25]], 0.06, toy.WHITE)
CONFIG = toy.small_config()


def small_ball(centre, count=60, radius=0.25):
    """A blue ball."""
    outward = RNG.normal(size=(count, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    return toy.gaussians(np.asarray(centre) + radius * outward, 0.08, toy.BLUE)


def trimmed(more, **options):
    """The trim of the ball in the scene with more Gaussians at its end, and where these are."""
    scene = concatenate([SCENE, more])
    result = trim(scene, np.append(TRUTH, np.zeros(len(more), np.bool_)), config=replace(CONFIG, **options))
    rows = np.arange(len(SCENE), len(scene))
    return result, np.isin(rows, result.objects[0].source_index), np.isin(rows, result.background_source)


def test_what_stands_on_the_object_stays_and_is_told():
    result, in_object, in_background = trimmed(small_ball([0, 0, 2.25]))
    assert in_background.mean() > 0.7
    assert in_object.mean() < 0.2
    assert "1 thing" in result.rest.warnings[1][0]
    assert "--with-what-stands-on-it" in result.rest.warnings[1][0]


def test_it_leaves_with_the_object_if_that_is_asked_for():
    result, in_object, in_background = trimmed(small_ball([0, 0, 2.25]), with_what_stands_on_it=True)
    assert in_object.mean() < 0.2
    assert not in_background.any()
    assert not result.rest.warnings[1]


def test_what_stands_beside_the_object_has_its_own_hold():
    for option in (False, True):
        result, _, in_background = trimmed(small_ball([1.6, 0, 0.25]), with_what_stands_on_it=option)
        assert in_background.all()
        assert not result.rest.warnings[1]


def test_splinters_do_not_stay_in_the_air():
    result, _, in_background = trimmed(SPLINTER)
    assert not in_background.any()
    assert not result.rest.warnings[1]


def test_a_remnant_within_the_bounds_goes_with_the_object():
    result, _, in_background = trimmed(small_ball([0.78, 0, 1.78], 30, 0.1))
    assert not in_background.any()
    assert not result.rest.warnings[1]


def test_what_reaches_out_of_the_bounds_is_no_remnant():
    _, in_object, in_background = trimmed(toy.gaussians([[0.86, 0, 1.86], [0.88, 0.05, 1.88]], 0.1, toy.WHITE))
    assert not in_object.any()
    assert not in_background.any()
