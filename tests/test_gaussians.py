"""The container, its activations, and rotations."""

import numpy as np
import pytest
from scenes import random_scene

from gaussian_trimmer.gaussians import Gaussians, concatenate, logit, quaternions_of, rotation_matrices, sigmoid

ARRAYS = ["means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"]


def five(sh_degree=1, **extras):
    return random_scene(0, 5, sh_degree).replace(extras={name: np.array(column) for name, column in extras.items()})


@pytest.mark.parametrize("degree", range(4))
def test_sh_degree_follows_from_the_coefficients(degree):
    assert five(degree).sh_rest.shape == (5, 3, [0, 3, 8, 15][degree])
    assert five(degree).sh_degree == degree


@pytest.mark.parametrize(
    ("name", "shape"),
    [("log_scales", (4, 3)), ("quaternions", (5, 3)), ("opacity_logits", (5, 1)), ("sh_dc", (5, 1, 3)),
     ("sh_rest", (5, 3, 5)), ("sh_rest", (5, 8, 3))],
)  # fmt: skip
def test_wrong_shapes_are_named(name, shape):
    with pytest.raises(ValueError, match=name):
        five().replace(**{name: np.zeros(shape, np.float32)})


@pytest.mark.parametrize(
    ("rows", "numbers"),
    [(np.array([True, False, False, True, True]), [0, 3, 4]), (np.array([4, 0, 4], np.int32), [4, 0, 4]),
     (slice(1, 3), [1, 2]), (np.zeros(5, np.bool_), [])],
)  # fmt: skip
def test_selected_rows_are_copies_but_for_a_slice(rows, numbers):
    scene = five(label=range(5))
    selected = scene.select(rows)
    assert selected.extras["label"].tolist() == numbers and selected.sh_degree == 1
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(selected, name), getattr(scene, name)[numbers])
    assert np.shares_memory(selected.means, scene.means) == isinstance(rows, slice)


@pytest.mark.parametrize("length", [4, 6])
def test_select_needs_a_mask_for_all(length):
    with pytest.raises(ValueError, match=f"{length} entries for 5"):
        five().select(np.ones(length, np.bool_))


def test_parts_concatenate_to_the_whole_with_the_extras_that_all_have():
    scene = five(a=range(5), b=range(5))
    parts = [scene.select(slice(0, 2)), scene.select(slice(2, 2)), scene.select(slice(2, 5))]
    whole, some = concatenate(parts), concatenate([*parts[:2], parts[2].replace(extras={"a": np.arange(3)})])
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(whole, name), getattr(scene, name))
    assert {name: column.tolist() for name, column in whole.extras.items()} == {"a": [*range(5)], "b": [*range(5)]}
    assert {name: column.tolist() for name, column in some.extras.items()} == {"a": [0, 1, 0, 1, 2]}
    with pytest.raises(ValueError, match="at least one"):
        concatenate([])
    with pytest.raises(ValueError, match="degrees"):
        concatenate([five(1), five(2)])


def test_activated_values():
    scene = five().replace(
        opacity_logits=np.float32([-1000, -np.log(3), 0, np.log(3), 1000]),
        log_scales=np.log(np.float32([[1, 2, 3]] * 5)),
    )
    np.testing.assert_allclose(scene.opacities, [0, 0.25, 0.5, 0.75, 1], atol=1e-6)
    np.testing.assert_allclose(scene.scales, [[1, 2, 3]] * 5, rtol=1e-6)
    assert scene.opacities.dtype == scene.scales.dtype == np.float32
    p = np.linspace(0.001, 0.999, 50)
    np.testing.assert_allclose(sigmoid(logit(p)), p)
    assert np.isfinite(logit(np.array([-0.1, 0.0, 1.0, 2.0]))).all()


def test_covariances_have_the_scales_as_spectrum_along_the_turned_axes():
    scene = random_scene(1, 40)
    eigenvalues = np.linalg.eigvalsh(scene.covariances())
    np.testing.assert_allclose(eigenvalues, np.sort(scene.scales.astype(np.float64) ** 2, axis=1), rtol=1e-4)
    # A quarter turn about z takes the first local axis to y and the second to -x.
    turn, zero = np.array([[5, 0, 0, 5]]), np.zeros((1, 3))
    one = Gaussians(zero, np.log([[1, 2, 3]]), turn, [0], zero, np.zeros((1, 3, 0)))
    np.testing.assert_allclose(one.covariances()[0], np.diag([4, 1, 9]), atol=1e-5)


def test_rotation_matrices_are_rotations_whatever_the_length():
    half = np.sqrt(0.5)
    quarter_turns = rotation_matrices(np.array([[half, half, 0, 0], [half, 0, half, 0], [half, 0, 0, half]]))
    x, y, z = np.eye(3)
    for turn, before, after in zip(quarter_turns, (y, z, x), (z, x, y), strict=True):
        np.testing.assert_allclose(turn @ before, after, atol=1e-12)
    q = np.random.default_rng(0).normal(size=(100, 4)).astype(np.float32)
    R = rotation_matrices(q)
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1)
    np.testing.assert_allclose(rotation_matrices(q * np.float32(-1e-3)), R, atol=1e-6)


def test_quaternions_round_trip():
    rng = np.random.default_rng(1)
    q = np.concatenate([rng.normal(size=(200, 4)), np.eye(4), rng.normal(size=(50, 4)) * [1e-4, 1, 1, 1]])
    q = (q / np.linalg.norm(q, axis=1, keepdims=True)).astype(np.float32)
    back = quaternions_of(rotation_matrices(q))
    assert back.dtype == np.float32 and (back[:, 0] >= 0).all()
    np.testing.assert_allclose(np.abs(np.sum(back * q, axis=1)), 1, atol=1e-6)
    np.testing.assert_allclose(rotation_matrices(back), rotation_matrices(q), atol=1e-6)
