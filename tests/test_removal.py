"""Removal as a whole: the same whatever the order of rows, however the scene is turned; and what pictures show."""

import numpy as np
import pytest
import toy
from benchmark_data import OWN, open_scene

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import only_training
from gaussian_trimmer.evaluation.ground_truth import views_in
from gaussian_trimmer.evaluation.metrics import likeness
from gaussian_trimmer.geometry.bounds import own_frame, robust_bounds
from gaussian_trimmer.masks.mask_files import find_masks
from gaussian_trimmer.removal.remove import remove
from gaussian_trimmer.removal.views import RemovalViews
from gaussian_trimmer.rendering import blend_values, render
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.views.small_views import views_of_place
from gaussian_trimmer.views.view import grown

SCENE, TRUTH = toy.ball_on_floor(n_ball=1500)
UNTURNED = np.eye(3)


def removed(rows=slice(None), rotation=UNTURNED):
    """What removal says of the toy scene with its rows in an order, turned."""
    scene, truth = toy.moved(SCENE.select(rows), rotation), TRUTH[rows]
    target = scene.select(truth)
    bounds = robust_bounds(target, own_frame(target, rotation @ toy.UP))
    views = RemovalViews(scene, truth, truth, bounds, views_of_place(bounds, 96))
    return remove(views, fill=True)


def test_the_order_of_rows_changes_nothing():
    plain, rows = removed(), np.random.default_rng(1).permutation(len(SCENE))
    permuted = removed(rows)
    assert len(plain.inpainted) > 100
    for name in ("discarded", "replaced"):
        np.testing.assert_array_equal(getattr(permuted, name), getattr(plain, name)[rows], err_msg=name)
    np.testing.assert_allclose(permuted.relight_factor, plain.relight_factor[rows], atol=1e-3)
    np.testing.assert_allclose(permuted.inpainted.means, plain.inpainted.means, atol=1e-4)
    np.testing.assert_allclose(permuted.inpainted.sh_dc, plain.inpainted.sh_dc, atol=1e-2)


@pytest.mark.parametrize("turn", range(3))
def test_what_is_made_up_turns_with_the_scene(turn):
    rotation = toy.any_rotation(turn)
    plain, turned = removed(), removed(rotation=rotation)
    for name in ("discarded", "replaced"):
        assert np.count_nonzero(getattr(plain, name) != getattr(turned, name)) <= 2, name
    assert len(turned.inpainted) == pytest.approx(len(plain.inpainted), rel=0.01)
    np.testing.assert_allclose(
        turned.inpainted.means.mean(axis=0), rotation @ plain.inpainted.means.mean(axis=0), atol=1e-2
    )


def test_what_was_pruned_leaves_where_it_lies_among_the_object_and_stays_where_it_lies_among_others():
    pruned_of_ball, pruned_of_floor = TRUTH & (SCENE.means[:, 2] > 1.7), ~TRUTH & (SCENE.means[:, 0] > 2.6)
    assert pruned_of_ball.sum() > 20
    assert pruned_of_floor.sum() > 20
    alone = np.zeros_like(TRUTH)
    alone[np.flatnonzero(pruned_of_floor)[::7]] = True
    truth = TRUTH & ~pruned_of_ball
    target = SCENE.select(truth)
    bounds = robust_bounds(target, own_frame(target, toy.UP))
    for pruned, stays in ((None, pruned_of_ball), (pruned_of_ball | alone, alone)):
        views = RemovalViews(SCENE, truth, truth, bounds, views_of_place(bounds, 96), pruned=pruned)
        removal = remove(views, fill=False)
        assert not removal.discarded[stays].all()
        assert removal.discarded[pruned_of_ball].all() == (pruned is not None)
    assert not removal.discarded[alone].any()


def test_what_masks_leave_out_of_a_selection_stays_in_the_scene():
    scene, first, second = toy.two_balls(shift=(2.1, 0, 0))
    turns = np.radians(np.arange(0, 360, 40))
    cameras = [toy.camera_at((8 * np.cos(turn), 8 * np.sin(turn), 4), size=120) for turn in turns]
    masks = [(camera, blend_values(scene, camera, first[:, None])[..., 0] > 0.5) for camera in cameras]
    result = trim(scene, first | second, masks=masks, up="z")
    assert np.isin(np.flatnonzero(first), result.objects[0].source_index).mean() > 0.85
    assert np.isin(np.flatnonzero(second), result.background_source).mean() > 0.9


OBJECTS = "fern", "lighthouse", "mug", "robot"


@pytest.mark.slow
@pytest.mark.parametrize("name", OBJECTS)
def test_the_scene_without_an_object_is_what_pictures_without_it_show(name):
    folder = OWN / "tabletop"
    scene = open_scene(folder)
    cameras = read_camera_set(scene.cameras_file)
    others = tuple(folder / "masks" / other for other in OBJECTS if other != name)
    pictured = [camera for camera, _ in find_masks(cameras.pinhole_cameras(), folder / "removed" / name)]
    _, views = views_in(pictured, folder / "masks" / name, folder / "removed" / name, others)
    result = trim(scene.gaussians, scene.coarse(name, "dilated"), cameras=only_training(cameras), up=scene.up)
    scores = [
        likeness(render(result.background, view.camera).rgb, view.image, grown(view.coverage > 0.5, 6) & view.counted)
        for view in views
    ]
    assert len(scores) == 4
    assert np.mean([psnr for psnr, _ in scores]) > 24
