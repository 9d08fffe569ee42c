"""Cameras in JSON: transforms.json, Inria's cameras.json and OpenCV matrices, told apart frame by frame."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from gaussian_trimmer.camera_files.frames import (
    DISTORTION_TOLERANCE,
    Frame,
    Lens,
    floats,
    image_name,
    image_size,
    inverses,
    make_lens,
    numbers,
    rigid_transforms,
)
from gaussian_trimmer.cameras import unit_up
from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.io.images import picture_header
from gaussian_trimmer.io.reading import file_bytes, is_file

_MAX_JSON_BYTES = 1 << 26
_MAX_JSON_VALUES = 1 << 22
"""Numbers, texts, lists and dicts; a frame has about forty. Each takes up to a hundred bytes."""
_MAX_PICTURE_BYTES = 1 << 28
_MAX_WORD = 100
_OPENGL_TO_OPENCV = np.array([1.0, -1.0, -1.0])
_DISTORTION_KEYS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
_LENS_KEYS = (
    "w", "h", "fl_x", "fl_y", "camera_angle_x", "camera_angle_y", "cx", "cy", "camera_model", "is_fisheye",
    "width", "height", "fx", "fy", *_DISTORTION_KEYS,
)  # fmt: skip
_SHARED_KEYS = (*_LENS_KEYS, "K", "split")
"""What may be given once for all frames."""


@dataclass(frozen=True, eq=False)
class _Entry:
    """A frame as it stands in the file; its pose is not yet checked."""

    name: str
    pose: Any
    """Three or four rows of four numbers, if the file is right."""
    lens: Lens
    to_world: bool
    """Whether the pose is camera to world."""
    opengl: bool = False
    """Whether its axes are OpenGL's."""
    train: bool = True


def read_json_frames(path: Path, *, trust_paths: bool = False) -> tuple[list[Frame], Float64Array | None]:
    """The frames of a file, and the unit up vector (3,) that it states, or None.

    Arguments:
        trust_paths: open pictures outside the file's folder, should their size be needed.

    Raises:
        InputError: the file is too large or damaged, or a camera or the up vector is not possible.
    """
    document = _load_json(path)
    if not isinstance(document, dict):
        document = {"frames": document}
    entries, up = _Reader(document, path, trust_paths).entries(), document.get("up")
    return _frames(entries, path), None if up is None else unit_up(up, f"'{path}': the up vector")


def _load_json(path: Path) -> Any:
    data = file_bytes(path, _MAX_JSON_BYTES)
    if sum(map(data.count, (b",", b"[", b"{"))) > _MAX_JSON_VALUES:
        raise InputError(f"'{path}' has more than {_MAX_JSON_VALUES} values, too many for a camera file.")
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise InputError(f"'{path}' is not valid JSON; export the cameras again.") from error


def _frames(entries: list[_Entry], path: Path) -> list[Frame]:
    """The frames of entries whose poses are rigid.

    Raises:
        InputError: one is not.
    """
    transforms = rigid_transforms([entry.pose for entry in entries], lambda i: _where(path, i))
    opengl = [entry.opengl for entry in entries]
    transforms[opengl, :3, :3] *= _OPENGL_TO_OPENCV
    to_world = [entry.to_world for entry in entries]
    transforms[to_world] = inverses(transforms[to_world])
    return [
        Frame(entry.name, transform, entry.lens, entry.train)
        for entry, transform in zip(entries, transforms, strict=True)
    ]


def _where(path: Path, number: int) -> str:
    return f"'{path}', frame {number}"


class _Reader:
    """Reads the entries of a document; what they have in common is looked at once."""

    def __init__(self, document: Mapping[str, Any], path: Path, trust_paths: bool) -> None:
        frames = document.get("frames")
        if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
            raise InputError(f"'{path}' holds no cameras: neither a list of them nor a dict with a list of frames.")
        self._given: list[dict[str, Any]] = frames
        self._path = path
        self._trust_paths = trust_paths
        self._shared = {key: document[key] for key in _SHARED_KEYS if key in document}
        names = document.get("train_filenames")
        self._training = frozenset(name for name in names if isinstance(name, str)) if isinstance(names, list) else None
        self._lenses: dict[tuple[Any, ...], Lens] = {}

    def entries(self) -> list[_Entry]:
        """All entries, their poses unchecked.

        Raises:
            InputError: one has no pose, or no possible lens.
        """
        return [self._entry(frame, _where(self._path, i)) for i, frame in enumerate(self._given)]

    def _entry(self, frame: Mapping[str, Any], where: str) -> _Entry:
        settings = {**self._shared, **frame}
        if "transform_matrix" in frame:
            if not {"w", "h"} <= settings.keys():  # Blender's files say no size; all their images have the first one's
                size = dict(zip("wh", self._size_of_image(frame, where), strict=True))
                self._shared |= size
                settings |= size
            return self._transforms_entry(settings, where)
        if "world_to_camera" in frame:
            return _matrix_entry(settings, where)
        if "position" in frame and "rotation" in frame:
            return self._inria_entry(settings, where)
        raise InputError(f"{where} has no pose: no transform_matrix, world_to_camera, or position and rotation.")

    def _transforms_entry(self, settings: Mapping[str, Any], where: str) -> _Entry:
        """A frame of nerfstudio, Instant-NGP or Blender."""
        name = image_name(settings.get("file_path", ""), where)
        train = name in self._training if self._training is not None else True
        pose = settings["transform_matrix"]
        return _Entry(
            name,
            _four_rows(pose),
            self._lens(settings, where, _transforms_lens),
            to_world=True,
            opengl=True,
            train=train,
        )

    def _lens(self, settings: Mapping[str, Any], where: str, make: Callable[[Mapping[str, Any], str], Lens]) -> Lens:
        """The lens of a frame; frames with equal settings have one in common."""
        key = tuple(settings.get(name) for name in _LENS_KEYS)
        try:
            known = self._lenses.get(key)
        except TypeError:  # a list among them cannot be looked up, and is no number: the message comes from below
            return make(settings, where)
        if known is None:
            known = self._lenses[key] = make(settings, where)
        return known

    def _inria_entry(self, settings: Mapping[str, Any], where: str) -> _Entry:
        """An entry of the cameras.json that 3D Gaussian Splatting writes beside its model."""
        _require(settings, ("width", "height", "fx", "fy"), where)
        rotation = floats(settings["rotation"], (3, 3), f"{where}: the rotation").tolist()
        position = floats(settings["position"], (3,), f"{where}: the position").tolist()
        pose = [[*row, entry] for row, entry in zip(rotation, position, strict=True)]
        name = image_name(settings.get("img_name", ""), where)
        return _Entry(name, _four_rows(pose), self._lens(settings, where, _inria_lens), to_world=True)

    def _size_of_image(self, frame: Mapping[str, Any], where: str) -> tuple[int, int]:
        """Width and height of a frame's image beside the file; Blender's paths have no suffix.

        Raises:
            InputError: there is no such image, or it lies elsewhere and paths are not trusted.
        """
        relative = PurePosixPath(image_name(frame.get("file_path", ""), where).replace("\\", "/"))
        folder = self._path.parent
        for image in (folder / relative, folder / f"{relative}.png", folder / f"{relative}.jpg"):
            if not (self._trust_paths or _is_inside(image, folder)):
                raise InputError(
                    f"{where}: its image '{shown(str(relative))}' lies outside the folder of '{self._path.name}', so "
                    "it is not opened to find its size; give w and h, or allow it with --trust-paths."
                )
            if not is_file(image):
                continue
            if header := picture_header(file_bytes(image, _MAX_PICTURE_BYTES)):
                return header.width, header.height
        raise InputError(
            f"{where}: the image size is neither given as w and h nor found from an image '{shown(str(relative))}'."
        )


def _is_inside(path: Path, folder: Path) -> bool:
    """Whether a path leads to a place below a folder, by its steps and by the links among them.

    By the steps first: the name of another machine's folder must not be looked up at all.
    """
    steps, home = os.path.abspath(path), os.path.abspath(folder)  # noqa: PTH100 (resolve would look the path up)
    if not Path(steps).is_relative_to(home):
        return False
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):  # no such path can be, or its links go round in circles
        return True


def _transforms_lens(settings: Mapping[str, Any], where: str) -> Lens:
    """The lens of a frame; focal lengths in pixels go before fields of view in radians."""
    width, height = image_size(settings["w"], settings["h"], where)
    model = settings.get("camera_model", "PINHOLE")
    if not isinstance(model, str) or len(model) > _MAX_WORD:
        raise InputError(f"{where}: the camera_model is no name.")
    if model.upper() in ("EQUIRECTANGULAR", "ORTHOPHOTO"):
        raise InputError(f"{where}: cameras of model {model} are not supported; give perspective images.")
    fx = _focal_length(settings, "x", width, where)
    if fx is None:
        raise InputError(f"{where} has no focal length: neither fl_x nor camera_angle_x.")
    fy = _focal_length(settings, "y", height, where)
    pinhole = fx, fx if fy is None else fy, settings.get("cx", width / 2), settings.get("cy", height / 2)
    coefficients = numbers([settings.get(key, 0.0) for key in _DISTORTION_KEYS], 8, f"{where}: the distortion")
    fisheye = bool(settings.get("is_fisheye")) or "FISHEYE" in model.upper()
    distorted = fisheye or any(abs(coefficient) > DISTORTION_TOLERANCE for coefficient in coefficients)
    return make_lens(pinhole, width, height, distorted, where)


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


def _inria_lens(settings: Mapping[str, Any], where: str) -> Lens:
    """The lens of an entry of Inria's cameras.json; its principal point is central."""
    width, height = image_size(settings["width"], settings["height"], where)
    return make_lens((settings["fx"], settings["fy"], width / 2, height / 2), width, height, False, where)


def _matrix_entry(settings: Mapping[str, Any], where: str) -> _Entry:
    """A frame of OpenCV matrices; its split, if any, is train or another word."""
    _require(settings, ("K", "width", "height"), where)
    K = floats(settings["K"], (3, 3), f"{where}: K")
    if K[0, 1] != 0 or K[1, 0] != 0 or (K[2] != [0, 0, 1]).any():
        raise InputError(f"{where}: K is not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]].")
    lens = make_lens((K[0, 0], K[1, 1], K[0, 2], K[1, 2]), settings["width"], settings["height"], False, where)
    name, train = settings.get("file", settings.get("file_path", "")), settings.get("split", "train") == "train"
    return _Entry(image_name(name, where), _four_rows(settings["world_to_camera"]), lens, to_world=False, train=train)


def _four_rows(pose: Any) -> Any:
    """A pose of three rows with the fourth."""
    return [*pose, [0, 0, 0, 1]] if isinstance(pose, list) and len(pose) == 3 else pose


def _require(settings: Mapping[str, Any], keys: tuple[str, ...], where: str) -> None:
    missing = [key for key in keys if key not in settings]
    if missing:
        raise InputError(f"{where} has no {' and no '.join(missing)}.")
