"""Derivatives of a view: those of finite differences of the float64 reference, the same for any number of threads."""

from __future__ import annotations

import numba
import numpy as np
import pytest
import reference
from scenes import front_camera, random_scene

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, SplatModel, quaternions_of, rotation_matrices
from gaussian_trimmer.rendering import gradient_kernels
from gaussian_trimmer.rendering.gradients import compile_kernels, gradients, loss_gradient
from gaussian_trimmer.rendering.numba_kernels import sum_pairs
from gaussian_trimmer.rendering.projection import as_tiles
from gaussian_trimmer.rendering.tile_renderer import draw

_NAMES = [
    "x",
    "y",
    "z",
    "scale-1",
    "scale-2",
    "scale-3",
    "turn-1",
    "turn-2",
    "turn-3",
    "opacity",
    "red",
    "green",
    "blue",
]


def _scene(n: int = 12, seed: int = 3) -> tuple[Gaussians, Camera]:
    rng = np.random.default_rng(seed)
    gaussians = Gaussians(
        rng.uniform(-0.5, 0.5, (n, 3)), rng.uniform(-2.6, -1.4, (n, 3)), rng.normal(size=(n, 4)),
        rng.uniform(0, 3, n), rng.uniform(-1, 1, (n, 3)), np.zeros((n, 3, 0)),
    )  # fmt: skip
    pose = look_at(np.array([0.3, -2.2, 0.8]), np.zeros(3), np.array([0.0, 0.0, 1.0]))
    return gaussians, Camera(pose, intrinsics(np.radians(50), 40, 36), 40, 36)


def _slopes(camera: Camera) -> FloatArray:
    """Derivatives of a loss that vary slowly over the picture."""
    y, x = np.mgrid[: camera.height, : camera.width] / 12.0
    return np.stack([np.cos(x + 0.3), np.sin(x + y), np.cos(1.3 * y), np.sin(0.7 * x - y) + 0.5]).astype(np.float32)


def _gradients(gaussians: Gaussians, camera: Camera, moving: BoolArray | None = None) -> FloatArray:
    """Derivatives by the parameters of some Gaussians, by default of all, (K, 13)."""
    moving = np.ones(len(gaussians), np.bool_) if moving is None else moving
    return gradients(draw(gaussians, [camera]), as_tiles(_slopes(camera)), moving)[0]


def _moved(gaussians: Gaussians, row: int, parameter: int, step: float) -> Gaussians:
    """The Gaussians with one parameter of one of them changed."""
    if 6 <= parameter < 9:
        turn = np.eye(3)
        j, k = (parameter - 5) % 3, (parameter - 4) % 3
        turn[j, j] = turn[k, k] = np.cos(step)
        turn[k, j], turn[j, k] = np.sin(step), -np.sin(step)
        quaternions = gaussians.quaternions.copy()
        quaternions[row] = quaternions_of(rotation_matrices(gaussians.quaternions[[row]]) @ turn)[0]
        return gaussians.replace(quaternions=quaternions)
    name, column = {0: ("means", 0), 1: ("log_scales", 3), 3: ("opacity_logits", 9), 4: ("sh_dc", 10)}[
        (parameter >= 3) + 2 * (parameter >= 9) + (parameter >= 10)
    ]
    values = getattr(gaussians, name).copy()
    values.reshape(len(values), -1)[row, parameter - column] += step
    return gaussians.replace(**{name: values})


def _loss(gaussians: Gaussians, camera: Camera, slopes: FloatArray) -> float:
    view = reference.render(gaussians, camera)
    return float((view.rgb.transpose(2, 0, 1) * slopes[:3]).sum(dtype=np.float64) + (view.alpha * slopes[3]).sum())


@pytest.mark.parametrize("model", ["default", "antialiased"])
@pytest.mark.parametrize("parameter", range(13), ids=_NAMES)
def test_derivatives_are_those_of_the_reference(
    parameter: int, model: SplatModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Where alpha is cut off, at 1/255, the picture jumps, which no derivative shows. The reference is therefore asked
    # without the cut-off, and the tails beyond it, up to 3 % of a derivative by a scale, set the tolerance.
    monkeypatch.setattr(reference, "ALPHA_CUTOFF", 1e-9)
    gaussians, camera = _scene()
    gaussians = gaussians.replace(model=model)
    slopes = _slopes(camera)
    found = _gradients(gaussians, camera)[:, parameter]
    step = 1e-3
    expected = [
        (_loss(_moved(gaussians, i, parameter, step), camera, slopes)
         - _loss(_moved(gaussians, i, parameter, -step), camera, slopes)) / (2 * step)
        for i in range(len(gaussians))
    ]  # fmt: skip
    np.testing.assert_allclose(found, expected, rtol=0.04, atol=0.02 * np.abs(expected).max())


def test_only_what_is_asked_for_is_differentiated() -> None:
    gaussians, camera = _scene()
    moving = np.arange(len(gaussians)) % 3 == 0
    some, every = _gradients(gaussians, camera, moving), _gradients(gaussians, camera)
    assert len(some) == moving.sum()
    np.testing.assert_allclose(some, every[moving], rtol=1e-5, atol=1e-6 * np.abs(every).max())


def test_tiles_that_nothing_moving_reaches_need_not_be_drawn() -> None:
    gaussians, camera = _scene(60)
    gaussians = gaussians.replace(log_scales=gaussians.log_scales - np.float32(1))
    moving = np.arange(len(gaussians)) < 2
    partly = draw(gaussians, [camera], around=moving)
    assert (partly.tiled[-1] == 0).all(axis=1).any()
    found = gradients(partly, as_tiles(_slopes(camera)), moving)[0]
    np.testing.assert_array_equal(found, _gradients(gaussians, camera, moving))


def test_several_views_at_once_are_the_same_as_one_after_the_other() -> None:
    gaussians, camera = _scene(40)
    pose = look_at(np.array([2.0, 0.5, 1.0]), np.zeros(3), np.array([0.0, 0.0, 1.0]))
    cameras = [camera, Camera(pose, intrinsics(np.radians(40), 70, 21), 70, 21)]
    moving = np.arange(len(gaussians)) % 2 == 0
    slopes = np.concatenate([as_tiles(_slopes(one)) for one in cameras], axis=1)
    together = gradients(draw(gaussians, cameras), slopes, moving)
    for one, found in zip(cameras, together, strict=True):
        assert found.any()
        np.testing.assert_array_equal(found, _gradients(gaussians, one, moving))


def test_what_no_light_reaches_changes_nothing_and_is_not_changed() -> None:
    gaussians, camera = _scene(80)
    wall = gaussians.replace(
        log_scales=np.full((80, 3), 0.5, np.float32), opacity_logits=np.full(80, 2.0, np.float32)
    )  # fmt: skip
    whole = np.ones((1, camera.height, camera.width), np.float32)
    seen = draw(wall, [camera]).weigh([whole])[0, :, 0] > 0
    assert 3 < seen.sum() < 40
    found = _gradients(wall, camera)
    assert not found[~seen].any()
    np.testing.assert_array_equal(found[seen], _gradients(wall.select(seen), camera))


def test_slopes_towards_a_picture_are_derivatives_of_the_rounded_difference() -> None:
    gaussians, camera = _scene()
    drawing, rng = draw(gaussians, [camera]), np.random.default_rng(0)
    picture, weight = rng.uniform(0, 1, (2, 4, camera.height, camera.width)).astype(np.float32)
    tiled = loss_gradient(drawing, as_tiles(picture), as_tiles(weight), 0.1)
    (found,) = drawing.projection.images(tiled)
    np.testing.assert_array_equal(tiled, as_tiles(found), "Beside the picture nothing counts.")
    difference = (drawing.images[0] - picture).astype(np.float64)

    def loss(by: float) -> np.ndarray:
        return weight * np.sqrt((difference + by) ** 2 + 0.01)

    np.testing.assert_allclose(found, (loss(1e-5) - loss(-1e-5)) / 2e-5, atol=1e-4)


def test_gaussians_that_are_degenerate_have_finite_derivatives() -> None:
    gaussians, camera = _scene(6)
    scales, logits = gaussians.log_scales.copy(), gaussians.opacity_logits.copy()
    scales[0], scales[1, 2], scales[2], logits[3] = -80, -np.inf, 40, np.inf
    found = _gradients(gaussians.replace(log_scales=scales, opacity_logits=logits), camera)
    assert np.isfinite(found).all()
    assert found[4:].any()


KERNELS = [
    gradient_kernels.huber_gradient, gradient_kernels.differentiate_tiles, gradient_kernels.gather, sum_pairs,
]  # fmt: skip


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="NUMBA_DISABLE_JIT is set, so nothing is compiled.")
def test_every_kernel_is_compiled_for_the_types_that_it_is_called_with():
    """Kernels compiled ahead for other types would be compiled twice."""
    compile_kernels()
    before = [kernel.signatures for kernel in KERNELS]
    scene, camera = random_scene(0, 40), front_camera(48, 32)
    drawing = draw(scene, [camera])
    picture = np.zeros((4, 6, 256), np.float32)
    gradients(drawing, loss_gradient(drawing, picture, picture + 1, 0.1), np.ones(len(scene), np.bool_))
    assert all(before)
    assert [kernel.signatures for kernel in KERNELS] == before
