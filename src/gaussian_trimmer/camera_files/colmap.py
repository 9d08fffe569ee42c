"""COLMAP models: the cameras and images files, binary or text."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np

from gaussian_trimmer.camera_files.frames import (
    DISTORTION_TOLERANCE,
    Frame,
    Lens,
    floats,
    make_lens,
    rigid_transform,
)
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import FloatArray, rotation_matrices

_MAX_NAME_BYTES = 4096


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


def read_colmap_frames(images: Path) -> Iterator[Frame]:
    """The frames of an images file and of the cameras file beside it.

    Raises:
        InputError: a file is damaged, the two do not fit each other, or a camera is not possible.
    """
    cameras = images.with_stem("cameras")
    if images.suffix == ".bin":
        lenses, entries = dict(_binary_lenses(cameras)), _binary_images(images)
    else:
        lenses, entries = dict(_text_lenses(cameras)), _text_images(images)
    for image in entries:
        where = f"'{images}', image '{image.name}'"
        if image.camera_id not in lenses:
            raise InputError(
                f"{where}: its camera {image.camera_id} is not in '{cameras.name}'; export both files together."
            )
        q = floats(image.quaternion, (4,), f"{where}: the quaternion")
        if np.linalg.norm(q) < 1e-6:
            raise InputError(f"{where}: the quaternion has length zero.")
        # The rotation is computed in float64; the annotation of the scene's quaternions is float32.
        rotation = rotation_matrices(cast(FloatArray, q[None]))[0]
        pose = np.column_stack([rotation, floats(image.translation, (3,), f"{where}: the translation")])
        yield Frame(image.name, rigid_transform(pose, where), lenses[image.camera_id])


def _binary_lenses(path: Path) -> Iterator[tuple[int, Lens]]:
    with path.open("rb") as file:
        data = _BinaryFile(file, path)
        (count,) = data.values("Q")
        for _ in range(count):
            camera_id, model_id, width, height = data.values("IiQQ")
            where = f"'{path}', camera {camera_id}"
            if not 0 <= model_id < len(_MODELS):
                raise InputError(f"{where}: unknown camera model {model_id}; undistort to PINHOLE with COLMAP first.")
            model = _MODELS[model_id]
            yield camera_id, _model_lens(model, data.values(f"{model.parameters}d"), width, height, where)


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


def _text_lenses(path: Path) -> Iterator[tuple[int, Lens]]:
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in file:
            words = line.split()
            if not words or words[0].startswith("#"):
                continue
            where = f"'{path}', line '{line.strip()[:60]}'"
            if len(words) < 5 or words[1] not in _MODEL_NAMES:
                raise InputError(f"{where}: no known camera model; undistort to PINHOLE with COLMAP first.")
            model, (width, height, *parameters) = _MODEL_NAMES[words[1]], words[2:]
            yield _integer(words[0], where), _model_lens(model, parameters, width, height, where)


def _text_images(path: Path) -> Iterator[_Image]:
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in file:
            words = line.split(maxsplit=9)
            if not words or words[0].startswith("#"):
                continue
            if len(words) < 10:
                raise InputError(f"'{path}', line '{line.strip()[:60]}': an image needs ten entries; is it damaged?")
            name = words[9].strip()
            yield _Image(_integer(words[8], f"'{path}', image '{name}'"), name, words[1:5], words[5:8])
            next(file, "")  # the image's 2D points, a line of its own that may be empty


def _model_lens(model: _Model, parameters: Sequence[Any], width: Any, height: Any, where: str) -> Lens:
    p = floats(parameters, (model.parameters,), f"{where}: the parameters of {model.name}")
    fx, fy, (cx, cy) = p[0], p[model.focals - 1], p[model.focals : model.focals + 2]
    distorted = model.fisheye or bool((abs(p[model.focals + 2 :]) > DISTORTION_TOLERANCE).any())
    return make_lens((fx, fy, cx, cy), width, height, distorted, where)


def _integer(text: str, where: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise InputError(f"{where}: '{text[:20]}' is no whole number; is the file damaged?") from None


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
