"""Scenes with ground truth: the layout of the trimming benchmark.

A scene is a folder with these files:

    scene.ply                       the Gaussians
    cameras.json                    all cameras: "split" is train or test, "kind" may be far; "up" is a vector or null
    images/<view>.png               pictures of the test views
    masks/<object>/<view>.png       visible coverage of the object, 0..255
    alone/<object>/<view>.png       optional, test views: coverage of the object with nothing before it, 0..255
    coarse/<object>/<kind>.npy      bool (N,): the rough selections to start from
    coarse/<object>.npz             the same, packed: one array for each kind
    meta.json                       optional; "scene_folder": "../other" takes scene.ply, cameras.json and images/ from
                                    another folder (a path relative to this one), so that several sets of objects can
                                    share one scene

Where a test view has an `alone` mask, it is the truth and every pixel counts. Where it has none, the visible mask is
the truth, and pixels that another object's mask covers are left out: that object may hide this one there.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.ground_truth import TestView
from gaussian_trimmer.formats import read
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians

__all__ = ["BenchmarkScene", "TestView", "find_scenes", "open_scene"]

_LARGEST_HEADER = 4096
"""Bytes that the header of a packed selection may take."""
_AGREEMENT = 1.5 / 255
"""Masks that differ by less, of coverage in [0, 1], show the same: one step of their 8-bit files, and rounding."""


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
    """Cameras of the held-out views that have ground truth, and whether each is far from the training views."""

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.folder.name

    @property
    def objects(self) -> list[str]:
        """Names of the objects with masks."""
        return sorted(path.name for path in (self.folder / "masks").iterdir())

    @property
    def cameras_file(self) -> Path:
        """The file that lists the cameras."""
        return self.scene_folder / "cameras.json"

    def coarse_kinds(self, object_name: str) -> list[str]:
        """Names of the object's coarse selections."""
        kinds = {path.stem for path in (self.folder / "coarse" / object_name).glob("*.npy")}
        packed = self._packed_selections(object_name)
        if packed.is_file():
            with zipfile.ZipFile(packed) as archive:
                kinds |= {name.removesuffix(".npy") for name in archive.namelist()}
        return sorted(kinds)

    def coarse(self, object_name: str, kind: str) -> BoolArray:
        """One coarse selection, (N,).

        Raises:
            InputError: there is no such selection, or it is not one boolean for each Gaussian of the scene.
        """
        path = self.folder / "coarse" / object_name / f"{kind}.npy"
        packed = self._packed_selections(object_name)
        if path.is_file():
            selection = np.load(path, allow_pickle=False)
        elif packed.is_file():
            selection = self._unpack(packed, kind)
        else:
            raise InputError(f"'{self.folder}' has no selections of '{object_name}': neither '{path}' nor '{packed}'.")
        if selection.dtype != np.bool_ or selection.shape != (len(self.gaussians),):
            raise InputError(
                f"The selection '{kind}' of '{object_name}' in '{self.folder}' is {selection.dtype} "
                f"{selection.shape}; bool ({len(self.gaussians)},) is needed."
            )
        return np.asarray(selection)

    def _packed_selections(self, object_name: str) -> Path:
        return self.folder / "coarse" / f"{object_name}.npz"

    def _unpack(self, packed: Path, kind: str) -> BoolArray:
        with zipfile.ZipFile(packed) as archive:
            try:
                unpacked_size = archive.getinfo(f"{kind}.npy").file_size
            except KeyError:
                raise InputError(f"'{packed}' holds no selection '{kind}'.") from None
        if unpacked_size > len(self.gaussians) + _LARGEST_HEADER:
            raise InputError(f"The selection '{kind}' in '{packed}' is larger than the scene of {len(self.gaussians)}.")
        with np.load(packed, allow_pickle=False) as arrays:
            return np.asarray(arrays[kind])

    def coverage(self, object_name: str, view: str) -> FloatArray:
        """Visible coverage of an object in a view, in [0, 1], (H, W)."""
        return np.asarray(_picture(self.folder / "masks" / object_name / view, cv2.IMREAD_GRAYSCALE))

    def test_views(self, object_name: str) -> Iterator[TestView]:
        """The held-out views of an object."""
        others = [name for name in self.objects if name != object_name]
        for camera, far in self.test_frames:
            image = _picture(self.scene_folder / "images" / camera.name, cv2.IMREAD_COLOR)[..., ::-1]
            visible = self.coverage(object_name, camera.name)
            alone = self.folder / "alone" / object_name / camera.name
            if alone.is_file():
                coverage = np.asarray(_picture(alone, cv2.IMREAD_GRAYSCALE))
                agree = np.abs(coverage - visible) < _AGREEMENT
                yield TestView(camera, image, coverage, np.ones_like(agree), agree, far)
                continue
            valid = np.ones((camera.height, camera.width), np.bool_)
            for other in others:
                valid &= self.coverage(other, camera.name) <= 0.5
            yield TestView(camera, image, visible, valid, valid, far)


def open_scene(folder: Path) -> BenchmarkScene:
    """Open a benchmark scene.

    Raises:
        InputError: the folder, or the one that its `meta.json` refers to, lacks `scene.ply` or `cameras.json`.
    """
    scene_folder = folder / _meta(folder).get("scene_folder", ".")
    if not (scene_folder / "cameras.json").is_file():
        raise InputError(f"'{folder}' is no benchmark scene: there is no '{scene_folder / 'cameras.json'}'.")
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
    """Folders of benchmark scenes with rough selections: `root` itself if it is one, else those directly in it.

    Sorted by name.
    """
    return [folder for folder in (root, *sorted(root.glob("*"))) if _is_scene(folder)]


def _is_scene(folder: Path) -> bool:
    """Whether the folder has selections, and cameras of its own or of the folder that its `meta.json` refers to."""
    if not (folder / "coarse").is_dir():
        return False
    return (folder / "cameras.json").is_file() or "scene_folder" in _meta(folder)


def _meta(folder: Path) -> dict[str, Any]:
    """What `meta.json` says of the folder; nothing if there is none."""
    path = folder / "meta.json"
    meta = json.loads(path.read_text()) if path.is_file() else {}
    if not isinstance(meta, dict) or not isinstance(meta.get("scene_folder", "."), str):
        raise InputError(f"'{path}' must be a JSON object, and its scene_folder a relative path.")
    return meta


def _picture(path: Path, mode: int) -> FloatArray:
    picture = cv2.imread(str(path), mode)
    if picture is None:
        raise InputError(f"Cannot read the picture '{path}'.")
    return picture.astype(np.float32) / np.float32(255)
