"""The splat scene as arrays: one row per Gaussian, stored as the Inria PLY stores it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float32]
Float64Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

SH_C0 = 0.28209479177387814
"""Value of the constant real spherical harmonic, sqrt(1 / (4 pi))."""


@dataclass(frozen=True, eq=False)
class Gaussians:
    """N anisotropic Gaussians with the attributes of 3D Gaussian Splatting, in stored (unactivated) form.

    The arrays may be views onto a memory-mapped file; nothing in this package writes to them in place.
    """

    means: FloatArray
    """Centres in world coordinates, (N, 3)."""
    log_scales: FloatArray
    """Natural logarithm of the standard deviations along the local axes, (N, 3)."""
    quaternions: FloatArray
    """Rotations (w, x, y, z) from local axes to world, not necessarily of unit length, (N, 4)."""
    opacity_logits: FloatArray
    """Opacities before the sigmoid, (N,)."""
    sh_dc: FloatArray
    """Degree-0 spherical-harmonics coefficients of red, green and blue, (N, 3)."""
    sh_rest: FloatArray
    """Coefficients of degrees 1 to 3, channel-major as in the PLY's f_rest, (N, 3, 0 | 3 | 8 | 15)."""
    extras: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """Columns that the renderer does not use, by name, each (N,): kept so that they can be read and passed on."""

    def __post_init__(self) -> None:
        n = len(self.means)
        expected = {
            "means": (n, 3),
            "log_scales": (n, 3),
            "quaternions": (n, 4),
            "opacity_logits": (n,),
            "sh_dc": (n, 3),
        }
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} has shape {getattr(self, name).shape}; {shape} is needed for {n} Gaussians.")
        if self.sh_rest.shape[:2] != (n, 3) or self.sh_rest.shape[2] not in (0, 3, 8, 15):
            raise ValueError(f"sh_rest has shape {self.sh_rest.shape}; ({n}, 3, K) with K = 0, 3, 8 or 15 is needed.")

    def __len__(self) -> int:
        return len(self.means)

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics, 0 to 3."""
        return {0: 0, 3: 1, 8: 2, 15: 3}[self.sh_rest.shape[2]]

    @property
    def scales(self) -> FloatArray:
        """Standard deviations along the local axes, (N, 3)."""
        return np.exp(self.log_scales)

    @property
    def opacities(self) -> FloatArray:
        """Opacities in (0, 1), (N,)."""
        return sigmoid(self.opacity_logits)

    def covariances(self) -> Float64Array:
        """World covariances R diag(s^2) R^T, (N, 3, 3), in float64."""
        factors = rotation_matrices(self.quaternions) * np.exp(self.log_scales.astype(np.float64))[:, None, :]
        return factors @ factors.transpose(0, 2, 1)

    def select(self, rows: BoolArray | IntArray | slice) -> Gaussians:
        """The Gaussians of a boolean mask (N,), of row numbers, or of a slice, as copies (views for a slice)."""
        if isinstance(rows, np.ndarray) and rows.dtype == np.bool_ and len(rows) != len(self):
            raise ValueError(f"The mask has {len(rows)} entries for {len(self)} Gaussians.")
        return Gaussians(
            self.means[rows],
            self.log_scales[rows],
            self.quaternions[rows],
            self.opacity_logits[rows],
            self.sh_dc[rows],
            self.sh_rest[rows],
            {name: column[rows] for name, column in self.extras.items()},
        )

    def replace(self, **arrays: Any) -> Gaussians:
        """A copy in which the named fields are other arrays."""
        return replace(self, **arrays)


def concatenate(parts: Sequence[Gaussians]) -> Gaussians:
    """Gaussians of all parts, in order. Extra columns that not all parts have are left out.

    Raises:
        ValueError: there is no part, or the parts' SH degrees differ.
    """
    if not parts:
        raise ValueError("concatenate needs at least one set of Gaussians.")
    if len({part.sh_degree for part in parts}) > 1:
        raise ValueError(f"The parts have SH degrees {[part.sh_degree for part in parts]}; equal degrees are needed.")
    shared = [name for name in parts[0].extras if all(name in part.extras for part in parts)]
    return Gaussians(
        np.concatenate([part.means for part in parts]),
        np.concatenate([part.log_scales for part in parts]),
        np.concatenate([part.quaternions for part in parts]),
        np.concatenate([part.opacity_logits for part in parts]),
        np.concatenate([part.sh_dc for part in parts]),
        np.concatenate([part.sh_rest for part in parts]),
        {name: np.concatenate([part.extras[name] for part in parts]) for name in shared},
    )


def sigmoid(logits: FloatArray) -> FloatArray:
    """Logistic function, without overflow for large negative arguments.

    >>> sigmoid(np.float32([-1000.0, 0.0, 1000.0])).tolist()
    [0.0, 0.5, 1.0]
    """
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * logits)), dtype=logits.dtype)


def logit(probabilities: Float64Array) -> Float64Array:
    """Inverse of the sigmoid; arguments are clipped to [1e-7, 1 - 1e-7] so that the result is finite.

    >>> float(logit(np.array([0.5]))[0])
    0.0
    """
    clipped = np.clip(probabilities, 1e-7, 1.0 - 1e-7)
    return np.asarray(np.log(clipped / (1.0 - clipped)))


def rotation_matrices(quaternions: FloatArray) -> Float64Array:
    """Rotation matrices of (w, x, y, z) quaternions of any non-zero length, (N, 3, 3), in float64."""
    q = quaternions.astype(np.float64)
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternions_of(rotations: Float64Array) -> FloatArray:
    """Unit quaternions (w, x, y, z) with w >= 0 of rotation matrices (N, 3, 3).

    >>> quaternions_of(np.eye(3)[None]).tolist()
    [[1.0, 0.0, 0.0, 0.0]]
    """
    m = rotations
    # Each candidate is 4 q_k q for one component k; the one with the largest diagonal is the most accurate.
    d = np.einsum("nii->ni", m)
    trace = d.sum(1)
    candidates = np.empty((len(m), 4, 4))
    candidates[:, 0, 0] = 1 + trace
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        candidates[:, k + 1, k + 1] = 1 + 2 * d[:, k] - trace
        candidates[:, 0, k + 1] = candidates[:, k + 1, 0] = m[:, j, i] - m[:, i, j]
        candidates[:, i + 1, j + 1] = candidates[:, j + 1, i + 1] = m[:, i, j] + m[:, j, i]
    best = np.argmax(np.einsum("nii->ni", candidates), axis=1)
    q = candidates[np.arange(len(m)), best]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    q *= np.where(q[:, :1] < 0, -1.0, 1.0)
    return np.asarray(q, np.float32)
