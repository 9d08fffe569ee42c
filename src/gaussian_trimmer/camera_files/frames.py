"""What every camera file says of an image, its lens and its pose, and the checks that these are possible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array

DISTORTION_TOLERANCE = 1e-4
"""Largest distortion coefficient that is taken for zero: it moves the corner of a 1000-pixel image by 0.05 pixels."""
_RIGID_TOLERANCE = 1e-2
_MAX_IMAGE_SIDE = 1 << 16


@dataclass(frozen=True, eq=False)
class Lens:
    """Intrinsics that several images may share."""

    K: Float64Array
    """Intrinsic matrix in pixels, (3, 3)."""
    width: int
    """Image width in pixels."""
    height: int
    """Image height in pixels."""
    distorted: bool
    """Whether the lens moves pixels away from where K alone projects them."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One image as read, before its name is settled."""

    path: str
    """The image's name or path, as the file gives it."""
    world_to_camera: Float64Array
    """Rigid transform from world to camera coordinates, OpenCV axes, (4, 4)."""
    lens: Lens
    """The lens that took the image."""
    train: bool = True
    """Whether it is a training image."""


def make_lens(pinhole: Sequence[Any], width: Any, height: Any, distorted: bool, where: str) -> Lens:
    """Intrinsics from fx, fy, cx, cy and the image size.

    Raises:
        InputError: they are not possible; the message begins with `where`.
    """
    fx, fy, cx, cy = floats(pinhole, (4,), f"{where}: focal lengths and principal point")
    if fx <= 0 or fy <= 0:
        raise InputError(f"{where}: the focal lengths {fx} and {fy} must be positive.")
    return Lens(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), *image_size(width, height, where), distorted)


def image_size(width: Any, height: Any, where: str) -> tuple[int, int]:
    """Width and height in whole pixels.

    Raises:
        InputError: no image has this size; the message begins with `where`.
    """
    size = floats([width, height], (2,), f"{where}: the image size")
    if (size < 1).any() or (size > _MAX_IMAGE_SIDE).any() or (size % 1 != 0).any():
        raise InputError(f"{where}: an image of {width} x {height} pixels is not possible.")
    return int(size[0]), int(size[1])


def rigid_transform(matrix: Any, where: str) -> Float64Array:
    """A rigid transform (4, 4) from three or four rows, its rotation rounded to the nearest orthonormal matrix.

    Raises:
        InputError: it is not rigid; the message begins with `where`.
    """
    rows = 3 if isinstance(matrix, (list, np.ndarray)) and len(matrix) == 3 else 4
    given = floats(matrix, (rows, 4), f"{where}: the pose")
    left, stretch, right = np.linalg.svd(given[:3, :3])
    rotation = left @ right
    if abs(stretch - 1).max() > _RIGID_TOLERANCE or np.linalg.det(rotation) < 0:
        raise InputError(f"{where}: the pose is scaled, sheared or mirrored; a rotation and a translation are needed.")
    if rows == 4 and abs(given[3] - [0, 0, 0, 1]).max() > 1e-6:
        raise InputError(f"{where}: the last row of the pose must be 0 0 0 1.")
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, given[:3, 3]
    return transform


def floats(values: Any, shape: tuple[int, ...], what: str) -> Float64Array:
    """Finite numbers of a given shape; () is a single one.

    Raises:
        InputError: the values are no such numbers; the message begins with `what`.
    """
    array: Float64Array | None
    try:
        array = np.array(values, np.float64)
    except (ValueError, TypeError, OverflowError):
        array = None
    if array is None or array.shape != shape or not np.isfinite(array).all():
        count = " x ".join(map(str, shape)) or "one"
        raise InputError(f"{what} must be {count} finite number{'s' if shape else ''}.")
    return array
