"""Half turns between the axes of formats: what they do to vectors, rotations and harmonics."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from format_samples import sample

from gaussian_trimmer.formats.glb import AXIS_SIGNS, SH_SIGNS, half_turn


@pytest.mark.parametrize("axis", ["x", "z"])
def test_the_turn_keeps_every_view_dependent_colour(axis: Literal["x", "z"]) -> None:
    """Harmonics of a direction, weighted with the signs, are those of the turned direction."""
    directions = np.random.default_rng(0).normal(size=(3, 20))
    turned = _harmonics(*(directions * AXIS_SIGNS[axis][:, None]))
    np.testing.assert_allclose(turned, SH_SIGNS[axis][:, None] * _harmonics(*directions), atol=1e-12)


@pytest.mark.parametrize("axis", ["x", "z"])
def test_the_turn_turns_covariances(axis: Literal["x", "z"]) -> None:
    gaussians = sample(20, 2)
    turned = half_turn(gaussians, axis)
    rotation = np.diag(AXIS_SIGNS[axis])
    np.testing.assert_allclose(
        turned.covariances(), rotation @ gaussians.covariances() @ rotation, rtol=1e-4, atol=1e-7
    )
    np.testing.assert_array_equal(turned.means, gaussians.means @ rotation)
    np.testing.assert_array_equal(half_turn(turned, axis).sh_rest, gaussians.sh_rest)


def _harmonics(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Real harmonics of degrees 1 to 3 in the PLY's order, without their factors, which have no part in the signs."""
    return np.stack(
        [
            y, z, x,
            x * y, y * z, 2 * z * z - x * x - y * y, x * z, x * x - y * y,
            y * (3 * x * x - y * y), x * y * z, y * (4 * z * z - x * x - y * y),
            z * (2 * z * z - 3 * x * x - 3 * y * y),
            x * (4 * z * z - x * x - y * y), z * (x * x - y * y), x * (x * x - 3 * y * y),
        ]
    )  # fmt: skip
