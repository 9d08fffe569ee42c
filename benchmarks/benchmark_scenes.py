"""Scenes with ground truth and rough selections.

A scene is a folder with these files:

    scene.ply                       the Gaussians
    cameras.json                    all cameras: "split" is train or test, "kind" may be far; "up" is a vector or null
    images/<view>.png               pictures of the test views
    masks/<object>/<view>.png       visible coverage of the object, 0..255
    alone/<object>/<view>.png       optional, test views: coverage of the object with nothing before it, 0..255
    coarse/<object>/<kind>.npy      bool (N,): the rough selections to start from
    coarse/<object>.npz             the same, packed: one array for each kind
    meta.json                       optional; "scene_folder": "../other" takes scene.ply, cameras.json and images/ from
                                    another folder (a path relative to this one)

In scene, the visible mask is the truth, and every pixel counts. Alone, the `alone` mask is, if there is one; without
it, the visible mask is, and pixels that another object's mask covers do not count: that object may hide this one.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.ground_truth import IGNORED, TestView
from gaussian_trimmer.formats import read
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians

SAME_CAPTURE = {"sparse": "scene0", "parts": "tabletop", "flat": "tabletop"}
"""Scenes that share objects or pictures with another one."""


def capture_of(scene: str) -> str:
    """Name of what is left out together with a scene when something is learned; refits are named after their source.

    >>> capture_of("tabletop_20k_hazy"), capture_of("parts"), capture_of("room_a")
    ('tabletop', 'tabletop', 'room_a')
    """
    source = re.sub(r"_\d+k.*$", "", scene)
    return SAME_CAPTURE.get(source, source)


@dataclass(frozen=True, eq=False)
class BenchmarkScene:
    """A scene folder, opened."""

    folder: Path
    """The folder that holds the objects' masks and selections."""
    scene_folder: Path
    """The folder that holds `scene.ply`, `cameras.json` and the pictures; often the same."""
    gaussians: Gaussians
    up: Float64Array | None
    training_cameras: tuple[Camera, ...]
    test_frames: tuple[tuple[Camera, bool], ...]
    """Cameras of the held-out views, and whether each is far from the training views."""

    @property
    def name(self) -> str:
        return self.folder.name

    @property
    def objects(self) -> list[str]:
        """Names of the objects with masks."""
        return sorted(path.name for path in (self.folder / "masks").iterdir())

    @property
    def cameras_file(self) -> Path:
        return self.scene_folder / "cameras.json"

    def coarse_kinds(self, object_name: str) -> list[str]:
        """Names of the object's rough selections."""
        kinds = {path.stem for path in (self.folder / "coarse" / object_name).glob("*.npy")}
        return sorted(kinds | set(self._packed(object_name)))

    def coarse(self, object_name: str, kind: str) -> BoolArray:
        """One rough selection, (N,); InputError if there is none, or it does not fit the scene."""
        path = self.folder / "coarse" / object_name / f"{kind}.npy"
        packed = self._packed(object_name)
        if not path.is_file() and kind not in packed:
            raise InputError(f"'{self.folder}' has no selection '{kind}' of '{object_name}'.")
        selection = np.asarray(np.load(path, allow_pickle=False) if path.is_file() else packed[kind])
        if selection.dtype != np.bool_ or selection.shape != (len(self.gaussians),):
            raise InputError(
                f"The selection '{kind}' of '{object_name}' in '{self.folder}' is {selection.dtype} "
                f"{selection.shape}; bool ({len(self.gaussians)},) is needed."
            )
        return selection

    def _packed(self, object_name: str) -> Any:
        path = self.folder / "coarse" / f"{object_name}.npz"
        return np.load(path, allow_pickle=False) if path.is_file() else {}

    def coverage(self, object_name: str, view: str) -> FloatArray:
        """Visible coverage of an object in a view, in [0, 1], (H, W)."""
        return _picture(self.folder / "masks" / object_name / view, cv2.IMREAD_GRAYSCALE)

    def test_views(self, object_name: str) -> Iterator[TestView]:
        """The held-out views of an object."""
        for camera, far in self.test_frames:
            image = _picture(self.scene_folder / "images" / camera.name, cv2.IMREAD_COLOR)[..., ::-1]
            visible = self.coverage(object_name, camera.name)
            yield TestView(camera, image, *self._alone(object_name, camera, visible), visible, far)

    def _alone(self, object_name: str, camera: Camera, visible: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Coverage by the object alone, and where it is known, (H, W) each."""
        path = self.folder / "alone" / object_name / camera.name
        counted = np.ones(visible.shape, np.bool_)
        if path.is_file():
            return _picture(path, cv2.IMREAD_GRAYSCALE), counted
        for other in self.objects:
            if other != object_name:
                counted &= self.coverage(other, camera.name) <= IGNORED
        return visible, counted


def open_scene(folder: Path) -> BenchmarkScene:
    """Open a benchmark scene; InputError if it, or the folder that its `meta.json` names, lacks a file."""
    scene_folder = folder / _meta(folder).get("scene_folder", ".")
    if not (scene_folder / "cameras.json").is_file():
        raise InputError(f"'{folder}' is not a benchmark scene: there is no '{scene_folder / 'cameras.json'}'.")
    listing = json.loads((scene_folder / "cameras.json").read_text())
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
    return BenchmarkScene(folder, scene_folder, read(scene_folder / "scene.ply"), up, tuple(training), tuple(test))


def find_scenes(root: Path) -> list[Path]:
    """Folders of scenes with rough selections, by name: `root` itself if it is one, and those directly in it."""
    return [folder for folder in (root, *sorted(root.glob("*"))) if _is_scene(folder)]


def find_captures(root: Path) -> list[Path]:
    """Folders of scenes with cameras of their own, by name: `root` itself if it is one, or those directly in it."""
    return [root] if (root / "cameras.json").is_file() else sorted(path.parent for path in root.glob("*/cameras.json"))


def _is_scene(folder: Path) -> bool:
    has_cameras = (folder / "cameras.json").is_file() or "scene_folder" in _meta(folder)
    return has_cameras and (folder / "coarse").is_dir()


def _meta(folder: Path) -> dict[str, Any]:
    path = folder / "meta.json"
    return dict(json.loads(path.read_text())) if path.is_file() else {}


def _picture(path: Path, mode: int) -> FloatArray:
    picture = cv2.imread(str(path), mode)
    if picture is None:
        raise InputError(f"Cannot read the picture '{path}'.")
    return np.asarray(picture.astype(np.float32) / np.float32(255))
