"""Tests of the graph of visible Gaussians around a point."""

import numpy as np
import pytest
import toy
from test_clicks import camera_at

from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.selecting.surface_graph import axis_ends, build_surface_graph

RENDERER = get_renderer("numba")
CAMERA = camera_at((7, 0, 4.5), toy.POLE_TOP)


def graph_of(scene, candidates=None, **options):
    candidates = np.ones(len(scene), bool) if candidates is None else candidates
    return build_surface_graph(scene, CAMERA, toy.POLE_TOP, 1.0, candidates, toy.UP, RENDERER, **options)


@pytest.fixture(scope="module")
def pole():
    scene, part = toy.ball_on_pole()
    return scene, part, graph_of(scene)


def test_edges_across_a_groove_and_a_change_of_colour_are_weak(pole):
    _, part, graph = pole
    sides = part[graph.rows][graph.edges]

    def strength(a, b):
        chosen = (sides.min(axis=1) == min(a, b)) & (sides.max(axis=1) == max(a, b))
        return graph.weights[chosen].sum() / graph.lengths[chosen].sum()

    assert strength(toy.BALL, toy.BALL) > 0.5
    assert strength(toy.BALL, toy.POLE) < 0.4 * strength(toy.BALL, toy.BALL)
    assert strength(toy.BALL, toy.NEIGHBOUR) < 0.4 * strength(toy.BALL, toy.BALL)
    assert strength(toy.POLE, toy.FLOOR) < 0.2 * strength(toy.BALL, toy.BALL)


def test_areas_and_lengths_are_those_of_the_surface(pole):
    """The ball's area is 4 pi; a cut around its equator is 2 pi long, up to the same factor at any density."""
    _, part, graph = pole
    ball = part[graph.rows] == toy.BALL
    assert graph.areas[ball].sum() == pytest.approx(4 * np.pi, rel=0.5)
    full, half = toy.ball_on_pole(neighbour=False), toy.ball_on_pole(neighbour=False)
    lengths = []
    for scene, parts in (full, (half[0].select(slice(None, None, 2)), half[1][::2])):
        sparse = graph_of(scene, parts == toy.BALL)
        lengths.append(sparse.boundary(sparse.means[:, 0] > 0)[1])
    assert lengths[1] == pytest.approx(lengths[0], rel=0.15)


def test_the_first_view_sees_the_front_and_all_views_see_the_back(pole):
    _, part, graph = pole
    ball = part[graph.rows] == toy.BALL
    front = graph.means[:, 0] > 0.4
    assert graph.visible_in_view[ball & front].all()
    assert not graph.visible_in_view[ball & (graph.means[:, 0] < -0.6)].any()
    assert np.count_nonzero(ball) > 0.95 * np.count_nonzero(part == toy.BALL)


def test_training_cameras_limit_the_views(pole):
    scene, part, _ = pole
    graph = graph_of(scene, seen_from=[CAMERA])
    behind = (part[graph.rows] == toy.BALL) & (graph.means[:, 0] < -0.8)
    assert not behind.any()
    assert (part[graph.hidden] == toy.BALL).any()


def test_hidden_gaussians_follow_the_nodes_beside_them(pole):
    scene, part, _ = pole
    graph = graph_of(scene, part != toy.NEIGHBOUR)
    ball = part[graph.rows] == toy.BALL
    everything = np.ones(len(scene), bool)
    whole = graph.with_hidden(scene, ball, everything)
    assert (whole & (part == toy.NEIGHBOUR)).any()
    kept = graph.with_hidden(scene, ball, part != toy.NEIGHBOUR)
    assert not (kept & (part == toy.NEIGHBOUR)).any()


def test_certain_background_shapes_the_cut(pole):
    """Nodes that are certainly background are left out of the cut, but their edges count."""
    _, part, graph = pole
    ball = part[graph.rows] == toy.BALL
    unaries = np.where(ball, 0.2, -0.2) * graph.areas
    as_constraint = graph.cut(np.where(ball, unaries, -np.inf))
    as_weight = graph.cut(np.where(ball, unaries, -1e3))
    np.testing.assert_array_equal(as_constraint, as_weight)
    assert as_constraint[ball].mean() > 0.95


def test_colours_tell_the_ball_from_the_floor_but_not_from_the_pole(pole):
    _, part, graph = pole
    red = part[graph.rows] != toy.FLOOR
    ratio, accuracy = graph.colour_evidence(red)
    assert accuracy > 0.95
    assert (ratio[red] > 0).mean() > 0.95
    _, alike = graph.colour_evidence(part[graph.rows] == toy.BALL)
    assert alike < accuracy


def test_ends_of_the_longest_axis():
    one = toy.gaussians([[1.0, 2.0, 3.0]], [[0.1, 0.5, 0.2]], toy.RED)
    ends = np.sort(np.concatenate(axis_ends(one)), axis=0)
    np.testing.assert_allclose(ends, [[1, 1, 3], [1, 3, 3]], atol=1e-6)
