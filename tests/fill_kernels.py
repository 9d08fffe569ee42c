"""Compiles kernels by calling them, so that they are in the cache when tests start: `python fill_kernels.py PART`.

The parts share no kernel, so that they can be compiled side by side. What is left out is compiled by the first test
that needs it.
"""

import sys

import numpy as np


def drawing():
    """The kernels that draw."""
    import toy

    from gaussian_trimmer.rendering import render, top_contributors
    from gaussian_trimmer.views.virtual_cameras import PlanConfig, plan_cameras

    scene, _ = toy.ball_on_floor()
    (camera, *_), _ = plan_cameras(scene, toy.UP, PlanConfig(size=64))
    render(scene, camera, weights=True)
    top_contributors(scene, camera, np.zeros((1, 2), np.int64), 4)


def searching():
    """Connected points."""
    from gaussian_trimmer.geometry.graphs import connected_points

    points = np.random.default_rng(0).normal(size=(100, 3))
    connected_points(points, 0.5)


def fitting():
    """The derivatives' kernels."""
    from gaussian_trimmer.rendering.gradients import compile_kernels

    compile_kernels()


PARTS = {"drawing": [drawing], "searching and fitting": [searching, fitting]}

if __name__ == "__main__":
    for compile_kernels in PARTS[sys.argv[1]]:
        compile_kernels()
