"""Cameras in the coordinates of a nerfstudio training, which turns, centres and scales what its dataset has.

A training's folder says how in `dataparser_transforms.json`: with its `transform` T (3, 4) and `scale` s, a point p of
the COLMAP model becomes s (T p). The matrices of a transforms.json have the file's `applied_transform` A in them
already, and perhaps an `applied_scale` a: then its points become s / a (T inverse(A) p).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer.camera_files.frames import floats, inverse, rigid_transform
from gaussian_trimmer.camera_files.json_files import MAX_BYTES
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.io.reading import is_file, read_json

NAME = "dataparser_transforms.json"
_CHECKPOINTS = "nerfstudio_models"
_MAX_BYTES = 1 << 16


def dataparser_file(scene: Path) -> Path | None:
    """Return the `dataparser_transforms.json` of the training that a scene's file or folder is of, or None."""
    folder = scene if scene.is_dir() else scene.parent
    folder = folder.parent if folder.name == _CHECKPOINTS else folder
    return folder / NAME if is_file(folder / NAME) else None


def in_training_world(cameras: CameraSet, dataparser: Path, source: Path) -> CameraSet:
    """Return the cameras of a dataset in the coordinates of the training that was made from it.

    Args:
        cameras: as their file has them.
        dataparser: the training's `dataparser_transforms.json`.
        source: the file or folder that the cameras are from.

    Raises:
        InputError: a file is damaged, or its transform is not rigid.
    """
    document = _document(dataparser, _MAX_BYTES)
    turn = rigid_transform(document.get("transform"), f"'{dataparser}'")
    scale = _positive(document.get("scale"), f"'{dataparser}': the scale")
    applied, applied_scale = _applied(source)
    turn, scale = turn @ inverse(applied), scale / applied_scale
    moved = []
    for camera in cameras.cameras:
        pose = np.eye(4)
        pose[:3, :3] = camera.rotation @ turn[:3, :3].T
        pose[:3, 3] = scale * (camera.world_to_camera[:3, 3] - pose[:3, :3] @ turn[:3, 3])
        moved.append(replace(camera, world_to_camera=pose))
    up = None if cameras.up is None else turn[:3, :3] @ cameras.up
    return replace(cameras, cameras=tuple(moved), up=up)


def _applied(source: Path) -> tuple[Float64Array, float]:
    """Return what a transforms.json has applied to its matrices, (4, 4), and the scale; nothing for other files."""
    path = source / "transforms.json" if source.is_dir() else source
    if path.suffix.lower() != ".json" or not is_file(path):
        return np.eye(4), 1.0
    document = _document(path, MAX_BYTES)
    given, scale = document.get("applied_transform"), document.get("applied_scale", 1.0)
    applied = np.eye(4) if given is None else rigid_transform(given, f"'{path}': applied_transform")
    return applied, _positive(scale, f"'{path}': applied_scale")


def _positive(value: Any, what: str) -> float:
    number = float(floats(value, (), what))
    if number <= 0:
        raise InputError(f"{what} is {number:g}; a positive number is needed.")
    return number


def _document(path: Path, limit: int) -> dict[str, Any]:
    document = read_json(path, limit)
    return document if isinstance(document, dict) else {}
