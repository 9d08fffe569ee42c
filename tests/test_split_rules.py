"""Splitting Gaussians at planes: geometry, profiles, limits, and the published rules by hand."""

import math

import numpy as np
import pytest
import reference
from scenes import gaussian

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.gaussians import Gaussians, concatenate, logit, quaternions_of, rotation_matrices
from gaussian_trimmer.geometry.split import (
    PROFILE_POWER,
    SPLIT_RULES,
    split_at_centroid,
    split_plane,
    split_principal_axis,
    split_sagd,
)

T = np.linspace(-12, 12, 24001)
STEP = T[1] - T[0]
Z = np.array([[0.0, 0.0, 1.0]])


def parents(seed, n, max_opacity=0.9):
    """Gaussians of aspect ratios up to 1 : 10, whose float32 centres lie near the origin."""
    rng = np.random.default_rng(seed)
    return Gaussians(
        rng.normal(0, 0.1, (n, 3)).astype(np.float32),
        np.log(rng.uniform(0.1, 1.0, (n, 3))).astype(np.float32),
        rng.normal(size=(n, 4)).astype(np.float32),
        logit(rng.uniform(0.05, max_opacity, n)).astype(np.float32),
        rng.normal(size=(n, 3)).astype(np.float32),
        rng.normal(size=(n, 3, 8)).astype(np.float32),
        {"object": rng.integers(0, 9, n)},
    )


def unit_vectors(seed, n):
    normals = np.random.default_rng(seed).normal(size=(n, 3))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def spreads(gaussians, normals):
    return np.sqrt(np.einsum("ni,nij,nj->n", normals, gaussians.covariances(), normals))


def profile(child, parent, normals):
    """Centre, variance and height of a child along its parent's coordinate t, each (M,)."""
    sigma = spreads(parent, normals)
    shifts = np.einsum("ni,ni->n", normals, (child.means - parent.means).astype(np.float64)) / sigma
    return shifts, (spreads(child, normals) / sigma) ** 2, child.opacities / parent.opacities


def bells(child, parent, normals):
    """The child's opacity along t, (M, T)."""
    shifts, variances, heights = profile(child, parent, normals)
    curves = np.exp(-0.5 * (T - shifts[:, None]) ** 2 / variances[:, None])
    return (heights * parent.opacities)[:, None] * curves


# The rule `plane`: geometry


def test_displacement_is_one_standard_deviation_long_and_variance_shrinks_along_it_alone():
    parent, normals = parents(0, 50), unit_vectors(1, 50)
    offsets = np.linspace(-2.5, 2.5, 50)
    covariances = parent.covariances()
    u = np.einsum("nij,nj->ni", covariances, normals) / spreads(parent, normals)[:, None]
    np.testing.assert_allclose(np.einsum("ni,nij,nj->n", u, np.linalg.inv(covariances), u), 1)
    for child in split_plane(parent, normals, offsets):
        shifts, variances, _ = profile(child, parent, normals)
        np.testing.assert_allclose(child.means - parent.means, shifts[:, None] * u, atol=1e-6)
        expected = covariances - (1 - variances)[:, None, None] * u[:, :, None] * u[:, None, :]
        np.testing.assert_allclose(child.covariances(), expected, atol=1e-6)
        determinants = np.linalg.det(child.covariances()) / np.linalg.det(covariances)
        np.testing.assert_allclose(determinants, variances, rtol=1e-4)
        np.testing.assert_allclose(np.linalg.norm(child.quaternions, axis=1), 1, rtol=1e-6)


def test_shift_and_variance_agree_with_quadrature():
    offsets = np.linspace(-4, 4, 33)
    n = len(offsets)
    parent = concatenate([gaussian(mean=(0, 0, 0), scale=1.0)] * n)
    normals = np.repeat(Z, n, axis=0)
    density = np.exp(-0.5 * PROFILE_POWER * T**2)
    for child, sign in zip(split_plane(parent, normals, offsets), (1, -1), strict=True):
        weights = density * (sign * (T + offsets[:, None]) > 0)
        weights /= weights.sum(1, keepdims=True)
        means = weights @ T
        variances = PROFILE_POWER * (weights @ T**2 - means**2)
        shifts, actual, _ = profile(child, parent, normals)
        np.testing.assert_allclose(shifts, means, atol=2e-3)
        np.testing.assert_allclose(actual, variances, atol=2e-3)


def test_turning_the_normal_around_swaps_the_children():
    parent, normals = parents(7, 20), unit_vectors(8, 20)
    offsets = np.linspace(-2, 2, 20)
    inside, outside = split_plane(parent, normals, offsets)
    swapped_inside, swapped_outside = split_plane(parent, -normals, -offsets)
    for one, other in ((inside, swapped_outside), (outside, swapped_inside)):
        np.testing.assert_allclose(one.means, other.means, atol=1e-6)
        np.testing.assert_allclose(one.covariances(), other.covariances(), atol=1e-6)
        np.testing.assert_allclose(one.opacities, other.opacities, rtol=1e-5)


@pytest.mark.parametrize("rule", SPLIT_RULES)
def test_children_turn_with_their_parents(rule):
    parent, normals = parents(9, 20), unit_vectors(10, 20)
    offsets = np.linspace(-1.4, 1.4, 20)
    turn = rotation_matrices(np.float32([[0.3, -0.5, 0.7, 0.2]]))[0]
    turned = parent.replace(
        means=(parent.means @ turn.T).astype(np.float32),
        quaternions=quaternions_of(turn @ rotation_matrices(parent.quaternions)),
    )
    children = SPLIT_RULES[rule](parent, normals, offsets)
    turned_children = SPLIT_RULES[rule](turned, normals @ turn.T, offsets)
    assert [child is None for child in children] == [child is None for child in turned_children]
    pairs = zip(filter(None, children), filter(None, turned_children), strict=True)
    for child, turned_child in pairs:
        for name in ("sh_dc", "sh_rest"):
            np.testing.assert_array_equal(getattr(child, name), getattr(parent, name))
        np.testing.assert_array_equal(child.extras["object"], parent.extras["object"])
        np.testing.assert_allclose(turned_child.means, child.means @ turn.T, atol=1e-5)
        np.testing.assert_allclose(turned_child.covariances(), turn @ child.covariances() @ turn.T, atol=1e-5)
        np.testing.assert_allclose(turned_child.opacities, child.opacities, rtol=1e-4)


# The rule `plane`: opacity


def compare_profiles(opacity):
    """The worst errors over offsets in [-2, 2], of the kinds that docs/paper.md lists, relative to the parent."""
    offsets = np.linspace(-2, 2, 33)
    n = len(offsets)
    parent = concatenate([gaussian(mean=(0, 0, 0), scale=1.0, opacity=opacity)] * n)
    normals = np.repeat(Z, n, axis=0)
    inside, outside = (bells(child, parent, normals) for child in split_plane(parent, normals, offsets))
    whole = opacity * np.exp(-0.5 * T**2)
    within = offsets[:, None] > -T
    seam = 1 - (1 - inside) * (1 - outside) - whole
    norm = np.sqrt((whole**2).sum())
    return {
        "composite, largest": np.abs(seam).max() / opacity,
        "composite, L2": np.sqrt((seam**2).sum(1)).max() / norm,
        "leak": (inside * ~within).sum(1).max() / whole.sum(),
        "inside, L2": np.sqrt(((inside - whole * within) ** 2).sum(1)).max() / norm,
    }


@pytest.mark.parametrize(
    ("opacity", "largest", "l2"), [(0.1, 0.14, 0.12), (0.5, 0.20, 0.15), (0.9, 0.28, 0.18), (0.99, 0.30, 0.19)]
)
def test_children_match_the_cut_and_their_composite_the_uncut_profile(opacity, largest, l2):
    errors = compare_profiles(opacity)
    assert errors["composite, largest"] < largest
    assert errors["composite, L2"] < l2
    assert errors["leak"] < 0.08
    assert errors["inside, L2"] < 0.26


def test_a_split_seen_edge_on_cuts_the_picture_and_keeps_the_scene():
    camera = Camera(
        look_at(np.array([0.0, 0, -4]), np.zeros(3), np.array([0.0, -1, 0])), intrinsics(0.8, 96, 96), 96, 96
    )
    parent = gaussian(mean=(0, 0, 0), scale=(0.5, 0.3, 0.4), quaternion=(0.9, 0, 0, 0.3), opacity=0.5)
    normals, offsets = np.array([[1.0, 0.0, 0.0]]), np.zeros(1)  # The plane x = 0 holds the camera.
    inside, outside = split_plane(parent, normals, offsets)
    whole, half, both = (reference.render(g, camera).alpha for g in (parent, inside, concatenate([inside, outside])))
    # x points right in the picture, so its right half is inside.
    assert np.abs(both - whole).max() < 0.2 * whole.max()
    assert half[:, :48].sum() < 0.08 * whole.sum()
    assert half[:, 48:].sum() == pytest.approx(0.5 * whole.sum(), rel=0.15)


# Limits


def test_a_far_plane_leaves_the_parent_and_a_vanishing_child():
    parent, normals = parents(11, 20), unit_vectors(12, 20)
    inside, outside = split_plane(parent, normals, np.full(20, 6.0))
    np.testing.assert_allclose(inside.means, parent.means, atol=1e-6)
    np.testing.assert_allclose(inside.covariances(), parent.covariances(), rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(inside.opacities, parent.opacities, rtol=1e-4)
    assert outside.opacities.max() < 1e-4
    beyond = split_plane(parent, normals, np.full(20, 1e9))
    np.testing.assert_array_equal(beyond[1].means, outside.means)


@pytest.mark.parametrize("rule", SPLIT_RULES)
@pytest.mark.parametrize("offset", [-1e6, -6.0, -1.0, 0.0, 1.0, 6.0, 1e6])
def test_flat_and_needle_shaped_gaussians_give_finite_children(rule, offset):
    scales = [(1e-7, 1.0, 1.0), (1e-7, 1e-7, 1.0), (1e3, 1e-4, 1e-7), (1e-7, 1e-7, 1e-7), (1.0, 1.0, 1.0)]
    kinds = [gaussian(scale=s, quaternion=(1, 2, 3, 4), opacity=o) for s in scales for o in (0.0, 0.3, 1.0)]
    parent = concatenate(kinds * 3)
    axes = rotation_matrices(parent.quaternions[:1])[0].T  # Along the thin axis, along the long one, askew.
    normals = np.repeat(np.stack([axes[0], axes[2], np.ones(3) / math.sqrt(3)]), len(kinds), axis=0)
    for child in SPLIT_RULES[rule](parent, normals, np.full(len(parent), offset)):
        if child is None:
            continue
        if rule == "plane" and offset == 0:  # thin axes stay as thin as they were
            assert child.scales.min() > 5e-8
        for name in ("means", "log_scales", "quaternions", "opacity_logits"):
            assert np.isfinite(getattr(child, name)).all()
            assert getattr(child, name).dtype == np.float32
        assert (child.opacities <= np.maximum(parent.opacities, 0.99) + 1e-6).all()


def test_the_axes_of_round_gaussians_do_not_hang_on_the_last_bits_of_the_plane():
    parent = parents(17, 200)
    parent = parent.replace(log_scales=np.repeat(parent.log_scales[:, :1], 3, axis=1))
    normals = unit_vectors(18, 200)
    offsets = np.random.default_rng(19).uniform(-2, 2, 200)
    noisy = normals * (1 + np.random.default_rng(20).uniform(-4e-16, 4e-16, normals.shape))
    for child, other in zip(split_plane(parent, normals, offsets), split_plane(parent, noisy, offsets), strict=True):
        np.testing.assert_allclose(child.quaternions, other.quaternions, atol=1e-6)
        np.testing.assert_allclose(child.log_scales, other.log_scales, atol=1e-6)


# The published rules


def along_x():
    """Longest axis x of standard deviation 2, hence a segment from -3 to 3; sigma_n of the x plane is 2."""
    return gaussian(mean=(0, 0, 0), scale=(2.0, 0.5, 0.1), opacity=0.7)


X = np.array([[1.0, 0.0, 0.0]])


def test_principal_axis_by_hand():
    # The plane x = -1 lies 0.5 sigma_n behind the centre: 4 of 6 units are inside, from -1 to 3.
    inside, outside = split_principal_axis(along_x(), X, np.array([0.5]))
    np.testing.assert_allclose(inside.means, [[1, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(inside.scales, [[4 / 3, 0.5, 0.1]], rtol=1e-6)
    np.testing.assert_allclose(outside.means, [[-2, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(outside.scales, [[2 / 3, 0.5, 0.1]], rtol=1e-6)
    np.testing.assert_allclose([inside.opacities, outside.opacities], 0.7, rtol=1e-6)
    inside, outside = split_principal_axis(along_x(), X, np.array([-1.49]))  # neither gets less than a twentieth
    np.testing.assert_allclose([inside.scales[0, 0], outside.scales[0, 0]], [0.1, 1.9], rtol=1e-5)


def test_at_the_centroid_both_children_have_half_of_the_axis_wherever_it_is_cut():
    for offset in (0.5, -1.2):
        inside, outside = split_at_centroid(along_x(), X, np.array([offset]))
        np.testing.assert_allclose(inside.means, [[1.5, 0, 0]], atol=1e-6)
        np.testing.assert_allclose(outside.means, [[-1.5, 0, 0]], atol=1e-6)
        np.testing.assert_allclose([*inside.scales, *outside.scales], [[1, 0.5, 0.1]] * 2, rtol=1e-6)
    whole, empty = split_at_centroid(along_x(), X, np.array([1.6]))
    assert (whole.means == along_x().means).all() and empty.opacities[0] < 1e-6


@pytest.mark.parametrize(("normal", "offset"), [(X, 1.6), (np.array([[0.0, 1.0, 0.0]]), 0.2)])
def test_a_plane_that_misses_the_axis_leaves_the_parent_whole(normal, offset):
    for whole, empty in (
        split_principal_axis(along_x(), normal, np.array([offset])),
        split_principal_axis(along_x(), normal, np.array([-offset]))[::-1],
    ):
        for name in ("means", "log_scales", "quaternions", "opacity_logits"):
            np.testing.assert_array_equal(getattr(whole, name), getattr(along_x(), name))
        assert empty.opacities[0] < 1e-6


def test_sagd_by_hand():
    child, nothing = split_sagd(along_x(), X, np.array([0.5]))
    assert nothing is None
    np.testing.assert_allclose(child.means, [[1, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(child.scales, np.array([[2.0, 0.5, 0.1]]) * 0.8 * 2 / 3, rtol=1e-6)
    np.testing.assert_allclose(child.opacities, 0.7, rtol=1e-6)
