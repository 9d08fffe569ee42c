"""Lenses and poses from files and arrays, and the checks that they are possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.io.reading import LARGEST

Lens = tuple[Float64Array, int, int]
"""Intrinsic matrix in pixels, (3, 3), width and height."""
DISTORTION_TOLERANCE = 1e-4
"""Largest distortion coefficient that is taken for zero: it moves the corner of a 1000-pixel image by 0.05 pixels."""
_RIGID_TOLERANCE = 1e-2
_MAX_IMAGE_SIDE = 1 << 16
_MAX_PIXELS = 1 << 28
_MAX_SIDES = 1e4
"""Focal lengths and distances of the principal point from the picture, in longer sides of the picture, at most; and
focal lengths, in parts of it, at least. Fields of view end at 0.006 and 179.99 degrees so."""


def make_lens(pinhole: Sequence[Any], width: Any, height: Any, where: str) -> Lens:
    """Return the lens of fx, fy, cx, cy and an image size.

    Raises:
        InputError: they are not possible; the message begins with `where`.
    """
    fx, fy, cx, cy = floats(pinhole, (4,), f"{where}: focal lengths and principal point")
    if fx <= 0 or fy <= 0:
        raise InputError(f"{where}: the focal lengths {fx} and {fy} must be positive.")
    size = floats([width, height], (2,), f"{where}: the image size")
    if ((size < 1) | (size > _MAX_IMAGE_SIDE) | (size % 1 != 0)).any() or size.prod() > _MAX_PIXELS:
        raise InputError(f"{where}: an image of {size[0]:.12g} x {size[1]:.12g} pixels is not possible.")
    reach = size.max() * _MAX_SIDES
    if not all(size.max() / _MAX_SIDES <= focal <= reach for focal in (fx, fy)) or max(abs(cx), abs(cy)) > reach:
        raise InputError(
            f"{where}: the focal lengths {fx:g} and {fy:g} with the principal point ({cx:g}, {cy:g}) are not possible "
            f"for an image of {size[0]:g} x {size[1]:g} pixels."
        )
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), int(size[0]), int(size[1])


def rigid_transforms(poses: Sequence[Any], where: Callable[[int], str]) -> Float64Array:
    """Return rigid transforms (V, 4, 4) of poses of three or four rows each; rotations become exactly orthonormal.

    Arguments:
        where: what the message on a pose begins with, by its number.

    Raises:
        InputError: one is not rigid.
    """
    given = np.array([_four_rows(pose, f"{where(i)}: the pose") for i, pose in enumerate(poses)]).reshape(-1, 4, 4)
    left, stretch, right = np.linalg.svd(given[:, :3, :3])
    rotations = left @ right
    for wrong, problem in (
        (
            (np.abs(stretch - 1).max(axis=1) > _RIGID_TOLERANCE) | (np.linalg.det(rotations) < 0),
            "the pose is scaled, sheared or mirrored; a rotation and a translation are needed",
        ),
        (np.abs(given[:, 3] - [0, 0, 0, 1]).max(axis=1) > 1e-6, "the last row of the pose must be 0 0 0 1"),
    ):
        if wrong.any():
            raise InputError(f"{where(int(wrong.argmax()))}: {problem}.")
    transforms = np.tile(np.eye(4), (len(given), 1, 1))
    transforms[:, :3, :3], transforms[:, :3, 3] = rotations, given[:, :3, 3]
    return transforms


def rigid_transform(pose: Any, where: str) -> Float64Array:
    """Return a rigid transform (4, 4); otherwise as `rigid_transforms`."""
    transform: Float64Array = rigid_transforms([pose], lambda _: where)[0]
    return transform


def inverse(transform: Float64Array) -> Float64Array:
    """Return the inverse of a rigid transform (4, 4)."""
    result = np.eye(4)
    result[:3, :3] = transform[:3, :3].T
    result[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return result


def _four_rows(pose: Any, what: str) -> Float64Array:
    rows = 3 if isinstance(pose, (list, np.ndarray)) and len(pose) == 3 else 4
    given = floats(pose, (rows, 4), what)
    return given if rows == 4 else np.concatenate([given, [[0, 0, 0, 1]]])


def floats(values: Any, shape: tuple[int, ...], what: str) -> Float64Array:
    """Return numbers of a given shape, which may be text, neither NaN nor extreme; () is a single one.

    Raises:
        InputError: the values are not such numbers; the message begins with `what`.
    """
    array: Float64Array | None
    try:
        array = np.array(values, np.float64)
    except (ValueError, TypeError, OverflowError):
        array = None
    if array is None or array.shape != shape or not (np.abs(array) <= LARGEST).all():
        count = " x ".join(map(str, shape)) or "one"
        raise InputError(f"{what} must be {count} finite number{'s' if shape else ''} up to {LARGEST:g}.")
    return array


def cameras_from_arrays(world_to_camera: Any, K: Any, sizes: Any, names: Sequence[str] = ()) -> CameraSet:
    """Return the cameras that arrays, or tensors on any device, hold, as gsplat's rasterization takes them.

    Args:
        world_to_camera: rigid transforms from world to camera, OpenCV axes, (V, 4, 4) or (V, 3, 4).
        K: intrinsic matrices in pixels, (V, 3, 3), or (3, 3) for all.
        sizes: widths and heights of the pictures in pixels, (V, 2), or (2,) for all.
        names: of the pictures; by default numbers.

    Raises:
        InputError: shapes do not fit, a pose is not rigid, or a lens is not possible.

    >>> cameras = cameras_from_arrays(np.eye(4)[None], [[500, 0, 320], [0, 500, 240], [0, 0, 1]], (640, 480))
    >>> cameras.cameras[0].width, cameras.cameras[0].forward.tolist()
    (640, [0.0, 0.0, 1.0])
    """
    poses, matrices, pixels = (_numbers(values) for values in (world_to_camera, K, sizes))
    n = len(poses) if poses.ndim == 3 else 0
    if not n or matrices.shape not in ((3, 3), (n, 3, 3)) or pixels.shape not in ((2,), (n, 2)):
        raise InputError(
            f"world_to_camera, K and sizes have the shapes {poses.shape}, {matrices.shape} and {pixels.shape}; "
            "(V, 4, 4), (V, 3, 3) or (3, 3), and (V, 2) or (2,) are needed."
        )
    if names and len(names) != n:
        raise InputError(f"There are {len(names)} names for {n} cameras.")
    transforms = rigid_transforms(list(poses), lambda i: f"Camera {i}")
    cameras = []
    for i in range(n):
        matrix, (width, height) = np.broadcast_to(matrices, (n, 3, 3))[i], np.broadcast_to(pixels, (n, 2))[i]
        lens = make_lens((matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]), width, height, f"Camera {i}")
        cameras.append(Camera(transforms[i], *lens, names[i] if names else str(i)))
    return CameraSet(tuple(cameras), None, (True,) * n, distorted=False)


def _numbers(values: Any) -> NDArray[Any]:
    try:
        return np.asarray(values.detach().cpu() if hasattr(values, "detach") else values, np.float64)
    except (ValueError, TypeError) as error:
        raise InputError(
            f"The cameras are given as a {type(values).__name__} that is not numbers ({error})."
        ) from error
