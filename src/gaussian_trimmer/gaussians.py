"""The splat scene as arrays: one row per Gaussian, stored as the Inria PLY stores it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaussian_trimmer.errors import InputError

FloatArray = NDArray[np.float32]
Float64Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
LabelArray = NDArray[np.int32]
BoolArray = NDArray[np.bool_]

SplatModel = Literal["default", "antialiased", "2dgs"]
"""What Gaussians were trained as: antialiased, as Mip-Splatting and others call it, so that one which drawing widens,
being smaller than a pixel, is fainter for it; or as discs of 2D Gaussian Splatting, which have a thin third axis."""
SH_C0 = 0.28209479177387814
"""Value of the constant real spherical harmonic, sqrt(1 / (4 pi))."""


@dataclass(frozen=True, eq=False)
class Gaussians:
    """N anisotropic Gaussians with the attributes of 3D Gaussian Splatting, in stored (unactivated) form.

    The arrays may be views of a larger table; nothing in this package writes to them in place. Numbers of other types,
    such as float64, are converted to float32 here, once.
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
    """Columns that drawing does not use, by name, each (N,): kept so that they can be read and passed on."""
    format_up: tuple[float, float, float] | None = None
    """Where up points by the file that they were read from or by the specification of its format, if either says it."""
    model: SplatModel = "default"
    """What they were trained as."""
    notes: tuple[str, ...] = ()
    """What reading has left out or changed, a clause each."""

    def __post_init__(self) -> None:
        for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"):
            values = getattr(self, name)
            if not isinstance(values, np.ndarray) or values.dtype != np.float32:
                object.__setattr__(self, name, np.asarray(values, np.float32))
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
        if self.sh_rest.shape[:2] != (n, 3) or self.sh_rest.shape[2:] not in ((0,), (3,), (8,), (15,)):
            raise ValueError(f"sh_rest has shape {self.sh_rest.shape}; ({n}, 3, K) with K = 0, 3, 8 or 15 is needed.")

    @classmethod
    def from_arrays(
        cls,
        means: ArrayLike,
        quaternions: ArrayLike,
        sh: ArrayLike,
        *,
        scales: ArrayLike | None = None,
        log_scales: ArrayLike | None = None,
        opacities: ArrayLike | None = None,
        opacity_logits: ArrayLike | None = None,
    ) -> Gaussians:
        """Gaussians from arrays, or tensors on any device, as gsplat and Inria's code hold them; copies in float32.

        Scales and opacities are given either as they are or as they are trained, said by name.

        Args:
            means: centres in world coordinates, (N, 3).
            quaternions: rotations (w, x, y, z), of any non-zero length, (N, 4).
            sh: spherical-harmonics coefficients of degrees 0 to 3, coefficient before channel, (N, K, 3) with K = 1, 4,
                9 or 16: Inria's `_features_dc` and `_features_rest`, or gsplat's `sh0` and `shN`, joined along axis 1.
            scales: standard deviations along the local axes, above zero, (N, 3).
            log_scales: their natural logarithms, in place of `scales`: Inria's `_scaling`.
            opacities: from 0 to 1, (N,) or (N, 1).
            opacity_logits: before the sigmoid, in place of `opacities`: Inria's `_opacity`.

        Raises:
            InputError: not exactly one of each pair is given, a shape does not fit, a value is NaN, infinite or out of
                its range, or a quaternion has length zero.
        """
        points = _array("means", means, (-1, 3))
        n = len(points)
        rotations, coefficients = _array("quaternions", quaternions, (n, 4)), _array("sh", sh, (n, -1, 3))
        if coefficients.shape[1] not in (1, 4, 9, 16):
            raise InputError(f"sh has shape {coefficients.shape}; ({n}, K, 3) with K = 1, 4, 9 or 16 is needed.")
        if not rotations.any(axis=1).all():
            raise InputError(
                f"Quaternion {int(np.argmin(rotations.any(axis=1)))} has length zero; it is not a rotation."
            )
        sizes = _either("scales", scales, "log_scales", log_scales, (n, 3))
        if scales is not None:
            if not (sizes > 0).all():
                raise InputError(f"scales go down to {sizes.min():g}; give logarithms as log_scales.")
            sizes = np.log(sizes.astype(np.float64)).astype(np.float32)
        opacity = _either("opacities", opacities, "opacity_logits", opacity_logits, (n,))
        if opacities is not None:
            if not ((opacity >= 0) & (opacity <= 1)).all():
                raise InputError(
                    f"opacities go from {opacity.min():g} to {opacity.max():g}, not from 0 to 1; give values before "
                    "the sigmoid as opacity_logits."
                )
            opacity = logit(opacity.astype(np.float64)).astype(np.float32)
        by_channel = coefficients.transpose(0, 2, 1)
        sh_dc, sh_rest = by_channel[:, :, 0].copy(), by_channel[:, :, 1:].copy()
        return cls(points.copy(), sizes.copy(), rotations.copy(), opacity.copy(), sh_dc, sh_rest)

    def to_arrays(self, *, activated: bool = False) -> dict[str, FloatArray]:
        """The arguments of `from_arrays` that give these Gaussians, without extra columns.

        Args:
            activated: give `scales` and `opacities` as gsplat's rasterization takes them, in place of `log_scales` and
                `opacity_logits`.
        """
        sh = np.concatenate([self.sh_dc[:, :, None], self.sh_rest], axis=2).transpose(0, 2, 1)
        arrays = {"means": self.means.copy(), "quaternions": self.quaternions.copy(), "sh": np.ascontiguousarray(sh)}
        if activated:
            return {**arrays, "scales": self.scales, "opacities": self.opacities}
        return {**arrays, "log_scales": self.log_scales.copy(), "opacity_logits": self.opacity_logits.copy()}

    def __len__(self) -> int:
        return len(self.means)

    def __repr__(self) -> str:
        degree = int((1 + self.sh_rest.shape[2]) ** 0.5) - 1
        return f"<Gaussians: {len(self):,}, spherical harmonics of degree {degree}>"

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics, 0 to 3."""
        return {0: 0, 3: 1, 8: 2, 15: 3}[self.sh_rest.shape[2]]

    @property
    def scales(self) -> FloatArray:
        """Standard deviations along the local axes, (N, 3)."""
        return np.exp(self.log_scales)

    @property
    def largest_log_scales(self) -> FloatArray:
        """Logarithm of each Gaussian's largest standard deviation, (N,)."""
        first, second, third = self.log_scales.T
        return np.asarray(np.maximum(np.maximum(first, second), third))  # three times as fast as row by row

    @property
    def opacities(self) -> FloatArray:
        """Opacities in (0, 1), (N,)."""
        return sigmoid(self.opacity_logits)

    @property
    def antialiased(self) -> bool:
        """Whether what is smaller than a pixel is drawn fainter."""
        return self.model == "antialiased"

    @property
    def blank(self) -> BoolArray:
        """Which rows stand for what a file has there but cannot be used, (N,): opacities of exactly zero mark them."""
        return np.asarray(np.isneginf(self.opacity_logits))

    def factors(self) -> Float64Array:
        """Factors R diag(s) of the covariances, whose columns are the axes, one deviation long, (N, 3, 3), float64."""
        return rotation_matrices(self.quaternions) * np.exp(self.log_scales.astype(np.float64))[:, None, :]

    def covariances(self) -> Float64Array:
        """World covariances R diag(s^2) R^T, (N, 3, 3), in float64."""
        factors = self.factors()
        return factors @ factors.transpose(0, 2, 1)

    def select(self, rows: BoolArray | IntArray | slice) -> Gaussians:
        """The Gaussians of a boolean mask (N,), of row numbers, or of a slice, as copies (views for a slice)."""
        if isinstance(rows, np.ndarray) and rows.dtype == np.bool_:
            if len(rows) != len(self):
                raise ValueError(f"The mask has {len(rows)} entries for {len(self)} Gaussians.")
            rows = np.flatnonzero(rows)  # looked for once, not in each array
        return Gaussians(
            self.means[rows],
            self.log_scales[rows],
            self.quaternions[rows],
            self.opacity_logits[rows],
            self.sh_dc[rows],
            self.sh_rest[rows],
            {name: column[rows] for name, column in self.extras.items()},
            self.format_up,
            self.model,
        )

    def replace(self, **arrays: Any) -> Gaussians:
        """A copy in which the named fields are other arrays."""
        return replace(self, **arrays)


def _array(name: str, values: Any, shape: tuple[int, ...]) -> FloatArray:
    """Finite numbers in float32, of a shape, in which -1 stands for any length."""
    try:
        if hasattr(values, "detach"):  # a tensor of PyTorch, on any device, of any number type
            values = values.detach().cpu().float().numpy()
        with np.errstate(over="ignore"):  # what is too large becomes infinite, and is refused below
            array = np.asarray(values, np.float32)
    except (TypeError, ValueError, RuntimeError, AttributeError) as error:
        raise InputError(f"{name} is a {type(values).__name__} that NumPy cannot read ({error}).") from error
    if len(shape) == 1 and array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    if array.ndim != len(shape) or any(n not in (m, -1) for n, m in zip(shape, array.shape, strict=True)):
        needed = ", ".join("any" if n == -1 else str(n) for n in shape) + ("," if len(shape) == 1 else "")
        raise InputError(f"{name} has shape {array.shape}; ({needed}) is needed.")
    if not np.isfinite(array).all():
        raise InputError(f"{name} holds NaN or infinite values; remove such Gaussians first.")
    return array


def _either(name: str, values: Any, raw_name: str, raw_values: Any, shape: tuple[int, ...]) -> FloatArray:
    """The one of two arrays that is given; not both."""
    if (values is None) == (raw_values is None):
        raise InputError(f"Give either {name} or {raw_name}.")
    return _array(name, values, shape) if raw_values is None else _array(raw_name, raw_values, shape)


def of_one_degree(parts: Sequence[Gaussians]) -> list[Gaussians]:
    """Return parts with the harmonics of the part that has most; what a part does not have is zero."""
    most = max(part.sh_rest.shape[2] for part in parts)
    return [
        part.replace(sh_rest=np.pad(part.sh_rest, ((0, 0), (0, 0), (0, most - part.sh_rest.shape[2]))))
        for part in parts
    ]


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
        parts[0].format_up,
        next((part.model for part in parts if part.model != "default"), "default"),
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


def check_gaussians(scene: Any) -> None:
    """Refuse paths and bare arrays where a scene is needed.

    Raises:
        InputError: the scene is not `Gaussians`.
    """
    if not isinstance(scene, Gaussians):
        raise InputError(f"The scene is a {type(scene).__name__}; give Gaussians, from gaussian_trimmer.read(path).")


def mask_of_rows(rows: IntArray, n: int) -> BoolArray:
    """Return some of n rows as a mask, (n,)."""
    mask = np.zeros(n, np.bool_)
    mask[rows] = True
    return mask


def rotation_matrices(quaternions: FloatArray) -> Float64Array:
    """Rotation matrices of (w, x, y, z) quaternions of any non-zero length, (N, 3, 3), in float64."""
    w, x, y, z = quaternions.T.astype(np.float64)
    length = np.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w / length, x / length, y / length, z / length
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    rotations = np.empty((len(quaternions), 3, 3))
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            rotations[:, i, j] = entry
    return rotations


def ellipsoid_points(gaussians: Gaussians) -> Float64Array:
    """The centre of each Gaussian, and the points one standard deviation from it along its axes, (N, 7, 3).

    >>> one = Gaussians([[0, 0, 5]], np.log([[1, 2, 3]]), [[1, 0, 0, 0]], [0], [[0, 0, 0]], np.zeros((1, 3, 0)))
    >>> ellipsoid_points(one)[0, 4:].round(6).tolist()
    [[-1.0, 0.0, 5.0], [0.0, -2.0, 5.0], [0.0, 0.0, 2.0]]
    """
    axes = np.swapaxes(gaussians.factors(), 1, 2)
    return np.asarray(gaussians.means[:, None] + np.concatenate([np.zeros((len(axes), 1, 3)), axes, -axes], axis=1))


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
