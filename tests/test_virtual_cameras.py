"""Cameras around boxes, balls and rough selections: distances by hand, angles, and what must not move them."""

import numpy as np
import pytest
from toy import RADIUS, RED, UP, ball_on_floor, gaussians, moved, with_floaters

from gaussian_trimmer.cameras import Camera, intrinsics, look_at, up_frame
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.geometry.bounds import dominant_cluster, plain_bounds, robust_bounds, touching
from gaussian_trimmer.views.virtual_cameras import PlanConfig, plan_cameras


def box(half=(1.0, 0.5, 2.0), centre=(3.0, -1.0, 0.5), n=24):
    """A dense box of Gaussians, half extents along x, y and z."""
    steps = np.linspace(-1, 1, n)
    return gaussians(
        np.stack(np.meshgrid(steps, steps, steps), -1).reshape(-1, 3) * half + centre, (0.05,) * 3, (0.5, 0.5, 0.5)
    )


def centres(cameras):
    return np.array([camera.centre for camera in cameras])


def yaws_and_pitches(cameras, bounds):
    local = (centres(cameras) - bounds.centre) @ bounds.axes.T
    yaws = np.degrees(np.arctan2(local[:, 1], local[:, 0]))
    return yaws % 360, np.degrees(np.arcsin(local[:, 2] / np.linalg.norm(local, axis=1)))


def ring(yaws_degrees, pitch_degrees=10.0, radius=6.0, target=(3.0, -1.0, 0.5)):
    """Training cameras at yaws in the frame that the planner uses for the up vector z."""
    yaws, pitch = np.radians(yaws_degrees), np.radians(pitch_degrees)
    flat = np.cos(pitch)
    directions = np.stack([np.cos(yaws) * flat, np.sin(yaws) * flat, np.full_like(yaws, np.sin(pitch))], 1)
    positions = directions @ up_frame(UP) * radius + target
    K = intrinsics(0.9, 64, 64)
    return [Camera(look_at(place, np.array(target), UP), K, 64, 64) for place in positions]


def test_all_cameras_look_at_the_bounds_centre_and_stand_upright():
    cameras, bounds = plan_cameras(box(), UP)
    for camera in cameras:
        pixels, depths = camera.project(bounds.centre[None])
        np.testing.assert_allclose(pixels, [[256, 256]], atol=1e-6)
        assert depths[0] > 0
        assert camera.rotation[1] @ UP < 0  # the image's down axis points down
        np.testing.assert_allclose(camera.rotation[0] @ UP, 0, atol=1e-12)


@pytest.mark.parametrize("fill", [0.5, 0.75])
def test_fit_is_the_smallest_distance_at_which_the_bounds_fill_that_share_of_a_view(fill):
    cameras, bounds = plan_cameras(box(), UP, PlanConfig(fill=fill))
    reach = [np.abs(camera.project(bounds.corners())[0] - 256).max() / 256 for camera in cameras]
    assert max(reach) == pytest.approx(fill, abs=1e-9)


def test_literal_distance_is_the_larger_of_both_extents_by_their_lambdas_from_the_plain_centroid():
    thing = concatenate([box(), gaussians([[3.5, -1, 0.5]] * 2000, (0.05,) * 3, (0.5, 0.5, 0.5))])
    centroid = thing.means.astype(np.float64).mean(0)
    assert centroid[0] > 3.05
    for lambdas, distance in [((20.0, 6.0), 20.0 * 2), ((3.0, 6.0), 6.0 * 4)]:  # max(l, w) = 2 and h = 4
        config = PlanConfig(framing="literal", lambda_1=lambdas[0], lambda_2=lambdas[1])
        cameras, _ = plan_cameras(thing, UP, config)
        np.testing.assert_allclose(np.linalg.norm(centres(cameras) - centroid, axis=1), distance, rtol=1e-6)
        np.testing.assert_allclose(cameras[2].project(centroid[None])[0], [[256, 256]], atol=1e-3)


def test_the_papers_views_are_about_the_plain_centroid_and_filled():
    thing = concatenate([box(), gaussians([[3.5, -1, 0.5]] * 2000, (0.05,) * 3, (0.5, 0.5, 0.5))])
    centroid = thing.means.astype(np.float64).mean(0)
    cameras, bounds = plan_cameras(thing, UP, PlanConfig(framing="paper", fill=0.75))
    np.testing.assert_allclose(cameras[2].project(centroid[None])[0], [[256, 256]], atol=1e-3)
    reach = [np.abs(camera.project(bounds.corners())[0] - 256).max() / 256 for camera in cameras]
    assert max(reach) == pytest.approx(0.75, abs=1e-9)  # all of it is seen, and as large as it can be
    literal, _ = plan_cameras(thing, UP, PlanConfig(framing="literal"))
    assert np.ptp(literal[0].project(bounds.corners())[0], axis=0).max() < 0.2 * 512  # eq. 3 as it is printed


def test_yaws_are_uniform_over_the_circle_at_thirty_degrees_pitch():
    yaws, pitches = yaws_and_pitches(*plan_cameras(box(), UP, PlanConfig(views=5)))
    np.testing.assert_allclose(np.diff(np.append(yaws, yaws[0] + 360)), 72, atol=1e-6)
    np.testing.assert_allclose(pitches, 30, atol=1e-6)


def test_given_yaw_range_and_pitch_are_kept():
    config = PlanConfig(views=3, yaw_range_degrees=(10, 100), pitch_degrees=-12)
    yaws, pitches = yaws_and_pitches(*plan_cameras(box(), UP, config, ring(np.arange(0, 360, 20))))
    assert yaws.min() >= 10 - 1e-6
    assert yaws.max() <= 100 + 1e-6
    np.testing.assert_allclose(np.diff(yaws), 30, atol=1e-6)
    np.testing.assert_allclose(pitches, -12, atol=1e-6)


@pytest.mark.parametrize("middle", [40.0, 180.0, 355.0])  # one span holds the seam of arctan2, one that of 0 degrees
def test_forward_facing_training_cameras_limit_yaw_and_pitch(middle):
    cameras, bounds = plan_cameras(box(), UP, training_cameras=ring(middle + np.linspace(-12, 12, 7)))
    yaws, pitches = yaws_and_pitches(cameras, bounds)
    assert np.abs((yaws - middle + 180) % 360 - 180).max() < 12.5
    assert len(np.unique(yaws.round(6))) == 5
    np.testing.assert_allclose(pitches, 10, atol=1.5)


def test_one_training_camera_from_above_does_not_raise_the_pitch():
    training_cameras = ring(np.linspace(-12, 12, 7), target=robust_bounds(box(), up_frame(UP)).centre)
    cameras, bounds = plan_cameras(
        box(), UP, training_cameras=[*training_cameras, *ring(np.zeros(1), pitch_degrees=70)]
    )
    np.testing.assert_allclose(yaws_and_pitches(cameras, bounds)[1], 10, atol=0.5)


def test_training_cameras_all_around_leave_the_full_circle():
    yaws, _ = yaws_and_pitches(*plan_cameras(box(), UP, training_cameras=ring(np.arange(0, 360, 30))))
    np.testing.assert_allclose(np.diff(np.sort(yaws)), 72, atol=1e-6)


def test_far_floaters_do_not_move_robust_bounds_but_ruin_plain_ones():
    scene, truth = ball_on_floor()
    axes = up_frame(UP)
    ball, rough = scene.select(truth), scene.select(with_floaters(scene, truth))
    clean, robust, plain = robust_bounds(ball, axes), robust_bounds(rough, axes), plain_bounds(rough, axes)
    np.testing.assert_allclose(robust.centre, clean.centre, atol=0.02 * RADIUS)
    np.testing.assert_allclose(robust.half_extents, clean.half_extents, rtol=0.02)
    assert plain.radius > 5 * clean.radius


def test_transparent_gaussians_do_not_move_robust_bounds_however_many_they_are():
    thing = box()
    far = thing.means[:, None] + np.float32([[9, 0, 0], [9.01, 0.01, 0]])
    haze = gaussians(far.reshape(-1, 3), (0.05,) * 3, (1, 1, 1), 1e-4)
    alone, hazy = (robust_bounds(target, up_frame(UP)) for target in (thing, concatenate([thing, haze])))
    np.testing.assert_allclose(hazy.centre, alone.centre, atol=1e-5)
    np.testing.assert_allclose(hazy.half_extents, alone.half_extents, rtol=1e-5)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("framing", ["fit", "paper", "literal"])
def test_cameras_scale_with_the_scene(scale, framing):
    thing, config = box(), PlanConfig(framing=framing)
    cameras, _ = plan_cameras(thing, UP, config)
    scaled, _ = plan_cameras(moved(thing, np.eye(3), scale), 7 * UP, config)
    np.testing.assert_allclose(centres(scaled), scale * centres(cameras), rtol=1e-5, atol=1e-4 * scale)
    np.testing.assert_allclose([c.rotation for c in scaled], [c.rotation for c in cameras], atol=1e-5)


@pytest.mark.parametrize("framing", ["fit", "paper", "literal"])
def test_cameras_turn_with_the_scene(framing):
    cycle = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # x to y to z to x, which the choice of axes follows
    thing, config = box(), PlanConfig(framing=framing)
    cameras, _ = plan_cameras(thing, UP, config)
    turned, _ = plan_cameras(moved(thing, cycle), cycle @ UP, config)
    np.testing.assert_allclose(centres(turned), centres(cameras) @ cycle.T, rtol=1e-5)


def test_up_frame_is_right_handed_for_every_direction():
    for up in np.random.default_rng(0).normal(size=(20, 3)):
        axes = up_frame(up)
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
        np.testing.assert_allclose(np.cross(axes[0], axes[1]), up / np.linalg.norm(up), atol=1e-12)


def blobs(*sizes, apart=10.0, opacity=0.95, seed=0):
    """Balls of that many Gaussians in a row, and which ball each Gaussian is of, (N,)."""
    which = np.repeat(np.arange(len(sizes)), sizes)
    means = np.random.default_rng(seed).normal(0, 0.3, (len(which), 3)) + apart * which[:, None] * [1, 0, 0]
    return gaussians(means, (0.05,) * 3, (0.5, 0.5, 0.5), opacity), which


@pytest.mark.parametrize(("sizes", "kept"), [((1000, 400), (0, 1)), ((1000, 150), (0,)), ((1000, 400, 150), (0, 1))])
def test_clusters_of_a_quarter_of_the_heaviest_are_kept(sizes, kept):
    thing, which = blobs(*sizes)
    share = [dominant_cluster(thing)[which == blob].mean() for blob in range(len(sizes))]
    np.testing.assert_allclose(share, [blob in kept for blob in range(len(sizes))], atol=0.08)


def test_a_sparse_trunk_below_a_dense_crown_counts_and_what_floats_far_below_does_not():
    rng = np.random.default_rng(0)
    crown, trunk = rng.normal([0, 0, 3], 0.3, (1000, 3)), np.stack([*np.zeros((2, 20)), np.linspace(0, 2.2, 20)], 1)
    tree = gaussians(np.concatenate([crown, trunk, [[0, 0, -3]]]), (0.02,) * 3, (0.5, 0.5, 0.5))
    kept = dominant_cluster(tree)
    assert kept[1000:1020].all()
    assert not kept[1020]


def test_clusters_weigh_as_much_as_they_are_opaque():
    opaque, which = blobs(1000, 400)
    faint, _ = blobs(1000, 400, opacity=np.where(which == 0, 0.95, 0.3))
    assert dominant_cluster(opaque)[which == 1].mean() > 0.9
    assert not dominant_cluster(faint)[which == 1].any()


@pytest.mark.parametrize("n", [60, 100, 200, 300])
@pytest.mark.parametrize("seed", range(3))
def test_few_gaussians_on_a_sphere_have_the_spheres_bounds(n, seed):
    outward = np.random.default_rng(seed).normal(size=(n, 3))
    sphere = gaussians(outward / np.linalg.norm(outward, axis=1, keepdims=True), (0.05,) * 3, (0.5, 0.5, 0.5))
    assert dominant_cluster(sphere).mean() >= 0.5
    bounds = robust_bounds(sphere, up_frame(UP))
    np.testing.assert_allclose(bounds.centre, 0, atol=0.1)
    np.testing.assert_allclose(bounds.half_extents, 0.95, atol=0.07)


def test_few_large_gaussians_reach_beyond_their_centres():
    rods = gaussians([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], (0.4, 0.2, 0.1), RED)
    assert dominant_cluster(rods).all()
    bounds = robust_bounds(rods, up_frame(UP))
    np.testing.assert_allclose(bounds.centre, [1.5, 0, 0], atol=1e-6)
    np.testing.assert_allclose(sorted(bounds.half_extents), [0.2, 0.2, 1.9], atol=1e-6)


def test_halves_of_an_object_hang_together_by_the_extents_of_large_gaussians():
    heights = np.concatenate([np.linspace(0, 0.3, 5), np.linspace(0.9, 1.2, 45)])
    discs = gaussians(np.stack([0 * heights, 0 * heights, heights], 1), (0.1, 0.1, 0.28), RED)
    narrow = discs.replace(log_scales=discs.log_scales - np.float32(np.log(20)))
    assert dominant_cluster(discs).all()
    assert robust_bounds(discs, up_frame(UP)).half_extents[2] > 0.7
    np.testing.assert_array_equal(dominant_cluster(narrow), heights > 0.6)


def test_a_huge_gaussian_does_not_widen_the_bounds_of_large_ones():
    outward = np.random.default_rng(0).normal(size=(60, 3))
    centres = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    ball = gaussians(centres, 0.2, RED)
    with_huge = concatenate([ball, gaussians([[0.0, 0, 0]], 50.0, RED)])
    expected = robust_bounds(ball, up_frame(UP)).half_extents
    np.testing.assert_allclose(robust_bounds(with_huge, up_frame(UP)).half_extents, expected, atol=0.05)


def test_a_huge_gaussian_touches_no_more_than_a_typical_one():
    body = gaussians(np.stack([np.linspace(0, 1, 12), np.zeros(12), np.zeros(12)], 1), 0.1, RED)
    huge = gaussians([[3.0, 0, 0]], 2.0, RED)
    both = concatenate([body, huge])
    assert not touching(both, np.arange(13) < 12).any()
    near = both.replace(means=np.where(np.arange(13)[:, None] < 12, both.means, np.float32([1.25, 0, 0])))
    np.testing.assert_array_equal(touching(near, np.arange(13) < 12), np.arange(13) == 12)
