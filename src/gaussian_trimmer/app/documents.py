"""What the app works on: a scene with its cameras, its up vector, and the settings of a trim."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.geometry.limits import check_magnitudes
from gaussian_trimmer.planning.up_vector import UpVector, find_up
from gaussian_trimmer.rendering import DEFAULT_RENDERER, Renderer, get_renderer
from gaussian_trimmer.selecting.marks import Marks, Point, point_of
from gaussian_trimmer.selecting.view_lookup import resolve_views

Progress = Callable[[str], None]

_CHECKED_GAUSSIANS = 3000
_LEAST_SHARE_IN_PICTURES = 0.25
"""Of a scene's Gaussians, those that some camera has in its picture. Cameras of their own scene have 0.99."""


@dataclass(frozen=True, eq=False)
class Document:
    """A scene, and the cameras that it is used with."""

    path: Path
    """As it was given: a splat file, or the folder of a training."""
    camera_path: Path | None
    scene: Gaussians
    """N Gaussians."""
    cameras: CameraSet | None
    renderer: Renderer

    def with_cameras(self, path: Path) -> Document:
        """The same scene with the cameras of a file or folder.

        Raises:
            InputError: they cannot be read, or they are another scene's.
        """
        cameras = read_cameras_of(formats.find_scene(self.path), path)
        check_cameras(self.scene, cameras, path)
        return replace(self, camera_path=path, cameras=cameras)


@dataclass(frozen=True)
class TrimChoices:
    """The settings of a trim that the app offers; the others have their defaults."""

    recover: bool = True
    """Take in what the views show as attached to the object."""
    clean: bool = True
    """Leave out of the background what only the object hid."""
    fill: bool = True
    """Let the surfaces that the object hid go on."""
    fit: bool = True
    """Cut and fit the Gaussians at the object's outline."""

    def config(self, up: UpVector) -> TrimConfig:
        """The settings of all stages; an up vector that was not given is found anew, as the command line does."""
        config = TrimConfig(background=self.background, refine="fit" if self.fit else "off")
        if up.source == "given":
            config = replace(config, up=point_of(up.direction))
        return replace(config, evidence=replace(config.evidence, recover=self.recover))

    @property
    def background(self) -> Literal["filled", "clean", "exact"]:
        """How the background is made."""
        if not self.clean:
            return "exact"
        return "filled" if self.fill else "clean"

    def arguments(self) -> list[str]:
        """The same on the command line."""
        return [
            *([] if self.background == "filled" else ["--background", self.background]),
            *([] if self.fit else ["--refine", "off"]),
            *([] if self.recover else ["--evidence.no-recover"]),
        ]


def open_document(path: Path, camera_path: Path | None, progress: Progress = lambda stage: None) -> Document:
    """Read a scene of any format, and its cameras if they are given.

    Args:
        progress: called with the name of each stage when it begins.

    Raises:
        InputError: a file cannot be read, the cameras are another scene's, or the scene holds numbers with which
            nothing can be computed.
    """
    progress("reading the scene")
    scene = formats.read(formats.find_scene(path))
    check_magnitudes(scene)
    document = Document(path, None, scene, None, get_renderer(DEFAULT_RENDERER))
    progress("reading the cameras")
    return document if camera_path is None else document.with_cameras(camera_path)


def check_cameras(scene: Gaussians, cameras: CameraSet, path: Path) -> None:
    """Refuse the cameras of another scene.

    Raises:
        InputError: hardly any Gaussian is in one of their pictures.
    """
    points = scene.means[:: max(1, len(scene) // _CHECKED_GAUSSIANS)].astype(np.float64)
    shown = np.zeros(len(points), np.bool_)
    for camera in cameras.cameras:
        shown |= camera.contains(camera.project(points)[0])
    if shown.mean() < _LEAST_SHARE_IN_PICTURES:
        raise InputError(
            f"The cameras of '{path}' show only {100 * shown.mean():.0f} % of this scene, so they seem to be another "
            "scene's; give those that this scene was trained with, or none."
        )


def basis_of(document: Document, up: UpVector) -> Marks:
    """What marks are understood with, with an up vector."""
    return resolve_views(
        document.scene, (), cameras=document.cameras, up=up.direction, camera_path=document.camera_path
    )


def up_of(document: Document, given: Point | None = None) -> UpVector:
    """The up vector of a scene: a given one, or else as the cameras or the ground have it.

    Raises:
        InputError: the given one is not a direction.
    """
    return find_up(document.scene, document.cameras, given)


def normal_of(points: Sequence[Point], eye: Point) -> Point:
    """The normal of the plane through three points, towards an eye.

    Raises:
        InputError: the points lie in a line.
    """
    first, second, third = np.array(points, np.float64)
    normal = np.cross(second - first, third - first)
    size = max(float(np.linalg.norm(second - first)), float(np.linalg.norm(third - first)))
    if not np.linalg.norm(normal) > 1e-3 * size**2:
        raise InputError("The three points lie in a line; click three that span the ground.")
    if normal @ (np.array(eye) - first) < 0:
        normal = -normal
    return point_of(normal / np.linalg.norm(normal))
