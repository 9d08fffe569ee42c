"""Captures without ground truth: where a folder has its cameras, its photographs, its splats and a selection.

| | cameras | photographs |
|---|---|---|
| mip-NeRF 360, plain COLMAP | `sparse/0` | `images`, `images_2` ... `images_8` |
| Instruct-NeRF2NeRF | `transforms.json` or `colmap/sparse/0` | `images`, `images_2` ... `images_8` |
| PKU-DyMVHumans | `sparse`, of one frame below `data_COLMAP` | `images` |

The splat file is `scene.ply`, `point_cloud.ply` or that of the last iteration in `point_cloud/`; the selection is
`selection` with any ending that is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.layouts.tasks import LayoutTask
from gaussian_trimmer.evaluation.predictions import PredictionPatterns, find_prediction

_CAMERAS = ("sparse/0", "sparse", "colmap/sparse/0", "transforms.json", "cameras.json")
_IMAGES = ("images_4", "images_8", "images_2", "images")
"""Small pictures come first: a sheet is small, and these are read faster."""
_FRAMES = "data_COLMAP"


@dataclass(frozen=True)
class Capture:
    """The files of a capture."""

    name: str
    scene: Path
    selection: Path
    cameras: Path
    images: Path


def find_capture(folder: Path, patterns: PredictionPatterns) -> Capture:
    """The files of a capture; of PKU-DyMVHumans the first frame is taken if the folder of a sequence is given.

    Args:
        folder: the capture.
        patterns: where its splat file, selection and cameras are, if they are elsewhere; relative to the folder.

    Raises:
        InputError: something is missing, or cannot be told from others.
    """
    if not folder.is_dir():
        raise InputError(f"There is no folder '{folder}'.")
    frames = sorted(path for path in folder.glob(f"{_FRAMES}/*") if path.is_dir())
    home = frames[0] if frames else folder
    name = folder.resolve().name
    # A capture is found like a task whose own folder it is.
    task = LayoutTask(".", ".", ())
    found = find_prediction(home, task, _with_cameras(home, patterns), home)
    return Capture(name, found.scene, found.selection, found.cameras, _images(home, found.cameras))


def _with_cameras(home: Path, patterns: PredictionPatterns) -> PredictionPatterns:
    if patterns.cameras:
        return patterns
    known = [name for name in _CAMERAS if _holds_cameras(home / name)]
    if not known:
        raise InputError(f"'{home}' has no cameras: none of {', '.join(_CAMERAS)} is there; name them with --cameras.")
    return PredictionPatterns(patterns.scenes, patterns.selections, known[0])


def _holds_cameras(path: Path) -> bool:
    return path.is_file() or any((path / f"images{ending}").is_file() for ending in (".bin", ".txt"))


def _images(home: Path, cameras: Path) -> Path:
    places = [home, cameras.parent] if cameras.is_file() else [home, *list(cameras.parents)[:3]]
    for place in places:
        for name in _IMAGES:
            if (place / name).is_dir() and any((place / name).iterdir()):
                return place / name
    raise InputError(f"'{home}' has no photographs: no folder {', '.join(_IMAGES)} is there.")
