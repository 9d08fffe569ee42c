"""Cameras in JSON: transforms.json, Inria's cameras.json and OpenCV matrices, told apart frame by frame."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any

import cv2
import numpy as np

from gaussian_trimmer.camera_files.frames import (
    DISTORTION_TOLERANCE,
    Frame,
    floats,
    image_size,
    make_lens,
    rigid_transform,
)
from gaussian_trimmer.cameras import unit_up
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array

_MAX_JSON_BYTES = 1 << 28
_OPENGL_TO_OPENCV = np.array([1.0, -1.0, -1.0])
_DISTORTION_KEYS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")


def read_json_frames(path: Path) -> tuple[list[Frame], Float64Array | None]:
    """The frames of a file, and the unit up vector (3,) that it states, or None.

    Raises:
        InputError: the file is too large or damaged, or a camera or the up vector is not possible.
    """
    document = _load_json(path)
    if not isinstance(document, dict):
        document = {"frames": document}
    frames, up = list(_frames(document, path)), document.get("up")
    return frames, None if up is None else unit_up(up, f"'{path}': the up vector")


def _load_json(path: Path) -> Any:
    if path.stat().st_size > _MAX_JSON_BYTES:
        raise InputError(f"'{path}' has more than {_MAX_JSON_BYTES >> 20} MB, too much for a camera file.")
    try:
        return json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise InputError(f"'{path}' is not valid JSON; export the cameras again.") from error


def _frames(document: Mapping[str, Any], path: Path) -> Iterator[Frame]:
    entries = document.get("frames")
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(f"'{path}' holds no cameras: neither a list of them nor a dict with a list of frames.")
    shared = {key: value for key, value in document.items() if key != "frames"}
    for i, entry in enumerate(entries):
        settings, where = shared | entry, f"'{path}', frame {i}"
        if "transform_matrix" in entry:
            if not {"w", "h"} <= settings.keys():  # Blender's files say no size; all their images have the first one's
                size = dict(zip("wh", _size_of_image(path, settings, where), strict=True))
                shared, settings = shared | size, settings | size
            yield _transforms_frame(settings, where)
        elif "world_to_camera" in entry:
            yield _matrix_frame(settings, where)
        elif "position" in entry and "rotation" in entry:
            yield _inria_frame(settings, where)
        else:
            raise InputError(f"{where} has no pose: no transform_matrix, world_to_camera, or position and rotation.")


def _size_of_image(path: Path, settings: Mapping[str, Any], where: str) -> tuple[int, int]:
    """Width and height of a frame's image beside the file; Blender's paths have no suffix."""
    relative = PurePosixPath(str(settings.get("file_path", "")).replace("\\", "/"))
    for image in (path.parent / relative, path.parent / f"{relative}.png", path.parent / f"{relative}.jpg"):
        with suppress(OSError):  # of a path that the file system refuses
            if image.is_file() and (pixels := cv2.imread(str(image), cv2.IMREAD_UNCHANGED)) is not None:
                return pixels.shape[1], pixels.shape[0]
    raise InputError(f"{where}: the image size is neither given as w and h nor found from an image '{relative}'.")


def _transforms_frame(settings: Mapping[str, Any], where: str) -> Frame:
    """A frame of nerfstudio, Instant-NGP or Blender; focal lengths in pixels go before fields of view in radians."""
    width, height = image_size(settings["w"], settings["h"], where)
    model = str(settings.get("camera_model", "PINHOLE"))
    if model.upper() in ("EQUIRECTANGULAR", "ORTHOPHOTO"):
        raise InputError(f"{where}: cameras of model {model} are not supported; give perspective images.")
    fx = _focal_length(settings, "x", width, where)
    if fx is None:
        raise InputError(f"{where} has no focal length: neither fl_x nor camera_angle_x.")
    fy = _focal_length(settings, "y", height, where)
    pinhole = fx, fx if fy is None else fy, settings.get("cx", width / 2), settings.get("cy", height / 2)
    coefficients = floats([settings.get(key, 0.0) for key in _DISTORTION_KEYS], (8,), f"{where}: the distortion")
    fisheye = bool(settings.get("is_fisheye")) or "FISHEYE" in model.upper()
    distorted = fisheye or bool((abs(coefficients) > DISTORTION_TOLERANCE).any())

    camera_to_world = rigid_transform(settings["transform_matrix"], where)
    camera_to_world[:3, :3] *= _OPENGL_TO_OPENCV
    lens = make_lens(pinhole, width, height, distorted, where)
    name, training = settings.get("file_path", ""), settings.get("train_filenames")
    train = name in training if isinstance(training, list) else True
    return Frame(str(name), _inverse(camera_to_world), lens, train)


def _focal_length(settings: Mapping[str, Any], axis: str, size: int, where: str) -> float | None:
    """Focal length in pixels along one image axis, or None where neither fl_ nor camera_angle_ is given."""
    if settings.get(f"fl_{axis}") is not None:
        return float(floats(settings[f"fl_{axis}"], (), f"{where}: fl_{axis}"))
    if settings.get(f"camera_angle_{axis}") is None:
        return None
    angle = float(floats(settings[f"camera_angle_{axis}"], (), f"{where}: camera_angle_{axis}"))
    if not 0 < angle < math.pi:
        raise InputError(f"{where}: camera_angle_{axis} is {angle}; an angle between 0 and pi radians is needed.")
    return size / (2 * math.tan(angle / 2))


def _inria_frame(settings: Mapping[str, Any], where: str) -> Frame:
    """An entry of the cameras.json that 3D Gaussian Splatting writes beside its model; principal point central."""
    _require(settings, ("width", "height", "fx", "fy"), where)
    rotation = floats(settings["rotation"], (3, 3), f"{where}: the rotation")
    position = floats(settings["position"], (3,), f"{where}: the position")
    width, height = image_size(settings["width"], settings["height"], where)
    lens = make_lens((settings["fx"], settings["fy"], width / 2, height / 2), width, height, False, where)
    camera_to_world = rigid_transform(np.column_stack([rotation, position]), where)
    return Frame(str(settings.get("img_name", "")), _inverse(camera_to_world), lens)


def _matrix_frame(settings: Mapping[str, Any], where: str) -> Frame:
    """A frame of OpenCV matrices; its split, if any, is train or another word."""
    _require(settings, ("K", "width", "height"), where)
    K = floats(settings["K"], (3, 3), f"{where}: K")
    if K[0, 1] != 0 or K[1, 0] != 0 or (K[2] != [0, 0, 1]).any():
        raise InputError(f"{where}: K is not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]].")
    lens = make_lens((K[0, 0], K[1, 1], K[0, 2], K[1, 2]), settings["width"], settings["height"], False, where)
    name, train = settings.get("file", settings.get("file_path", "")), settings.get("split", "train") == "train"
    return Frame(str(name), rigid_transform(settings["world_to_camera"], where), lens, train)


def _require(settings: Mapping[str, Any], keys: tuple[str, ...], where: str) -> None:
    missing = [key for key in keys if key not in settings]
    if missing:
        raise InputError(f"{where} has no {' and no '.join(missing)}.")


def _inverse(transform: Float64Array) -> Float64Array:
    """Inverse of a rigid transform (4, 4)."""
    inverse = np.eye(4)
    inverse[:3, :3] = transform[:3, :3].T
    inverse[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return inverse
