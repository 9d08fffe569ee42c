"""The container, its activations, and rotations."""

import dataclasses

import numpy as np
import pytest
from scenes import random_scene

from gaussian_trimmer.gaussians import (
    Gaussians,
    concatenate,
    logit,
    quaternions_of,
    rotation_matrices,
    sigmoid,
)

ARRAYS = ["means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"]


def five(sh_degree=1, extras=None):
    scene = random_scene(0, 5, sh_degree)
    return scene.replace(extras=extras or {})


def assert_equal(actual, expected):
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(actual, name), getattr(expected, name))
    assert actual.extras.keys() == expected.extras.keys()
    for name in actual.extras:
        np.testing.assert_array_equal(actual.extras[name], expected.extras[name])


# --- container


@pytest.mark.parametrize("degree", range(4))
def test_sh_degree_follows_from_the_coefficients(degree):
    assert five(degree).sh_rest.shape == (5, 3, [0, 3, 8, 15][degree])
    assert five(degree).sh_degree == degree


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        ("log_scales", (4, 3)),
        ("quaternions", (5, 3)),
        ("opacity_logits", (5, 1)),
        ("sh_dc", (5, 1, 3)),
        ("sh_rest", (5, 3, 5)),
        ("sh_rest", (5, 8, 3)),
    ],
)
def test_wrong_shapes_are_named(name, shape):
    with pytest.raises(ValueError, match=name):
        five().replace(**{name: np.zeros(shape, np.float32)})


def test_fields_cannot_be_assigned():
    with pytest.raises(dataclasses.FrozenInstanceError):
        five().means = np.zeros((5, 3), np.float32)


def test_replace_keeps_the_rest():
    scene = five()
    raised = scene.replace(means=scene.means + 1)
    np.testing.assert_array_equal(raised.means, scene.means + 1)
    assert raised.sh_rest is scene.sh_rest


@pytest.mark.parametrize(
    "rows", [np.array([True, False, False, True, True]), np.array([0, 3, 4]), np.array([0, 3, 4], np.int32)]
)
def test_select(rows):
    scene = five(extras={"label": np.arange(5)})
    selected = scene.select(rows)
    assert len(selected) == 3
    assert selected.extras["label"].tolist() == [0, 3, 4]
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(selected, name), getattr(scene, name)[[0, 3, 4]])


def test_select_by_number_repeats_and_orders():
    assert five(extras={"label": np.arange(5)}).select(np.array([4, 0, 4])).extras["label"].tolist() == [4, 0, 4]


def test_select_copies_or_views():
    scene = five()
    assert not np.shares_memory(scene.select(np.ones(5, np.bool_)).means, scene.means)
    assert np.shares_memory(scene.select(slice(1, 3)).means, scene.means)


@pytest.mark.parametrize("length", [4, 6])
def test_select_needs_a_mask_for_all(length):
    with pytest.raises(ValueError, match=f"{length} entries for 5"):
        five().select(np.ones(length, np.bool_))


def test_select_of_nothing():
    assert len(five().select(np.zeros(5, np.bool_))) == 0
    assert five().select(np.zeros(5, np.bool_)).sh_degree == 1


def test_parts_concatenate_to_the_whole():
    scene = five(extras={"label": np.arange(5)})
    assert_equal(concatenate([scene.select(slice(0, 2)), scene.select(slice(2, 2)), scene.select(slice(2, 5))]), scene)


def test_concatenate_keeps_the_extras_that_all_have():
    first, second = five(extras={"a": np.arange(5), "b": np.arange(5)}), five(extras={"a": np.arange(5) + 5})
    both = concatenate([first, second])
    assert list(both.extras) == ["a"]
    assert both.extras["a"].tolist() == list(range(10))


def test_concatenate_refuses_what_does_not_fit():
    with pytest.raises(ValueError, match="at least one"):
        concatenate([])
    with pytest.raises(ValueError, match="degrees"):
        concatenate([five(1), five(2)])


# --- activations


def test_activated_values():
    scene = five().replace(
        opacity_logits=np.float32([-1000, -np.log(3), 0, np.log(3), 1000]),
        log_scales=np.log(np.float32([[1, 2, 3]] * 5)),
    )
    np.testing.assert_allclose(scene.opacities, [0, 0.25, 0.5, 0.75, 1], atol=1e-6)
    np.testing.assert_allclose(scene.scales, [[1, 2, 3]] * 5, rtol=1e-6)
    assert scene.opacities.dtype == scene.scales.dtype == np.float32


def test_logit_inverts_the_sigmoid_and_is_finite():
    p = np.linspace(0.001, 0.999, 50)
    np.testing.assert_allclose(sigmoid(logit(p)), p)
    assert np.isfinite(logit(np.array([-0.1, 0.0, 1.0, 2.0]))).all()


def test_covariance_by_hand():
    # A quarter turn about z takes the first local axis to y and the second to -x.
    turn = np.float32([[np.sqrt(0.5), 0, 0, np.sqrt(0.5)]])
    scene = Gaussians(
        np.zeros((1, 3), np.float32),
        np.log(np.float32([[1, 2, 3]])),
        turn * 5,
        np.zeros(1, np.float32),
        np.zeros((1, 3), np.float32),
        np.zeros((1, 3, 0), np.float32),
    )
    np.testing.assert_allclose(scene.covariances()[0], np.diag([4, 1, 9]), atol=1e-5)


def test_covariances_have_the_scales_as_spectrum():
    scene = random_scene(1, 40)
    eigenvalues = np.linalg.eigvalsh(scene.covariances())
    np.testing.assert_allclose(eigenvalues, np.sort(scene.scales.astype(np.float64) ** 2, axis=1), rtol=1e-4)


# --- rotations


def test_rotation_about_each_axis_by_hand():
    half = np.sqrt(0.5)
    quarter_turns = rotation_matrices(np.array([[half, half, 0, 0], [half, 0, half, 0], [half, 0, 0, half]]))
    x, y, z = np.eye(3)
    np.testing.assert_allclose(quarter_turns[0] @ y, z, atol=1e-12)
    np.testing.assert_allclose(quarter_turns[1] @ z, x, atol=1e-12)
    np.testing.assert_allclose(quarter_turns[2] @ x, y, atol=1e-12)


def test_rotation_matrices_are_rotations_whatever_the_length():
    q = np.random.default_rng(0).normal(size=(100, 4)).astype(np.float32)
    R = rotation_matrices(q)
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1)
    np.testing.assert_allclose(rotation_matrices(q * np.float32(1e-3)), R, atol=1e-6)
    np.testing.assert_allclose(rotation_matrices(-q), R, atol=1e-12)


def test_quaternions_round_trip():
    rng = np.random.default_rng(1)
    q = np.concatenate([rng.normal(size=(200, 4)), np.eye(4), rng.normal(size=(50, 4)) * [1e-4, 1, 1, 1]])
    q = (q / np.linalg.norm(q, axis=1, keepdims=True)).astype(np.float32)
    back = quaternions_of(rotation_matrices(q))
    assert back.dtype == np.float32
    assert np.all(back[:, 0] >= 0)
    np.testing.assert_allclose(np.abs(np.sum(back * q, axis=1)), 1, atol=1e-6)
    np.testing.assert_allclose(rotation_matrices(back), rotation_matrices(q), atol=1e-6)
