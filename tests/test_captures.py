"""Captures made to be hard to trim: a tiny one is a benchmark scene, and a fit approaches its pictures."""

import benchmark_data
import numpy as np
import pytest
from captures import FitOptions, refit, room
from quality import trials
from refits import fit, photograph, psnr, thinned
from rooms import make_room

from gaussian_trimmer.rendering.tile_renderer import draw

QUICK = FitOptions(steps=5, fine_steps=1, scale=0.5)


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = tmp_path_factory.mktemp("captures")
    room("b", 300, root / "room_b", QUICK, coarseness=6.0, picture_scale=0.25)
    return root


def test_a_room_is_a_benchmark_scene(root):
    scene = benchmark_data.open_scene(root / "room_b")
    assert (len(scene.training_cameras), len(scene.test_frames)) == (40, 8)
    assert scene.objects == ["cupboard", "drawers", "radiator"] and scene.up.tolist() == [0, 0, 1]
    assert 200 < len(scene.gaussians) <= 300
    found = list(trials(root, ("drawers",)))
    assert {trial.kind for trial in found} >= {"exact", "dilated", "centre_vote", "three_views", "wobbly"}
    assert all(trial.before.selection.any() and len(trial.views) == 8 for trial in found)


def test_a_scene_is_seen_by_fewer_gaussians_and_haze(root, capsys):
    options = FitOptions(steps=2, fine_steps=0, scale=0.5, haze=0.1)
    refit(root / "room_b", root, 120, "fewer", options)
    scene, source = benchmark_data.open_scene(root / "fewer"), benchmark_data.open_scene(root / "room_b")
    assert 60 < len(scene.gaussians) <= 120 and "PSNR" in capsys.readouterr().out
    view = source.training_cameras[0].name
    np.testing.assert_array_equal(scene.coverage("drawers", view), source.coverage("drawers", view))


def test_fitting_brings_a_scene_closer_to_the_pictures():
    made, rng = make_room("c", 8.0, 0.2), np.random.default_rng(0)
    views = photograph(made.seen_from, made.training[::8], 0.0, rng)
    few = thinned(made.gaussians, views, 200, rng)
    before, after = (
        np.mean([psnr(draw(g, [v.camera]), v.picture[:3]) for v in views]) for g in (few, fit(few, views, 30, rng))
    )
    assert after > before + 1
