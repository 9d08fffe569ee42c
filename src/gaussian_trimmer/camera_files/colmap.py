"""COLMAP models: the cameras and images files, binary or text."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np

from gaussian_trimmer.camera_files.frames import (
    DISTORTION_TOLERANCE,
    Frame,
    Lens,
    floats,
    make_lens,
    numbers,
    rigid_transforms,
)
from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.gaussians import Float64Array, FloatArray, rotation_matrices

_MAX_NAME_BYTES = 4096
_MAX_LINE = 1 << 14
_IMAGES_AT_ONCE = 1024
_SHORTEST, _LONGEST = 1e-6, 1e100
"""Lengths of quaternions that a rotation can be computed from."""


@dataclass(frozen=True)
class _Model:
    """A COLMAP camera model: `focals` focal lengths, the principal point, then distortion."""

    name: str
    parameters: int
    focals: int
    fisheye: bool = False


_MODELS = (  # the row number is the model's id in binary files
    _Model("SIMPLE_PINHOLE", 3, 1),
    _Model("PINHOLE", 4, 2),
    _Model("SIMPLE_RADIAL", 4, 1),
    _Model("RADIAL", 5, 1),
    _Model("OPENCV", 8, 2),
    _Model("OPENCV_FISHEYE", 8, 2, fisheye=True),
    _Model("FULL_OPENCV", 12, 2),
    _Model("FOV", 5, 2),
    _Model("SIMPLE_RADIAL_FISHEYE", 4, 1, fisheye=True),
    _Model("RADIAL_FISHEYE", 5, 1, fisheye=True),
    _Model("THIN_PRISM_FISHEYE", 12, 2, fisheye=True),
    _Model("RAD_TAN_THIN_PRISM_FISHEYE", 16, 2, fisheye=True),
)
_MODEL_NAMES = {model.name: model for model in _MODELS}


@dataclass(frozen=True)
class _Image:
    """An entry of the images file; its numbers may still be text."""

    camera_id: int
    name: str
    quaternion: Sequence[Any]
    translation: Sequence[Any]


@dataclass(frozen=True)
class _LensEntry:
    """An entry of the cameras file, unchecked; its numbers may still be text."""

    model: _Model
    parameters: Sequence[Any]
    width: Any
    height: Any
    where: str


def read_colmap_frames(images: Path) -> Iterator[Frame]:
    """The frames of an images file and of the cameras file beside it.

    Raises:
        InputError: a file is damaged, the two do not fit each other, or a camera is not possible.
    """
    cameras = images.with_stem("cameras")
    if images.suffix == ".bin":
        lens_entries, entries = dict(_binary_lenses(cameras)), _binary_images(images)
    else:
        lens_entries, entries = dict(_text_lenses(cameras)), _text_images(images)
    lenses: dict[int, Lens] = {}
    while some := list(islice(entries, _IMAGES_AT_ONCE)):
        for image in some:
            if image.camera_id not in lens_entries:
                raise InputError(
                    f"{_where(images, image)}: its camera {image.camera_id} is not in '{cameras.name}'; export both "
                    "files together."
                )
            if image.camera_id not in lenses:
                lenses[image.camera_id] = _model_lens(lens_entries[image.camera_id])
        for image, pose in zip(some, _poses(some, images), strict=True):
            yield Frame(image.name, pose, lenses[image.camera_id])


def _poses(images: Sequence[_Image], path: Path) -> Float64Array:
    """World-to-camera transforms of some images, (V, 4, 4).

    Raises:
        InputError: one has no rotation or is not finite.
    """
    try:
        quaternions = np.array([[float(value) for value in image.quaternion] for image in images])
        translations = np.array([[float(value) for value in image.translation] for image in images])
    except ValueError:  # a word is no number: the checks below find which
        quaternions = np.array([_quaternion(image, path) for image in images])
        translations = np.array(
            [floats(image.translation, (3,), f"{_where(path, image)}: the translation") for image in images]
        )
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.linalg.norm(quaternions, axis=1)
    for image, length in zip(images, lengths, strict=True):
        if not _SHORTEST <= length <= _LONGEST:
            _quaternion(image, path)
    # The rotation is computed in float64; the annotation of the scene's quaternions is float32.
    rotations = rotation_matrices(cast(FloatArray, quaternions))
    last = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (len(images), 1, 4))
    poses = np.concatenate([np.concatenate([rotations, translations[:, :, None]], axis=2), last], axis=1)
    return rigid_transforms(list(poses), lambda i: _where(path, images[i]))


def _quaternion(image: _Image, path: Path) -> Float64Array:
    """The quaternion of an image.

    Raises:
        InputError: it is none, or of a length with which no rotation can be computed.
    """
    where = f"{_where(path, image)}: the quaternion"
    quaternion = floats(image.quaternion, (4,), where)
    largest = np.abs(quaternion).max()
    if not _SHORTEST <= largest <= _LONGEST / 2:
        raise InputError(f"{where} has length {'zero' if largest < _SHORTEST else f'{largest:.3g}'}.")
    return quaternion


def _where(path: Path, image: _Image) -> str:
    return f"'{path}', image '{shown(image.name)}'"


def _binary_lenses(path: Path) -> Iterator[tuple[int, _LensEntry]]:
    with path.open("rb") as file:
        data = _BinaryFile(file, path)
        (count,) = data.values("Q")
        for _ in range(count):
            camera_id, model_id, width, height = data.values("IiQQ")
            where = f"'{path}', camera {camera_id}"
            if not 0 <= model_id < len(_MODELS):
                raise InputError(f"{where}: unknown camera model {model_id}; undistort to PINHOLE with COLMAP first.")
            model = _MODELS[model_id]
            yield camera_id, _LensEntry(model, data.values(f"{model.parameters}d"), width, height, where)


def _binary_images(path: Path) -> Iterator[_Image]:
    with path.open("rb") as file:
        data = _BinaryFile(file, path)
        (count,) = data.values("Q")
        for _ in range(count):
            _, *pose, camera_id = data.values("I7dI")
            name = data.text()
            (n_points,) = data.values("Q")
            data.skip(24 * n_points)
            yield _Image(camera_id, name, pose[:4], pose[4:])


def _text_lenses(path: Path) -> Iterator[tuple[int, _LensEntry]]:
    with path.open("rb") as file:
        for line in _lines(file, path):
            words = line.split()
            where = f"'{path}', line '{shown(line.strip())}'"
            if len(words) < 5 or words[1] not in _MODEL_NAMES:
                raise InputError(f"{where}: no known camera model; undistort to PINHOLE with COLMAP first.")
            model, (width, height, *parameters) = _MODEL_NAMES[words[1]], words[2:]
            yield _integer(words[0], where), _LensEntry(model, parameters, width, height, where)


def _text_images(path: Path) -> Iterator[_Image]:
    with path.open("rb") as file:
        for line in _lines(file, path):
            words = line.split(maxsplit=9)
            if len(words) < 10:
                raise InputError(f"'{path}', line '{shown(line.strip())}': an image needs ten entries; is it damaged?")
            name = words[9].strip()
            yield _Image(_integer(words[8], f"'{path}', image '{shown(name)}'"), name, words[1:5], words[5:8])
            while (rest := file.readline(_MAX_LINE)) and not rest.endswith(b"\n"):
                pass  # the image's 2D points, a line of its own that may be empty, and of any length


def _lines(file: BinaryIO, path: Path) -> Iterator[str]:
    """The lines that are neither empty nor comments.

    Raises:
        InputError: one is longer than a line of this kind can be.
    """
    while line := file.readline(_MAX_LINE):
        if len(line) == _MAX_LINE and not line.endswith(b"\n"):
            raise InputError(f"'{path}' has a line of more than {_MAX_LINE} characters; is it damaged?")
        if line.strip() and not line.lstrip().startswith(b"#"):
            yield line.decode("utf-8", "replace")


def _model_lens(entry: _LensEntry) -> Lens:
    model = entry.model
    p = numbers(entry.parameters, model.parameters, f"{entry.where}: the parameters of {model.name}")
    fx, fy, (cx, cy) = p[0], p[model.focals - 1], p[model.focals : model.focals + 2]
    distorted = model.fisheye or any(abs(coefficient) > DISTORTION_TOLERANCE for coefficient in p[model.focals + 2 :])
    return make_lens((fx, fy, cx, cy), entry.width, entry.height, distorted, entry.where)


def _integer(text: str, where: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise InputError(f"{where}: '{shown(text)}' is no whole number; is the file damaged?") from None


class _BinaryFile:
    """Little-endian values of a file that may end too early."""

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self.file = file
        self.path = path
        self.size = path.stat().st_size

    def values(self, layout: str) -> tuple[Any, ...]:
        """Values in a layout of `struct`, given without its byte order."""
        layout = f"<{layout}"
        data = self.file.read(struct.calcsize(layout))
        if len(data) < struct.calcsize(layout):
            raise self._truncated()
        return struct.unpack(layout, data)

    def text(self) -> str:
        """Characters up to a NUL."""
        start = self.file.tell()
        head, nul, _ = self.file.read(_MAX_NAME_BYTES).partition(b"\0")
        if not nul:
            raise self._truncated()
        self.file.seek(start + len(head) + 1)
        return head.decode("utf-8", "replace")

    def skip(self, n_bytes: int) -> None:
        """Leaves out bytes that must be there."""
        if n_bytes > self.size - self.file.tell():
            raise self._truncated()
        self.file.seek(n_bytes, 1)

    def _truncated(self) -> InputError:
        return InputError(f"'{self.path}' is truncated or damaged: it ends inside an entry; export the model again.")
