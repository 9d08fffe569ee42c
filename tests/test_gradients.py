"""Derivatives of a view: against finite differences of the float64 reference, for any number of threads."""

from __future__ import annotations

import numpy as np
import pytest

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.gaussians import FloatArray, Gaussians, quaternions_of, rotation_matrices
from gaussian_trimmer.rendering import reference
from gaussian_trimmer.rendering.gradients import draw, gradients
from gaussian_trimmer.rendering.reference import ReferenceRenderer

_STEP = 1e-3


def _scene(n: int = 12, seed: int = 3) -> tuple[Gaussians, Camera]:
    rng = np.random.default_rng(seed)
    gaussians = Gaussians(
        rng.uniform(-0.5, 0.5, (n, 3)).astype(np.float32), rng.uniform(-2.6, -1.4, (n, 3)).astype(np.float32),
        rng.normal(size=(n, 4)).astype(np.float32), rng.uniform(-1.5, 2.0, n).astype(np.float32),
        rng.uniform(-1, 1, (n, 3)).astype(np.float32), np.zeros((n, 3, 0), np.float32),
    )  # fmt: skip
    pose = look_at(np.array([0.3, -2.2, 0.8]), np.zeros(3), np.array([0.0, 0.0, 1.0]))
    return gaussians, Camera(pose, intrinsics(np.radians(50), 40, 36), 40, 36)


def _moved(gaussians: Gaussians, row: int, parameter: int, step: float) -> Gaussians:
    """The Gaussians with one parameter of one of them changed."""
    fields = {
        name: getattr(gaussians, name).astype(np.float64)
        for name in ("means", "log_scales", "opacity_logits", "sh_dc", "quaternions")
    }
    if parameter < 3:
        fields["means"][row, parameter] += step
    elif parameter < 6:
        fields["log_scales"][row, parameter - 3] += step
    elif parameter < 9:
        cross = np.zeros((3, 3))
        j, k = (parameter - 5) % 3, (parameter - 4) % 3
        cross[k, j], cross[j, k] = np.sin(step), -np.sin(step)
        turn = np.eye(3) * np.cos(step) + cross
        turn[parameter - 6, parameter - 6] = 1
        rotation = rotation_matrices(gaussians.quaternions[row : row + 1])[0] @ turn
        fields["quaternions"][row] = quaternions_of(rotation[None])[0]
    elif parameter == 9:
        fields["opacity_logits"][row] += step
    else:
        fields["sh_dc"][row, parameter - 10] += step
    return gaussians.replace(**{name: values.astype(np.float32) for name, values in fields.items()})


def _loss(gaussians: Gaussians, camera: Camera, slopes: FloatArray) -> float:
    view = ReferenceRenderer().render(gaussians, camera)
    image = np.concatenate([view.rgb.transpose(2, 0, 1), view.alpha[None]]).astype(np.float64)
    return float((image * slopes).sum())


@pytest.mark.parametrize("parameter", range(13))
def test_derivatives_are_those_of_the_reference(parameter: int, monkeypatch: pytest.MonkeyPatch) -> None:
    # At the cut-off pictures jump, which no derivative shows; without it the reference is smooth.
    monkeypatch.setattr(reference, "ALPHA_CUTOFF", 1e-9)
    gaussians, camera = _scene()
    slopes = np.random.default_rng(5).normal(size=(4, camera.height, camera.width)).astype(np.float32)
    found = gradients(draw(gaussians, camera), slopes.astype(np.float32), np.ones(len(gaussians), np.bool_))
    step = 3e-3 if parameter < 10 else 1e-1
    expected = [
        (_loss(_moved(gaussians, row, parameter, step), camera, slopes)
         - _loss(_moved(gaussians, row, parameter, -step), camera, slopes)) / (2 * step)
        for row in range(len(gaussians))
    ]  # fmt: skip
    print(np.c_[found[:, parameter], expected])
    scale = np.abs(expected).max()
    np.testing.assert_allclose(found[:, parameter], expected, atol=0.02 * scale)
