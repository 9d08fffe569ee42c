"""Scenes with ground truth: the layout of the trimming benchmark.

A scene is a folder with `scene.ply`, `cameras.json`, `masks/<object>/<view>.png` (visible coverage, 0..255),
`images/<view>.png` of the test views, and `coarse/<object>/<kind>.npy` (N,) bool: the selections to start from.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import read
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians


@dataclass(frozen=True, eq=False)
class TestView:
    """One held-out view of one object."""

    __test__ = False  # No test class, whatever its name begins with.

    camera: Camera
    image: FloatArray
    """Ground-truth picture in [0, 1], (H, W, 3)."""
    coverage: FloatArray
    """Visible coverage of the object in [0, 1], (H, W)."""
    valid: BoolArray
    """False where another object's mask covers the pixel: it may hide the object there, (H, W)."""
    far: bool
    """Whether the camera is far from all training cameras."""


@dataclass(frozen=True, eq=False)
class BenchmarkScene:
    """A scene folder, opened."""

    folder: Path
    gaussians: Gaussians
    up: Float64Array | None
    training_cameras: tuple[Camera, ...]
    test_frames: tuple[tuple[Camera, bool], ...]
    """Cameras of the held-out views that have ground truth, and whether each is far from the training views."""

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.folder.name

    @property
    def objects(self) -> list[str]:
        """Names of the objects with masks."""
        return sorted(path.name for path in (self.folder / "masks").iterdir())

    def coarse_kinds(self, object_name: str) -> list[str]:
        """Names of the object's coarse selections."""
        return sorted(path.stem for path in (self.folder / "coarse" / object_name).glob("*.npy"))

    def coarse(self, object_name: str, kind: str) -> BoolArray:
        """One coarse selection, (N,)."""
        selection: BoolArray = np.load(self.folder / "coarse" / object_name / f"{kind}.npy", allow_pickle=False)
        return selection

    def coverage(self, object_name: str, view: str) -> FloatArray:
        """Visible coverage of an object in a view, in [0, 1], (H, W)."""
        return np.asarray(_picture(self.folder / "masks" / object_name / view, cv2.IMREAD_GRAYSCALE))

    def test_views(self, object_name: str) -> Iterator[TestView]:
        """The held-out views of an object."""
        others = [name for name in self.objects if name != object_name]
        for camera, far in self.test_frames:
            image = _picture(self.folder / "images" / camera.name, cv2.IMREAD_COLOR)[..., ::-1]
            valid = np.ones((camera.height, camera.width), np.bool_)
            for other in others:
                valid &= self.coverage(other, camera.name) <= 0.5
            yield TestView(camera, image, self.coverage(object_name, camera.name), valid, far)


def open_scene(folder: Path) -> BenchmarkScene:
    """Open a benchmark scene.

    Raises:
        InputError: the folder lacks `scene.ply` or `cameras.json`.
    """
    if not (folder / "cameras.json").is_file():
        raise InputError(f"'{folder}' is no benchmark scene: it has no cameras.json.")
    listing = json.loads((folder / "cameras.json").read_text())
    training, test = [], []
    for frame in listing["frames"]:
        camera = Camera(
            np.array(frame["world_to_camera"]), np.array(frame["K"]), frame["width"], frame["height"], frame["file"]
        )
        if frame["split"] == "train":
            training.append(camera)
        else:
            test.append((camera, frame.get("kind") == "far"))
    up = None if listing.get("up") is None else np.array(listing["up"], np.float64)
    return BenchmarkScene(folder, read(folder / "scene.ply"), up, tuple(training), tuple(test))


def _picture(path: Path, mode: int) -> FloatArray:
    picture = cv2.imread(str(path), mode)
    if picture is None:
        raise InputError(f"Cannot read the picture '{path}'.")
    return picture.astype(np.float32) / np.float32(255)
