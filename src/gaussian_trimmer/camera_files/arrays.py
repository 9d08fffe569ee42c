"""Cameras from arrays or tensors, as training code holds them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gaussian_trimmer.camera_files.frames import make_intrinsics, rigid_transforms
from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.errors import InputError


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
        lens = make_intrinsics(
            (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]), width, height, False, f"Camera {i}"
        )
        cameras.append(Camera(transforms[i], lens.K, lens.width, lens.height, names[i] if names else str(i)))
    return CameraSet(tuple(cameras), None, (True,) * n, distorted=False)


def _numbers(values: Any) -> np.ndarray[Any, Any]:
    try:
        return np.asarray(values.detach().cpu() if hasattr(values, "detach") else values, np.float64)
    except (ValueError, TypeError) as error:
        raise InputError(
            f"The cameras are given as a {type(values).__name__} that is not numbers ({error})."
        ) from error
