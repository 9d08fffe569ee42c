"""Tests of black Gaussians around an object that was captured alone."""

import numpy as np
import toy

from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.trimming.fringe import find_black_fringe
from gaussian_trimmer.trimming.trim import trim

BLACK = (-0.1, -0.1, -0.1)


def ball_and_needles(count=200, seed=0):
    """A ball with a black cap, and thin black needles in the air around it; which Gaussians are needles, (N,)."""
    rng = np.random.default_rng(seed)
    scene, truth = toy.ball_on_floor(n_ball=1500, n_floaters=0)
    ball = scene.select(truth)
    cap = ball.means[:, 2] > toy.CENTRE[2] + 0.6 * toy.RADIUS
    ball = ball.replace(sh_dc=np.where(cap[:, None], toy.gaussians(toy.CENTRE, 1, BLACK).sh_dc, ball.sh_dc))
    outward = rng.normal(size=(count, 3))
    outward *= toy.RADIUS * rng.uniform(1.25, 1.8, (count, 1)) / np.linalg.norm(outward, axis=1, keepdims=True)
    needles = toy.gaussians(toy.CENTRE + outward, (0.08, 0.015, 0.015), BLACK)
    return concatenate([ball, needles]), np.arange(len(ball) + count) >= len(ball)


def test_needles_in_the_air_are_fringe_and_a_black_part_is_not():
    scene, needles = ball_and_needles()
    fringe = find_black_fringe(scene)
    assert fringe[needles].mean() > 0.95
    assert not fringe[~needles].any()


def test_permuted_and_moved_gaussians_give_the_permuted_answer():
    scene, _ = ball_and_needles()
    order = np.random.default_rng(1).permutation(len(scene))
    moved = toy.moved(scene, toy.any_rotation(), 40.0)
    np.testing.assert_array_equal(find_black_fringe(scene)[order], find_black_fringe(moved.select(order)))


def test_what_is_all_black_or_has_nothing_black_has_no_fringe():
    scene, needles = ball_and_needles()
    assert not find_black_fringe(scene.select(needles)).any()
    assert not find_black_fringe(toy.ball_on_floor()[0]).any()


def test_a_trim_of_an_object_alone_leaves_its_fringe_out():
    scene, needles = ball_and_needles()
    result = trim(scene, np.ones(len(scene), bool), config=toy.small_config())
    kept = toy.object_rows(result)
    assert kept[needles].mean() < 0.05
    assert kept[~needles].mean() > 0.95
