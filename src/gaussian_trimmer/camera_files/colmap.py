"""COLMAP models: the cameras and images files, binary or text."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO, TextIO, cast

import numpy as np

from gaussian_trimmer.camera_files.frames import DISTORTION_TOLERANCE, Lens, floats, make_lens, rigid_transforms
from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.gaussians import Float64Array, FloatArray, rotation_matrices

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
