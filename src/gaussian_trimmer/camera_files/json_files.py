"""Cameras in JSON: transforms.json, Inria's cameras.json and OpenCV matrices, told apart frame by frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from gaussian_trimmer.camera_files.frames import DISTORTION_TOLERANCE, Lens, floats, inverse, make_lens, rigid_transform
from gaussian_trimmer.cameras import Camera, CameraSet, unit_up
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.io.reading import file_bytes, is_file, picture_size, read_json

_Frame = tuple[Camera, bool, bool]
"""A camera, whether it took a training image, and whether the lens distorts."""
MAX_BYTES = 1 << 26
"""Of a JSON file of cameras."""
_MAX_PICTURE_BYTES = 1 << 28
_OPENGL_TO_OPENCV = np.array([1.0, -1.0, -1.0])
_DISTORTION_KEYS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
_SHARED_KEYS = (
    "w", "h", "fl_x", "fl_y", "camera_angle_x", "camera_angle_y", "cx", "cy", "camera_model", "is_fisheye", "width",
    "height", "fx", "fy", "K", "split", *_DISTORTION_KEYS,
)  # fmt: skip
"""What may be given once for all frames."""


def read_json_cameras(path: Path, *, trust_paths: bool = False) -> CameraSet:
    """Return the cameras of a file with split and up vector; names are as the file gives them.

    Arguments:
        trust_paths: open pictures outside the file's folder, should their size be needed.

    Raises:
        InputError: the file is too large or damaged, or a camera or the up vector is not possible.
    """
    document = read_json(path, MAX_BYTES)
    if not isinstance(document, dict):
        document = {"frames": document}
    given, up = document.get("frames"), document.get("up")
    if not isinstance(given, list) or not all(isinstance(frame, dict) for frame in given):
        raise InputError(f"'{path}' holds no cameras: neither a list of them nor a dict with a list of frames.")
    shared = {key: document[key] for key in _SHARED_KEYS if key in document}
    training, frames = document.get("train_filenames"), list[_Frame]()
    for number, entry in enumerate(given):
        where, settings = f"'{path}', frame {number}", {**shared, **entry}
        if "transform_matrix" in settings:
            if not {"w", "h"} <= settings.keys():  # Blender's files say no size; all their images have the first one's
                size = _size_of_image(path.parent, _name(entry.get("file_path")), where, trust_paths)
                shared |= size
                settings |= size
            train = not isinstance(training, list) or settings.get("file_path") in training
            frames.append(_transforms_frame(settings, train, where))
        elif "world_to_camera" in settings:
            frames.append(_matrix_frame(settings, where))
        elif "position" in settings and "rotation" in settings:
            frames.append(_inria_frame(settings, where))
        else:
            raise InputError(f"{where} has no pose: no transform_matrix, world_to_camera, or position and rotation.")
    up = None if up is None else unit_up(up, f"'{path}': the up vector")
    cameras, trained = tuple(camera for camera, _, _ in frames), tuple(took for _, took, _ in frames)
    return CameraSet(cameras, up, trained, any(distorted for _, _, distorted in frames))


def _transforms_frame(settings: Mapping[str, Any], train: bool, where: str) -> _Frame:
    """Return a frame of nerfstudio, Instant-NGP or Blender."""
    to_world = rigid_transform(settings["transform_matrix"], where)
    to_world[:3, :3] *= _OPENGL_TO_OPENCV
    lens, distorted = _transforms_lens(settings, where)
    return Camera(inverse(to_world), *lens, _name(settings.get("file_path"))), train, distorted


def _transforms_lens(settings: Mapping[str, Any], where: str) -> tuple[Lens, bool]:
    """Return a frame's lens, and whether it distorts; focal lengths in pixels go before fields of view in radians."""
    width, height = floats([settings["w"], settings["h"]], (2,), f"{where}: the image size").tolist()
    model = str(settings.get("camera_model", "PINHOLE")).upper()
    if model in ("EQUIRECTANGULAR", "ORTHOPHOTO"):
        raise InputError(f"{where}: cameras of model {model} are not supported; give perspective images.")
    fx = _focal_length(settings, "x", width, where)
    if fx is None:
        raise InputError(f"{where} has no focal length: neither fl_x nor camera_angle_x.")
    fy = _focal_length(settings, "y", height, where)
    pinhole = fx, fx if fy is None else fy, settings.get("cx", width / 2), settings.get("cy", height / 2)
    coefficients = floats([settings.get(key, 0.0) for key in _DISTORTION_KEYS], (8,), f"{where}: the distortion")
    fisheye = bool(settings.get("is_fisheye")) or "FISHEYE" in model
    distorted = fisheye or bool((np.abs(coefficients) > DISTORTION_TOLERANCE).any())
    return make_lens(pinhole, width, height, where), distorted


def _focal_length(settings: Mapping[str, Any], axis: str, size: float, where: str) -> float | None:
    """Return the focal length in pixels along one image axis, or None where neither fl_ nor camera_angle_ is given."""
    if settings.get(f"fl_{axis}") is not None:
        return float(floats(settings[f"fl_{axis}"], (), f"{where}: fl_{axis}"))
    if settings.get(f"camera_angle_{axis}") is None:
        return None
    angle = float(floats(settings[f"camera_angle_{axis}"], (), f"{where}: camera_angle_{axis}"))
    if not 0 < angle < math.pi:
        raise InputError(f"{where}: camera_angle_{axis} is {angle}; an angle between 0 and pi radians is needed.")
    return size / (2 * math.tan(angle / 2))


def _inria_frame(settings: Mapping[str, Any], where: str) -> _Frame:
    """Return an entry of the cameras.json that 3D Gaussian Splatting writes; the principal point is central."""
    _require(settings, ("width", "height", "fx", "fy"), where)
    width, height = floats([settings["width"], settings["height"]], (2,), f"{where}: the image size").tolist()
    lens = make_lens((settings["fx"], settings["fy"], width / 2, height / 2), width, height, where)
    rotation = floats(settings["rotation"], (3, 3), f"{where}: the rotation")
    position = floats(settings["position"], (3,), f"{where}: the position")
    to_world = rigid_transform(np.column_stack([rotation, position]), where)
    return Camera(inverse(to_world), *lens, _name(settings.get("img_name"))), True, False


def _matrix_frame(settings: Mapping[str, Any], where: str) -> _Frame:
    """Return a frame of OpenCV matrices; its split, if any, is train or another word."""
    _require(settings, ("K", "width", "height"), where)
    K = floats(settings["K"], (3, 3), f"{where}: K")
    if K[0, 1] != 0 or K[1, 0] != 0 or (K[2] != [0, 0, 1]).any():
        raise InputError(f"{where}: K is not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]].")
    lens = make_lens((K[0, 0], K[1, 1], K[0, 2], K[1, 2]), settings["width"], settings["height"], where)
    name = _name(settings.get("file", settings.get("file_path")))
    camera = Camera(rigid_transform(settings["world_to_camera"], where), *lens, name)
    return camera, settings.get("split", "train") == "train", False


def _require(settings: Mapping[str, Any], keys: tuple[str, ...], where: str) -> None:
    missing = [key for key in keys if key not in settings]
    if missing:
        raise InputError(f"{where} has no {' and no '.join(missing)}.")


def _name(given: Any) -> str:
    return "" if given is None else str(given)


def _size_of_image(folder: Path, name: str, where: str, trust_paths: bool) -> dict[str, int]:
    """Return width and height of a frame's image beside the file, as `w` and `h`; Blender's paths have no suffix."""
    relative = PurePosixPath(name.replace("\\", "/"))
    for image in (folder / relative, folder / f"{relative}.png", folder / f"{relative}.jpg"):
        if not is_file(image):
            continue
        if not (trust_paths or image.resolve().is_relative_to(folder.resolve())):
            raise InputError(
                f"{where}: its image '{clip_name(name)}' lies outside the folder of the camera file, so it is not "
                "opened to find its size; give w and h, or allow it with --trust-paths."
            )
        if size := picture_size(file_bytes(image, _MAX_PICTURE_BYTES)):
            return {"w": size[0], "h": size[1]}
    raise InputError(
        f"{where}: the image size is neither given as w and h nor found from an image '{clip_name(name)}'."
    )
