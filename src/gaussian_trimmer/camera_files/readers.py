"""The readers of camera files: COLMAP models, binary or text, and JSON, whose kinds are told apart frame by frame."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO, TextIO, cast

import numpy as np

from gaussian_trimmer.camera_files.frames import (
    DISTORTION_TOLERANCE,
    Lens,
    floats,
    inverse,
    make_lens,
    rigid_transform,
    rigid_transforms,
)
from gaussian_trimmer.cameras import Camera, CameraSet, unit_up
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.gaussians import Float64Array, FloatArray, rotation_matrices
from gaussian_trimmer.io.reading import file_bytes, is_file, picture_size, read_json

_MODELS = {
    "SIMPLE_PINHOLE": (3, 1),
    "PINHOLE": (4, 2),
    "SIMPLE_RADIAL": (4, 1),
    "RADIAL": (5, 1),
    "OPENCV": (8, 2),
    "OPENCV_FISHEYE": (8, 2),
    "FULL_OPENCV": (12, 2),
    "FOV": (5, 2),
    "SIMPLE_RADIAL_FISHEYE": (4, 1),
    "RADIAL_FISHEYE": (5, 1),
    "THIN_PRISM_FISHEYE": (12, 2),
    "RAD_TAN_THIN_PRISM_FISHEYE": (16, 2),
}
"""Camera model -> number of parameters, and of focal lengths, which come first; then the principal point, then the
distortion. The place in the table is the model's id in binary files."""

Image = tuple[int, str, Float64Array]
"""Camera, name, and quaternion (w, x, y, z) with translation (7,), of an entry of the images file."""
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


def read_colmap(path: Path) -> CameraSet:
    """Return the cameras of an images file and of the cameras file beside it; names are as the file gives them.

    Raises:
        InputError: a file is damaged, the two do not fit each other, or a camera is not possible.
    """
    binary, cameras = path.suffix == ".bin", path.with_stem("cameras")
    try:
        lenses = dict(_binary_lenses(cameras) if binary else _text_lenses(cameras))
        images = list(_binary_images(path) if binary else _text_images(path))
    except InputError:
        raise
    except (struct.error, ValueError) as error:
        raise InputError(
            f"The COLMAP model '{path.parent}' is truncated or damaged: a file ends inside an entry; export it again."
        ) from error
    for camera_id, name, _ in images:
        if camera_id not in lenses:
            raise InputError(
                f"{_place(path, name)}: its camera {camera_id} is not in '{cameras.name}'; export both files together."
            )
    numbers = np.array([pose for _, _, pose in images]).reshape(-1, 7)
    poses = np.empty((len(images), 3, 4))
    with np.errstate(all="ignore"):  # a quaternion without a direction makes a pose that is not finite
        # The rotation is computed in float64; the annotation of the scene's quaternions is float32.
        poses[:, :, :3] = rotation_matrices(cast(FloatArray, numbers[:, :4]))
    poses[:, :, 3] = numbers[:, 4:]
    transforms = rigid_transforms(list(poses), lambda i: _place(path, images[i][1]))
    taken = [lenses[camera_id] for camera_id, _, _ in images]
    return CameraSet(
        tuple(Camera(transforms[i], *lens, images[i][1]) for i, (lens, _) in enumerate(taken)),
        None,
        (True,) * len(images),
        any(distorted for _, distorted in taken),
    )


def _binary_lenses(path: Path) -> Iterator[tuple[int, tuple[Lens, bool]]]:
    with path.open("rb") as file:
        for _ in range(_values(file, "Q")[0]):
            camera_id, model_id, width, height = _values(file, "IiQQ")
            where = f"'{path}', camera {camera_id}"
            name = list(_MODELS)[model_id] if 0 <= model_id < len(_MODELS) else str(model_id)
            count, _ = _MODELS.get(name, (0, 0))
            yield camera_id, _lens(name, _values(file, f"{count}d"), width, height, where)


def _binary_images(path: Path) -> Iterator[Image]:
    with path.open("rb") as file:
        for _ in range(_values(file, "Q")[0]):
            _, *pose, camera_id = _values(file, "I7dI")
            name = bytearray()
            while (character := file.read(1)) not in (b"\0", b""):
                name += character
            file.seek(24 * _values(file, "Q")[0], 1)  # the image's 2D points
            yield _image(path, camera_id, name.decode("utf-8", "replace"), pose)


def _values(file: BinaryIO, layout: str) -> tuple[Any, ...]:
    """Return little-endian values in a layout of `struct`; struct.error where the file ends too early."""
    return struct.unpack(f"<{layout}", file.read(struct.calcsize(f"<{layout}")))


def _text_lenses(path: Path) -> Iterator[tuple[int, tuple[Lens, bool]]]:
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in _lines(file):
            where = f"'{path}', line '{clip_name(line)}'"
            words = line.split()
            if len(words) < 5:
                raise InputError(f"{where}: a camera needs more than four entries; is the file damaged?")
            camera_id, name, width, height, *parameters = words
            yield _integer(camera_id, where), _lens(name, parameters, width, height, where)


def _text_images(path: Path) -> Iterator[Image]:
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in _lines(file):
            where, words = f"'{path}', line '{clip_name(line)}'", line.split(maxsplit=9)
            if len(words) < 10:
                raise InputError(f"{where}: an image needs ten entries; is the file damaged?")
            next(file, None)  # the image's 2D points, a line of its own that may be empty
            yield _image(path, _integer(words[8], where), words[9], words[1:8])


def _lines(file: TextIO) -> Iterator[str]:
    """Return the lines that are neither empty nor comments."""
    return (line.strip() for line in file if line.strip() and not line.lstrip().startswith("#"))


def _integer(text: str, where: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise InputError(f"{where}: '{clip_name(text)}' is not a whole number; is the file damaged?") from None


def _image(path: Path, camera_id: int, name: str, pose: Sequence[Any]) -> Image:
    return camera_id, name, floats(pose, (7,), f"{_place(path, name)}: quaternion and translation")


def _place(path: Path, name: str) -> str:
    """Return what messages on an image begin with."""
    return f"'{path}', image '{clip_name(name)}'"


def _lens(name: str, parameters: Sequence[Any], width: Any, height: Any, where: str) -> tuple[Lens, bool]:
    """Return a lens, and whether it moves pixels away from where the matrix alone projects them."""
    if name not in _MODELS:
        raise InputError(f"{where}: unknown camera model '{clip_name(name)}'; undistort to PINHOLE with COLMAP first.")
    count, focals = _MODELS[name]
    p = floats(parameters, (count,), f"{where}: the parameters of {name}").tolist()
    fx, fy, (cx, cy) = p[0], p[focals - 1], p[focals : focals + 2]
    distorted = "FISHEYE" in name or any(abs(coefficient) > DISTORTION_TOLERANCE for coefficient in p[focals + 2 :])
    return make_lens((fx, fy, cx, cy), width, height, where), distorted


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
