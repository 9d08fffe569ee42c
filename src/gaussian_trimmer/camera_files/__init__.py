"""Camera files: COLMAP models, transforms.json, Inria's cameras.json and lists of OpenCV matrices.

| what | where | pose |
|---|---|---|
| COLMAP model, binary or text | a folder, or sparse/0 or sparse below it | world to camera, OpenCV axes |
| transforms.json of nerfstudio, Instant-NGP, Blender | frames with `transform_matrix` | camera to world, OpenGL axes |
| Inria's cameras.json | a list with `position` and `rotation` | camera to world, OpenCV axes |
| OpenCV matrices | frames with `world_to_camera` and `K` | world to camera, OpenCV axes |

Poses are given in the frame that the file uses. The `applied_transform` of a transforms.json is already contained in
its matrices and is not undone. Trainers that recentre and rescale the poses once more (nerfstudio's dataparser does)
leave a splat that no longer fits them: `read_cameras_of` brings cameras to a scene in the folder of such a training.
Its `dataparser_transforms.json` says how: with its `transform` T (3, 4) and `scale` s, a point p of the COLMAP model
becomes s (T p). The matrices of a transforms.json have the file's `applied_transform` A in them already, and perhaps
an `applied_scale` a: then its points become s / a (T inverse(A) p).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer.camera_files.frames import (
    DISTORTION_TOLERANCE,
    cameras_from_arrays,
    floats,
    inverse,
    rigid_transform,
)
from gaussian_trimmer.camera_files.readers import MAX_BYTES, read_colmap, read_json_cameras
from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.io.reading import is_file, read_json, reading

__all__ = ["DISTORTION_TOLERANCE", "cameras_from_arrays", "read_camera_set", "read_cameras_of"]

_DATAPARSER, _CHECKPOINTS = "dataparser_transforms.json", "nerfstudio_models"
_MAX_DATAPARSER_BYTES = 1 << 16


def read_cameras_of(
    scene: Path, path: str | Path, *, trust_paths: bool = False, say: Callable[[str], None] = lambda note: None
) -> CameraSet:
    """Return the cameras that a scene was trained with, in its coordinates; otherwise as `read_camera_set`.

    Args:
        scene: file or folder of the scene. In the folder of a nerfstudio training, the cameras of the dataset are
            brought to the coordinates of the training.
        path: file or folder of the cameras.
        trust_paths: as for `read_camera_set`.
        say: called with what was done to the cameras, if anything.

    Raises:
        InputError: as for `read_camera_set`, or what the training says of its coordinates is damaged.
    """
    found = read_camera_set(path, trust_paths=trust_paths)
    dataparser = _dataparser_file(scene)
    if dataparser is None:
        return found
    say(f"{path}: brought to the coordinates of the training by {dataparser}")
    return _in_training_world(found, dataparser, Path(path))


def read_camera_set(path: str | Path, *, trust_paths: bool = False) -> CameraSet:
    """Return cameras, split and up vector of a COLMAP folder or of a JSON file; the kind is found by content.

    Arguments:
        trust_paths: open a picture that a transforms.json names outside its own folder, should its size be needed.

    Raises:
        InputError: nothing readable is there, two kinds are, the file is damaged or changes meanwhile, or a camera is
            not possible.
    """
    found = identify(path).cameras
    with reading(found):
        if found.suffix.lower() == ".json":
            read = read_json_cameras(found, trust_paths=trust_paths)
        else:
            with reading(found.with_stem("cameras")):
                read = read_colmap(found)
    if not read.cameras:
        raise InputError(f"'{found}' holds no posed images; give the cameras of a finished reconstruction.")
    names = _image_names([camera.name for camera in read.cameras])
    return replace(read, cameras=tuple(map(_renamed, read.cameras, names)))


def _image_names(paths: Sequence[str]) -> list[str]:
    """Return file names of images; where two would be equal, paths without steps that lead out of a folder."""
    parts = [[part for part in path.replace("\\", "/").split("/") if part not in ("", ".", "..")] for path in paths]
    last = [part[-1] if part else "" for part in parts]
    repeated = {name for name, count in Counter(last).items() if count > 1}
    return ["/".join(part) if name in repeated else name for part, name in zip(parts, last, strict=True)]


def _renamed(camera: Camera, name: str) -> Camera:
    return replace(camera, name=name)


def _dataparser_file(scene: Path) -> Path | None:
    """Return the `dataparser_transforms.json` of the training that a scene's file or folder is of, or None."""
    folder = scene if scene.is_dir() else scene.parent
    folder = folder.parent if folder.name == _CHECKPOINTS else folder
    return folder / _DATAPARSER if is_file(folder / _DATAPARSER) else None


def _in_training_world(cameras: CameraSet, dataparser: Path, source: Path) -> CameraSet:
    """Return the cameras of a dataset in the coordinates of the training that was made from it.

    Args:
        cameras: as their file has them.
        dataparser: the training's `dataparser_transforms.json`.
        source: the file or folder that the cameras are from.

    Raises:
        InputError: a file is damaged, or its transform is not rigid.
    """
    document = _document(dataparser, _MAX_DATAPARSER_BYTES)
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
