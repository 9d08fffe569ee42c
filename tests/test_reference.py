"""The reference against values computed by hand, and against laws that any blending obeys."""

import numpy as np
import pytest
import reference
from reference import projected_covariances
from scenes import front_camera, gaussian, random_scene

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import concatenate, quaternions_of, rotation_matrices
from gaussian_trimmer.geometry.harmonics import sh_basis
from gaussian_trimmer.rendering.blending import ALPHA_CUTOFF

FOCAL = 100.0
# At the origin, looking along z; the optical axis passes through the centre of pixel (50, 40).
CAMERA = Camera(np.eye(4), np.array([[FOCAL, 0, 50.5], [0, FOCAL, 40.5], [0, 0, 1]]), 101, 81)
C1 = 0.4886025119029199  # sqrt(3 / (4 pi))


def at_axis(gaussians, background=None):
    """Colour, alpha and depth at the pixel of the optical axis."""
    rendering = reference.render(gaussians, CAMERA, background)
    return rendering.rgb[40, 50], rendering.alpha[40, 50], rendering.depth[40, 50]


# --- known values


def test_one_gaussian_falls_off_by_its_projected_variance():
    alpha = reference.render(gaussian(mean=(0, 0, 2), scale=(0.1, 0.2, 0.3), opacity=0.6), CAMERA).alpha
    across, down = (FOCAL / 2 * 0.1) ** 2 + 0.3, (FOCAL / 2 * 0.2) ** 2 + 0.3
    assert alpha[40, 50] == pytest.approx(0.6)
    assert alpha[40, 53] == pytest.approx(0.6 * np.exp(-0.5 * 9 / across))
    assert alpha[33, 50] == pytest.approx(0.6 * np.exp(-0.5 * 49 / down))
    assert alpha[36, 48] == pytest.approx(0.6 * np.exp(-0.5 * (4 / across + 16 / down)))


def test_jacobian_stays_within_the_margin():
    # Columns 1040 of 101, taken at 1.15 x 101, and rows -150 of 81, taken at -0.15 x 81; the axis at (40, 50).
    camera = Camera(np.eye(4), np.array([[FOCAL, 0, 40], [0, FOCAL, 50], [0, 0, 1]]), 101, 81)
    slope_x, slope_y = (1.15 * 101 - 40) / FOCAL, (-0.15 * 81 - 50) / FOCAL
    J = FOCAL * np.array([[1, 0, -slope_x], [0, 1, -slope_y]])
    actual = projected_covariances(gaussian(mean=(10, -2, 1), scale=0.1), camera)[0]
    np.testing.assert_allclose(actual, 0.01 * J @ J.T + 0.3 * np.eye(2), rtol=1e-6)


def test_two_stacked_gaussians():
    near, far = gaussian((0, 0, 1), opacity=0.5, colour=(1, 0, 0.5)), gaussian((0, 0, 3), opacity=0.8, colour=(0, 1, 1))
    for scene in (concatenate([near, far]), concatenate([far, near])):
        rgb, alpha, depth = at_axis(scene)
        np.testing.assert_allclose(rgb, [0.5, 0.4, 0.65], atol=1e-6)
        assert alpha == pytest.approx(0.9)
        assert depth == pytest.approx((0.5 * 1 + 0.4 * 3) / 0.9)
    rgb, _, _ = at_axis(concatenate([near, far]), np.float32([0.2, 0.4, 0.6]))
    np.testing.assert_allclose(rgb, [0.52, 0.44, 0.71], atol=1e-6)


def test_order_is_by_depth_not_by_distance():
    # The red one is nearer by depth, 2 against 2.1, and farther by distance, 2.24 against 2.1.
    red, blue = gaussian((1, 0, 2), scale=2, colour=(1, 0, 0)), gaussian((0, 0, 2.1), colour=(0, 0, 1))
    ids, weights = reference.top_contributors(concatenate([blue, red]), CAMERA, np.array([[50, 40]]), 2)
    red_weight, blue_weight = weights[0][np.argsort(-ids[0])]
    assert blue_weight == pytest.approx((1 - red_weight) * 0.5, rel=1e-5)


def test_equal_depths_are_drawn_by_row():
    red, blue = gaussian(opacity=0.75, colour=(1, 0, 0)), gaussian(opacity=0.75, colour=(0, 0, 1))
    np.testing.assert_allclose(at_axis(concatenate([red, blue]))[0], [0.75, 0, 0.1875], atol=1e-6)
    np.testing.assert_allclose(at_axis(concatenate([blue, red]))[0], [0.1875, 0, 0.75], atol=1e-6)


def test_alpha_is_capped():
    assert at_axis(gaussian(opacity=0.9999))[1] == pytest.approx(0.99)


def test_cutoff_alone_bounds_a_gaussian():
    alpha = reference.render(gaussian(mean=(0, 0, 2), scale=0.2, opacity=0.95), CAMERA).alpha[40]
    sigma = np.sqrt((FOCAL / 2 * 0.2) ** 2 + 0.3)
    reach = sigma * np.sqrt(2 * np.log(0.95 * 255))  # 3.31 sigma
    drawn = np.abs(np.arange(101) - 50) <= reach
    np.testing.assert_array_equal(alpha > 0, drawn)
    assert ALPHA_CUTOFF <= alpha[drawn].min() < 0.95 * np.exp(-4.5)


def test_opacity_below_the_cutoff_is_not_drawn():
    assert at_axis(gaussian(opacity=0.0039))[1] == 0
    assert at_axis(gaussian(opacity=0.0040))[1] == pytest.approx(0.0040, rel=1e-4)


@pytest.mark.parametrize(("opacity", "n_drawn"), [(0.784, 6), (0.785, 5)])
def test_pixel_stops_before_it_is_exhausted(opacity, n_drawn):
    # 0.216^6 = 1.02e-4 still passes, 0.215^6 = 0.99e-4 does not; nor is the faint one behind, row 10, drawn.
    stack = [gaussian((0, 0, 1 + 0.1 * i), opacity=opacity) for i in range(10)]
    scene = concatenate([*stack, gaussian((0, 0, 5), opacity=0.05)])
    _, alpha, _ = at_axis(scene)
    assert 1 - alpha == pytest.approx((1 - opacity) ** n_drawn, rel=2e-3)
    ids, _ = reference.top_contributors(scene, CAMERA, np.array([[50, 40]]), 11)
    assert ids[0].tolist() == [*range(n_drawn)] + [-1] * (11 - n_drawn)


@pytest.mark.parametrize(("depth", "drawn"), [(-1.0, False), (0.0, False), (0.009, False), (0.011, True)])
def test_near_plane(depth, drawn):
    assert (at_axis(gaussian((0, 0, depth), scale=0.001))[1] > 0) == drawn


def test_basis_by_hand():
    # At (1, 2, 3) / sqrt(14), with the numeric constants that the published models were trained with.
    one, two, three = 1 / np.sqrt(14), 1 / 14, 14**-1.5
    expected = [0.28209479177387814, -C1 * 2 * one, C1 * 3 * one, -C1 * one]
    expected += [1.0925484305920792 * 2 * two, -1.0925484305920792 * 6 * two, 0.31539156525252005 * 13 * two]
    expected += [-1.0925484305920792 * 3 * two, 0.5462742152960396 * -3 * two]
    expected += [-0.5900435899266435 * -2 * three, 2.890611442640554 * 6 * three, -0.4570457994644658 * 62 * three]
    expected += [0.3731763325901154 * 9 * three, -0.4570457994644658 * 31 * three, 1.445305721320277 * -9 * three]
    expected += [-0.5900435899266435 * -11 * three]
    direction = np.array([[1, 2, 3]]) / np.sqrt(14)
    np.testing.assert_allclose(sh_basis(direction)[0], expected, atol=1e-12)


# --- laws


def test_basis_is_orthonormal():
    # Gauss-Legendre in z and even steps in azimuth integrate polynomials of degree 6 exactly.
    z, weight = np.polynomial.legendre.leggauss(8)
    azimuth = 2 * np.pi * np.arange(16) / 16
    radius = np.sqrt(1 - z**2)[:, None]
    x, y = radius * np.cos(azimuth), radius * np.sin(azimuth)
    basis = sh_basis(np.stack([x, y, np.broadcast_to(z[:, None], x.shape)], axis=-1).reshape(-1, 3))
    gram = basis.T @ (np.repeat(weight, 16)[:, None] * 2 * np.pi / 16 * basis)
    np.testing.assert_allclose(gram, np.eye(16), atol=1e-12)


def test_projection_is_linear_to_first_order():
    camera = front_camera()
    scene = random_scene(3, 40)
    pixels, depths = camera.project(scene.means)
    inside = (depths > 0.5) & (pixels > 0).all(1) & (pixels < [camera.width, camera.height]).all(1)
    scene = scene.select(inside)
    step = 1e-5
    steps = scene.means[:, None].astype(np.float64) + step * np.concatenate([np.eye(3), -np.eye(3)])
    moved = camera.project(steps.reshape(-1, 3))[0].reshape(-1, 6, 2)
    J = (moved[:, :3] - moved[:, 3:]).transpose(0, 2, 1) / (2 * step)
    expected = J @ scene.covariances() @ J.transpose(0, 2, 1) + 0.3 * np.eye(2)
    assert len(scene) > 10
    np.testing.assert_allclose(projected_covariances(scene, camera), expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_weights_add_up_to_alpha(seed):
    scene, camera = random_scene(seed), front_camera()
    labels = np.random.default_rng(seed).integers(0, 3, (camera.height, camera.width)).astype(np.uint8)
    alpha = reference.render(scene, camera).alpha
    weights = reference.blend_weights(scene, camera, labels, 3)
    by_label = [alpha[labels == label].sum() for label in range(3)]
    np.testing.assert_allclose(weights.sum(0), by_label, rtol=1e-4)
    assert alpha.min() >= 0
    assert alpha.max() <= 1


def test_moving_scene_and_camera_together_changes_nothing():
    scene, camera = random_scene(5, sh_degree=0), front_camera()
    motion = np.eye(4)
    motion[:3, :3] = rotation_matrices(np.array([[0.3, -0.5, 0.7, 0.2]]))[0]
    motion[:3, 3] = [0.4, -1.0, 2.0]
    rotations = motion[:3, :3] @ rotation_matrices(scene.quaternions)
    moved = scene.replace(
        means=(scene.means @ motion[:3, :3].T + motion[:3, 3]).astype(np.float32), quaternions=quaternions_of(rotations)
    )
    follower = Camera(camera.world_to_camera @ np.linalg.inv(motion), camera.K, camera.width, camera.height)
    before, after = reference.render(scene, camera), reference.render(moved, follower)
    np.testing.assert_allclose(after.rgb, before.rgb, atol=2e-3)
    np.testing.assert_allclose(after.depth, before.depth, atol=2e-2)
