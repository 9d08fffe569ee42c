"""Half a turn about an axis, which is what lies between the conventions of most splat formats.

x, y and z of a splat PLY are right, down and front. Of the KHR_gaussian_splatting extension of glTF they are left, up
and front: half a turn about z. Of an .spz that follows its specification they are right, up and back: half a turn
about x. Centres and rotations change two signs, and so do the spherical harmonics that are odd in the turned axes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from gaussian_trimmer.gaussians import Gaussians

AXIS_SIGNS = {"x": np.array([1, -1, -1], np.float32), "z": np.array([-1, -1, 1], np.float32)}
"""What half a turn about an axis does to a vector, and to the vector part of a quaternion."""
SH_SIGNS = {
    "x": np.array([-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1], np.float32),
    "z": np.array([-1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1], np.float32),
}
"""What it does to the harmonics y, z, x, xy, yz, z2, xz, x2-y2, ... of degrees 1 to 3."""


def half_turn(gaussians: Gaussians, axis: Literal["x", "z"]) -> Gaussians:
    """Return the Gaussians after half a turn about an axis through the origin, seen as before from the turned side."""
    signs, coefficients = AXIS_SIGNS[axis], gaussians.sh_rest.shape[2]
    return replace(
        gaussians,
        means=gaussians.means * signs,
        quaternions=gaussians.quaternions * np.concatenate([[1], signs]).astype(np.float32),
        sh_rest=gaussians.sh_rest * SH_SIGNS[axis][:coefficients],
    )
