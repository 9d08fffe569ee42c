"""Tests of cuts that are drawn on an object."""

from dataclasses import replace

import numpy as np
import pytest
import toy
from command_line import run, save_ball
from toy import BALL

import gaussian_trimmer as gt
from gaussian_trimmer.cameras import Viewpoint
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.rendering import render
from gaussian_trimmer.selecting.marks import Rows, Stroke, read_marks, write_marks
from gaussian_trimmer.selecting.select import select
from gaussian_trimmer.trimming.arguments import StrokeCut
from gaussian_trimmer.trimming.refinement import Pieces
from gaussian_trimmer.trimming.straddlers import cut_at_stroke

CAMERA = toy.camera_at((0, -8, 1))
LEFT = Stroke(Viewpoint(CAMERA), ((0.0, 0.0), (0.47, 0.0), (0.47, 1.0), (0.0, 1.0)))
"""The left half of the ball, but for a strip."""


def under(gaussians, mask=None):
    """Opacity at the pixels of a mask, those of `LEFT` unless others are given."""
    mask = np.arange(CAMERA.width) < 0.47 * CAMERA.width if mask is None else mask
    return float(render(gaussians, CAMERA).alpha[:, mask].sum())


def cut_up(gaussians, pieces, spared):
    """What is left of Gaussians, of which some are pieces, and what is cut off."""
    whole = Pieces.of(gaussians, np.arange(len(gaussians)))
    return cut_at_stroke(replace(whole, part=np.array(pieces)), cut(spared), gaussians.select(slice(0)))


def cut(spared):
    mask = np.tile(np.arange(CAMERA.width) < 0.47 * CAMERA.width, (CAMERA.height, 1))
    return StrokeCut(CAMERA, mask, np.array(spared), np.zeros(len(spared), np.bool_))


def test_what_crosses_the_edge_of_a_stroke_is_split_there_and_nothing_is_lost():
    wide = toy.gaussians([[0.2, 0, 1], [0.3, 0, 0], [2, 0, 1]], (1.0, 0.05, 0.2), toy.RED)
    made, off = cut_up(wide, [False] * 3, [False, False, True])
    assert made.source[~made.part].tolist() == [2]  # it is spared
    assert set(made.source[made.part]) == set(off.source) == {0, 1}
    assert under(made.gaussians.select(made.source < 2)) < 0.15 * under(wide.select(slice(0, 2)))
    right = np.arange(CAMERA.width) > 0.55 * CAMERA.width
    assert under(made.gaussians, right) == pytest.approx(under(wide, right), rel=0.05)
    whole = render(concatenate([made.gaussians, off.gaussians]), CAMERA).alpha
    assert np.abs(whole - render(wide, CAMERA).alpha).mean() < 0.02


def test_parts_under_a_stroke_go_and_whole_gaussians_there_stay():
    away = toy.gaussians([[-2, 0, 1], [-2, 0, 0.5], [2, 0, 1]], (0.1, 0.1, 0.1), toy.RED)
    made, off = cut_up(away, [True, False, True], [False] * 3)
    assert made.source.tolist() == [1, 2] and off.source.tolist() == [0]


def test_a_stroke_is_saved_with_its_mark_and_cuts_what_is_trimmed_until_it_is_put_back(tmp_path):
    scene, ball = toy.ball_on_floor(n_floaters=0)
    scene = scene.replace(log_scales=scene.log_scales + np.float32(0.7) * ball[:, None])  # so that they cross the edge
    rows = Rows.of(ball & (scene.means[:, 0] < -0.28), "lasso", "remove", LEFT)
    write_marks(select(scene, [BALL, rows], up="z").marks, tmp_path / "cut.json")
    marks = read_marks(tmp_path / "cut.json")
    stroke = marks.marks[-1].cut
    assert (stroke.places, stroke.radius) == (LEFT.places, None)
    assert np.array_equal(stroke.view.camera.world_to_camera, CAMERA.world_to_camera)

    def trimmed(*given):
        return gt.trim_objects(scene, {1: select(scene, given, up="z")}).object

    whole, uncut, made = trimmed(BALL), trimmed(BALL, replace(rows, cut=None)), trimmed(*marks.marks)
    assert under(made) < 0.6 * under(uncut) < 0.3 * under(whole)
    assert under(trimmed(*marks.marks, Rows.of(ball, "lasso"))) > 0.9 * under(whole)


def test_an_array_holds_no_strokes_and_whoever_trims_one_is_told(tmp_path, capsys):
    save_ball(tmp_path)
    scene, ball = toy.ball_on_floor()
    rows = Rows.of(ball & (scene.means[:, 0] < -0.28), "lasso", "remove", LEFT)
    write_marks(select(scene, [BALL, rows], up="z").marks, tmp_path / "cut.json")
    given = (str(tmp_path / "scene.ply"), "--marks", str(tmp_path / "cut.json"), "--output", str(tmp_path / "a.npy"))
    assert run("select", *given) == 0
    assert "".join(capsys.readouterr().out.split("\n")).endswith(f"scene.ply {tmp_path / 'a.json'}")
    assert run("trim", str(tmp_path / "scene.ply"), str(tmp_path / "a.npy"), "--output", str(tmp_path / "out")) == 0
    assert "a.json as the selection" in " ".join(capsys.readouterr().out.split())
