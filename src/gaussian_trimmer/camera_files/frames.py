"""What every camera file says of an image, its lens and its pose, and the checks that these are possible."""

from __future__ import annotations

import math
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
_MAX_NAME = 4096
_POSES_AT_ONCE = 1024
_REACH = 1e4
"""Focal lengths and distances of the principal point from the picture, in longer sides of the picture, at most; and
focal lengths, in parts of it, at least. Fields of view end at 0.006 and 179.99 degrees so."""


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
    fx, fy, cx, cy = numbers(pinhole, 4, f"{where}: focal lengths and principal point")
    if fx <= 0 or fy <= 0:
        raise InputError(f"{where}: the focal lengths {fx} and {fy} must be positive.")
    size = image_size(width, height, where)
    reach = max(size) * _REACH
    if not all(max(size) / _REACH <= focal <= reach for focal in (fx, fy)) or max(abs(cx), abs(cy)) > reach:
        raise InputError(
            f"{where}: the focal lengths {fx:g} and {fy:g} with the principal point ({cx:g}, {cy:g}) are not possible "
            f"for an image of {size[0]} x {size[1]} pixels."
        )
    return Lens(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), *size, distorted)


def image_size(width: Any, height: Any, where: str) -> tuple[int, int]:
    """Width and height in whole pixels.

    Raises:
        InputError: no image has this size; the message begins with `where`.
    """
    size = numbers([width, height], 2, f"{where}: the image size")
    if not all(1 <= side <= _MAX_IMAGE_SIDE and side % 1 == 0 for side in size) or size[0] * size[1] > _MAX_PIXELS:
        raise InputError(f"{where}: an image of {size[0]:.12g} x {size[1]:.12g} pixels is not possible.")
    return int(size[0]), int(size[1])


def image_name(name: Any, where: str) -> str:
    """The name or path of an image.

    Raises:
        InputError: it is no text, or longer than a path can be; the message begins with `where`.
    """
    if name is None:
        return ""
    if isinstance(name, (int, float)):
        return str(name)[:_MAX_NAME]
    if not isinstance(name, str) or len(name) > _MAX_NAME:
        raise InputError(f"{where}: its image has a name that is no text, or longer than {_MAX_NAME} characters.")
    return name


def rigid_transforms(poses: Sequence[Any], where: Callable[[int], str]) -> Float64Array:
    """Rigid transforms (V, 4, 4) of poses that are each as `rigid_transform` takes them, many at once.

    Arguments:
        where: what the message on a pose begins with, by its number.

    Raises:
        InputError: one is not rigid.
    """
    parts = [np.zeros((0, 4, 4))]
    for start in range(0, len(poses), _POSES_AT_ONCE):
        some = poses[start : start + _POSES_AT_ONCE]
        transforms = _rigid_transforms(some)
        if transforms is None:  # at least one is in some other form, or wrong: one after the other
            transforms = np.array([rigid_transform(pose, where(start + i)) for i, pose in enumerate(some)])
        parts.append(transforms)
    return np.concatenate(parts)


def _rigid_transforms(poses: Sequence[Any]) -> Float64Array | None:
    """The transforms of poses (V, 4, 4), or None if any needs a closer look."""
    try:
        given = np.array(poses, np.float64)
    except (ValueError, TypeError, OverflowError):
        return None
    if given.shape[1:] != (4, 4) or not (np.abs(given) <= LARGEST).all():
        return None
    left, stretch, right = np.linalg.svd(given[:, :3, :3])
    rotations = left @ right
    rigid = (np.abs(stretch - 1).max(axis=1) <= _RIGID_TOLERANCE) & (np.linalg.det(rotations) >= 0)
    if not (rigid.all() and (np.abs(given[:, 3] - [0, 0, 0, 1]) <= 1e-6).all()):
        return None
    transforms = np.tile(np.eye(4), (len(given), 1, 1))
    transforms[:, :3, :3], transforms[:, :3, 3] = rotations, given[:, :3, 3]
    return transforms


def inverses(transforms: Float64Array) -> Float64Array:
    """Inverses of rigid transforms (V, 4, 4)."""
    result = np.tile(np.eye(4), (len(transforms), 1, 1))
    result[:, :3, :3] = transforms[:, :3, :3].transpose(0, 2, 1)
    result[:, :3, 3] = (-transforms[:, :3, :3].transpose(0, 2, 1) @ transforms[:, :3, 3:])[..., 0]
    return result


def rigid_transform(matrix: Any, where: str) -> Float64Array:
    """A rigid transform (4, 4) from three or four rows, its rotation rounded to the nearest orthonormal matrix.

    Raises:
        InputError: it is not rigid; the message begins with `where`.
    """
    rows = 3 if isinstance(matrix, (list, np.ndarray)) and len(matrix) == 3 else 4
    given = floats(matrix, (rows, 4), f"{where}: the pose")
    if (np.abs(given) > LARGEST).any():
        raise InputError(f"{where}: the pose has numbers beyond {LARGEST:g}.")
    left, stretch, right = np.linalg.svd(given[:3, :3])
    rotation = left @ right
    if abs(stretch - 1).max() > _RIGID_TOLERANCE or np.linalg.det(rotation) < 0:
        raise InputError(f"{where}: the pose is scaled, sheared or mirrored; a rotation and a translation are needed.")
    if rows == 4 and abs(given[3] - [0, 0, 0, 1]).max() > 1e-6:
        raise InputError(f"{where}: the last row of the pose must be 0 0 0 1.")
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, given[:3, 3]
    return transform


def numbers(values: Sequence[Any], count: int, what: str) -> list[float]:
    """So many finite numbers, which may be text; as `floats`, and quicker for few.

    Raises:
        InputError: the values are no such numbers; the message begins with `what`.
    """
    try:
        found = [float(value) for value in values]
    except (ValueError, TypeError, OverflowError):
        found = []
    if len(found) != count or not all(map(math.isfinite, found)):
        raise InputError(f"{what} must be {count} finite numbers.")
    return found


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
