"""What every camera file says of an image, its lens and its pose, and the checks that these are possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.io.reading import LARGEST

DISTORTION_TOLERANCE = 1e-4
"""Largest distortion coefficient that is taken for zero: it moves the corner of a 1000-pixel image by 0.05 pixels."""
_RIGID_TOLERANCE = 1e-2
_MAX_IMAGE_SIDE = 1 << 16
_MAX_PIXELS = 1 << 28
_MAX_SIDES = 1e4
"""Focal lengths and distances of the principal point from the picture, in longer sides of the picture, at most; and
focal lengths, in parts of it, at least. Fields of view end at 0.006 and 179.99 degrees so."""


@dataclass(frozen=True, eq=False)
class Intrinsics:
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
class PosedImage:
    """One image as read, before its name is settled."""

    path: str
    """The image's name or path, as the file gives it."""
    world_to_camera: Float64Array
    """Rigid transform from world to camera coordinates, OpenCV axes, (4, 4)."""
    intrinsics: Intrinsics
    """The lens that took the image."""
    train: bool = True
    """Whether it is a training image."""


def make_intrinsics(pinhole: Sequence[Any], width: Any, height: Any, distorted: bool, where: str) -> Intrinsics:
    """Return intrinsics from fx, fy, cx, cy and the image size.

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
    return Intrinsics(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), int(size[0]), int(size[1]), distorted)


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
