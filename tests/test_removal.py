"""Removal as a whole: the same whatever the order of rows, also over a level floor, where depths are equal."""

import numpy as np
import toy

from gaussian_trimmer.geometry.bounds import robust_bounds, up_frame
from gaussian_trimmer.planning.place_views import views_of_place
from gaussian_trimmer.removal.remove import remove
from gaussian_trimmer.removal.views import RemovalViews
from gaussian_trimmer.rendering import get_renderer

SCENE, TRUTH = toy.ball_on_floor(n_ball=1500)


def removed(rows):
    """What removal says of the toy scene with its rows in an order."""
    scene, truth = SCENE.select(rows), TRUTH[rows]
    bounds = robust_bounds(scene.select(truth), up_frame(toy.UP))
    views = RemovalViews(scene, truth, truth, bounds, views_of_place(bounds, 96), get_renderer("numba"))
    return remove(views, fill=True)


def test_the_order_of_rows_changes_nothing():
    plain, rows = removed(np.arange(len(SCENE))), np.random.default_rng(1).permutation(len(SCENE))
    permuted = removed(rows)
    assert len(plain.inpainted) > 100
    for name in ("occluded_interior", "fragments_of_object", "replaced"):
        np.testing.assert_array_equal(getattr(permuted, name), getattr(plain, name)[rows], err_msg=name)
    np.testing.assert_allclose(permuted.relight_factor, plain.relight_factor[rows], atol=1e-3)
    np.testing.assert_allclose(permuted.inpainted.means, plain.inpainted.means, atol=1e-4)
    np.testing.assert_allclose(permuted.inpainted.sh_dc, plain.inpainted.sh_dc, atol=1e-2)
