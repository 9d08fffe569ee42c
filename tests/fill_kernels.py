"""Compiles kernels by calling them, so that they are in the cache when tests start: `python fill_kernels.py PART`.

The parts share no kernel, so that they can be compiled side by side. What is left out is compiled by the first test
that needs it.
"""

import sys

import numpy as np


def drawing():
    """The renderer's kernels."""
    import toy

    from gaussian_trimmer.planning.virtual_cameras import PlanConfig, plan_cameras
    from gaussian_trimmer.rendering import get_renderer

    scene, _ = toy.ball_on_floor()
    (camera, *_), _ = plan_cameras(scene, toy.UP, PlanConfig(size=64))
    renderer = get_renderer("numba")
    renderer.render(scene, camera, weights=True)
    renderer.top_contributors(scene, camera, np.zeros((1, 2), np.int64), 4)


def searching():
    """Nearest neighbours, connected points, cuts."""
    from gaussian_trimmer.geometry.components import connected_bodies, connected_points
    from gaussian_trimmer.geometry.kd_tree import nearest
    from gaussian_trimmer.geometry.min_cut import min_cut

    points = np.random.default_rng(0).normal(size=(100, 3))
    nearest(points.astype(np.float32), points.astype(np.float32), 2)
    connected_points(points, 0.5)
    connected_bodies(points[:, None], 0.5)
    min_cut(np.ones(2), np.array([[0, 1]]), np.ones(1))


def fitting():
    """The derivatives' kernels, by the types that they are called with."""
    from numba import boolean, float32, float64, int32, int64, types, uint8

    from gaussian_trimmer.rendering import gradient_kernels
    from gaussian_trimmer.rendering.projection_kernels import Ellipsoids, Pinhole, Tiles

    table, images = float32[:, ::1], float32[:, :, ::1]
    tiles = types.NamedTuple((int64, int64[::1], int32[::1], uint8[:, ::1], int64, int64), Tiles)
    jobs = types.UniTuple(int64, 2)
    gradient_kernels.robust_slopes.compile((images, images, images, float32, float32))
    shown, sums = types.UniTuple(images, 2), types.Tuple((table, boolean[::1]))
    gradient_kernels.differentiate_tiles.compile((table, table, boolean[::1], tiles, shown, sums, jobs))
    gradient_kernels.sum_moving_pairs.compile((table, int64[::1], int32[::1], boolean[::1], table))
    ellipsoids = types.NamedTuple((table, table, table, float32[::1]), Ellipsoids)
    pinhole = types.NamedTuple((float64[:, ::1], float64[::1], float64[::1], float64[::1]), Pinhole)
    gradient_kernels.gather.compile((ellipsoids, pinhole, table, table, table, table))


PARTS = {"drawing": [drawing], "searching and fitting": [searching, fitting]}

if __name__ == "__main__":
    for compile_kernels in PARTS[sys.argv[1]]:
        compile_kernels()
