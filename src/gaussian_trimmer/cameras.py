"""Pinhole cameras in the OpenCV convention: x right, y down, z forward, pixel centres at +0.5."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Float64Array

_MAX_SQUARABLE = 1e150
"""Squares of numbers between this and its inverse neither overflow nor vanish."""
_MOST_POINTS, _FAR_FEWER = 3000, 0.25
"""Points of a scene by which it is told whether cameras look at it; share of what they would show if turned around,
below which they look away."""
AXIS = re.compile(r"[+-]?[xyz]", re.IGNORECASE)
"""How an axis is written."""


@dataclass(frozen=True, eq=False)
class Camera:
    """One view: pose, intrinsics and image size."""

    world_to_camera: Float64Array
    """Rigid transform from world to camera coordinates, (4, 4)."""
    K: Float64Array
    """Intrinsic matrix in pixels, (3, 3); the image's upper left corner is (0, 0)."""
    width: int
    """Image width in pixels."""
    height: int
    """Image height in pixels."""
    name: str = ""
    """File name of the image that the camera took, or empty for a virtual one."""
    near: float = 0.01
    """Gaussians whose centres are nearer than this, in scene units, or behind the camera, are not drawn."""

    @property
    def rotation(self) -> Float64Array:
        """World-to-camera rotation, (3, 3); its rows are the camera's right, down and forward axes in the world."""
        return np.asarray(self.world_to_camera[:3, :3])

    @property
    def centre(self) -> Float64Array:
        """Position of the camera in the world, (3,)."""
        return np.asarray(-self.rotation.T @ self.world_to_camera[:3, 3])

    @property
    def forward(self) -> Float64Array:
        """Viewing direction in the world, (3,)."""
        return np.asarray(self.rotation[2])

    def to_camera(self, points: Float64Array) -> Float64Array:
        """Camera coordinates of world points (N, 3)."""
        return np.asarray(points @ self.rotation.T + self.world_to_camera[:3, 3])

    def project(self, points: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Pixel coordinates (N, 2) and depths (N,) of world points (N, 3); points at depth <= 0 give NaN pixels."""
        local = self.to_camera(np.asarray(points, np.float64))
        depths = local[:, 2]
        homogeneous = local @ self.K.T
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = homogeneous[:, :2] / np.where(depths > 0, depths, np.nan)[:, None]
        return pixels, depths

    def contains(self, pixels: Float64Array) -> BoolArray:
        """Which pixels of `project` (N, 2) lie in the image, (N,); NaN, as behind the camera, does not."""
        return np.asarray(((pixels >= 0) & (pixels < (self.width, self.height))).all(axis=1), np.bool_)

    def ray_directions(self, pixels: Float64Array) -> Float64Array:
        """Unit world directions of the rays through pixel coordinates (P, 2), as (P, 3)."""
        homogeneous = np.column_stack([pixels, np.ones(len(pixels))])
        directions = homogeneous @ np.linalg.inv(self.K).T @ self.rotation
        return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))

    def part(self, left: int, top: int, right: int, bottom: int) -> Camera:
        """The same view, of which only the pixels from (left, top) up to before (right, bottom) are kept."""
        K = self.K.copy()
        K[:2, 2] -= left, top
        return replace(self, K=K, width=right - left, height=bottom - top)

    def resized(self, scale: float) -> Camera:
        """The same view on an image larger or smaller by a factor; sizes are rounded to whole pixels, at least one."""
        width, height = max(1, round(self.width * scale)), max(1, round(self.height * scale))
        K = self.K.copy()
        K[0] *= width / self.width
        K[1] *= height / self.height
        return replace(self, K=K, width=width, height=height)


@dataclass(frozen=True, eq=False)
class CameraSet:
    """The cameras of one file, in its order, and what else the file says about them."""

    cameras: tuple[Camera, ...]
    """V cameras, pinhole even where the images are distorted."""
    up: Float64Array | None
    """Unit up vector that the file states, (3,), or None."""
    train: tuple[bool, ...]
    """Which cameras took training images, (V,); all of them where the file names no split."""
    distorted: bool
    """Whether some image is distorted by its lens, so that its pixels are not where the cameras project them."""

    def __repr__(self) -> str:
        trained = sum(self.train)
        return f"<CameraSet: {len(self.cameras)} cameras, {trained} of them for training>"

    def pinhole_cameras(self) -> tuple[Camera, ...]:
        """The cameras for use with the pixels of their images.

        Raises:
            InputError: an image is distorted. (Poses and fields of view of `cameras` can be used all the same.)
        """
        if self.distorted:
            raise InputError(
                "The cameras have lens distortion, so masks of their images cannot be used; "
                "undistort images and cameras first (colmap image_undistorter) and give the new ones."
            )
        return self.cameras


def as_camera_set(cameras: CameraSet | Sequence[Camera] | None) -> CameraSet | None:
    """Return the training cameras of a scene as a set; a list of cameras is one whose pictures all were trained on.

    Raises:
        InputError: they are something else.
    """
    if cameras is None or isinstance(cameras, CameraSet):
        return cameras
    if isinstance(cameras, Sequence) and cameras and all(isinstance(camera, Camera) for camera in cameras):
        return CameraSet(tuple(cameras), None, (True,) * len(cameras), distorted=False)
    what = f"a {type(cameras).__name__}"
    if isinstance(cameras, list | tuple):
        what = f"a list of {type(cameras[0]).__name__}" if cameras else "an empty list"
    raise InputError(
        f"The cameras are {what}; give a CameraSet, from gaussian_trimmer.read_cameras(path) or "
        "cameras_from_arrays(...), or a list of gaussian_trimmer.cameras.Camera."
    )


def training_cameras(cameras: CameraSet | None) -> list[Camera]:
    """Those that took training images, in their order; none if no cameras are known."""
    listed = zip(cameras.cameras, cameras.train, strict=True) if cameras else ()
    return [camera for camera, train in listed if train]


def only_training(cameras: CameraSet) -> CameraSet:
    """The same set without its held-out cameras, which are ground truth."""
    kept = tuple(training_cameras(cameras))
    return replace(cameras, cameras=kept, train=(True,) * len(kept))


def check_facing(cameras: CameraSet | None, means: NDArray[np.floating]) -> None:
    """Refuse cameras that look away from a scene with centres (N, 3).

    Raises:
        InputError: turned around they would show much more of it, or they show nothing.
    """
    taken = cameras.pinhole_cameras() if cameras is not None else ()
    points = means[:: 1 + len(means) // _MOST_POINTS].astype(np.float64)
    around = [replace(one, world_to_camera=np.diag([1.0, -1, -1, 1]) @ one.world_to_camera) for one in taken]
    if not taken:
        return
    shown, turned = (float(np.mean([one.contains(one.project(points)[0]) for one in some])) for some in (taken, around))
    if shown < _FAR_FEWER * turned:
        raise InputError(
            f"The cameras look away from the scene: a picture shows {100 * shown:.1f} % of it, and would show "
            f"{100 * turned:.0f} % if they were turned around. Their axes seem to be OpenGL's (y up, z backward); "
            "negate the second and third column of each camera-to-world matrix."
        )
    if not shown:
        raise InputError(
            f"None of the {len(taken)} cameras has the scene in its picture; check that they belong to it."
        )


def unit_up(vector: Any, what: str = "The up vector") -> Float64Array:
    """An up vector (3,) of length one.

    Args:
        vector: three numbers.
        what: what the vector is called in the message.

    Raises:
        InputError: the vector is not three finite numbers, or they are all zero.

    >>> unit_up([0, 0, 5]).tolist()
    [0.0, 0.0, 1.0]
    """
    try:
        up = np.array(vector, np.float64)
    except (ValueError, TypeError, OverflowError):
        up = np.zeros(0)
    if up.shape != (3,) or not np.isfinite(up).all() or not up.any():
        given = f" {up.tolist()}" if up.shape == (3,) else ""
        raise InputError(f"{what}{given} must be three finite numbers that are not all zero.")
    largest = abs(up).max()
    if not 1 / _MAX_SQUARABLE < largest < _MAX_SQUARABLE:
        up = up / largest
    return np.asarray(up / np.linalg.norm(up))


def up_frame(up: Float64Array) -> Float64Array:
    """Return two horizontal axes and the unit up vector as rows of a right-handed (3, 3) matrix.

    Raises:
        InputError: the vector is zero or not finite.
    """
    up = unit_up(up)
    first = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first), up])


def vector_of_up(up: Any) -> tuple[float, ...]:
    """An up vector from an axis, such as "z" or "-y", or from three numbers; a fourth one is kept.

    That is the confidence of an up vector that was found, from 0 to 1.

    Raises:
        InputError: it is neither, the three numbers are all zero, or the fourth is no confidence.

    >>> vector_of_up("z"), vector_of_up([0, -2, 0, 0.5])
    ((0.0, 0.0, 1.0), (0.0, -2.0, 0.0, 0.5))
    """
    if isinstance(up, str):
        if not AXIS.fullmatch(up):
            raise InputError(f"The up vector is '{up}'; give x, y, z, -x, -y or -z, or three numbers.")
        size = -1.0 if up.startswith("-") else 1.0
        up = [size if axis == up[-1].lower() else 0.0 for axis in "xyz"]
    with_confidence = np.shape(up) == (4,)
    unit_up(up[:3] if with_confidence else up)
    if with_confidence and not (isinstance(up[3], (int, float, np.floating)) and 0 <= up[3] <= 1):
        raise InputError(f"The fourth number of an up vector is {up[3]}; it is a confidence, from 0 to 1.")
    return tuple(float(value) for value in up)


def look_at(position: Float64Array, target: Float64Array, up: Float64Array) -> Float64Array:
    """World-to-camera transform (4, 4) of a camera at `position` that faces `target`, with `up` upwards in the image.

    Raises:
        ValueError: position and target coincide, or the viewing direction is parallel to `up`.

    >>> look_at(np.array([0.0, 0, -2]), np.zeros(3), np.array([0.0, -1, 0]))[:3, 3].tolist()
    [0.0, 0.0, 2.0]
    """
    forward = np.asarray(target, np.float64) - position
    if np.linalg.norm(forward) == 0:
        raise ValueError("A camera cannot look at its own position.")
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, up)
    if np.linalg.norm(right) < 1e-9 * np.linalg.norm(up):
        raise ValueError(f"The viewing direction {forward} is parallel to the up vector {np.asarray(up)}.")
    right = right / np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = -rotation @ position + 0.0
    return transform


def intrinsics(fov_radians: float, width: int, height: int) -> Float64Array:
    """K (3, 3) of a camera with square pixels whose longer image side spans `fov_radians`, principal point central.

    Eq. 5 of GaussianTrimmer for a square image; the equation's separate focal lengths for width and height
    would stretch any other.
    """
    focal = max(width, height) / (2 * np.tan(fov_radians / 2))
    return np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])


Point = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A view that pixels refer to, and which Gaussians are drawn in it."""

    camera: Camera
    drawn_centre: Point | None = None
    """Middle of the ball in which Gaussians are drawn; None: all are."""
    drawn_radius: float = 0.0
    """Radius of that ball, in scene units."""


def point_of(values: Float64Array) -> Point:
    """Return an array (3,) as plain numbers."""
    x, y, z = values.tolist()
    return x, y, z
