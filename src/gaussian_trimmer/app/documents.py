"""What the app works on: a scene, its cameras and its up vector."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import CameraSet, Point
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.geometry.limits import check_magnitudes
from gaussian_trimmer.output.saving import suffix_of
from gaussian_trimmer.selecting.marks import Marks
from gaussian_trimmer.selecting.select import resolve_views
from gaussian_trimmer.trimming.up_vector import UpVector, find_up

Progress = Callable[[str], None]
"""Called with the name of each stage when it begins."""

_CHECKED_GAUSSIANS = 3000
_LEAST_SHARE_IN_PICTURES = 0.25
"""Share of a scene's Gaussians that some camera has in its picture. Cameras of their own scene have 0.99."""


@dataclass(frozen=True, eq=False)
class Document:
    """A scene, and the cameras that it is used with."""

    path: Path
    """As it was given: a splat file, or the folder of a training."""
    camera_path: Path | None
    scene: Gaussians
    """N Gaussians."""
    cameras: CameraSet | None

    @classmethod
    def read(cls, path: Path, camera_path: Path | None, progress: Progress = lambda stage: None) -> Document:
        """Read a scene of any format, and its cameras if they are given.

        Raises:
            InputError: a file cannot be read, the cameras are another scene's, or the scene holds numbers with which
                nothing can be computed.
        """
        progress("reading the scene")
        scene = formats.read(identify(path).scene)
        check_magnitudes(scene)
        document = cls(path, None, scene, None)
        progress("reading the cameras")
        return document if camera_path is None else document.with_cameras(camera_path)

    def suffix(self, format: str | None = None) -> str:
        """Return the ending of splat files in a format; without one, the scene's own, or the nearest to be written.

        Raises:
            InputError: no format has that name.
        """
        return suffix_of(format) if format else formats.written_suffix(identify(self.path).scene)

    def with_cameras(self, path: Path) -> Document:
        """Return the same scene with the cameras of a file or folder.

        Raises:
            InputError: they cannot be read, or they are another scene's.
        """
        cameras = read_cameras_of(identify(self.path).scene, path)
        points = self.scene.means[:: max(1, len(self.scene) // _CHECKED_GAUSSIANS)].astype(np.float64)
        seen = np.any([camera.contains(camera.project(points)[0]) for camera in cameras.cameras], axis=0)
        if seen.mean() < _LEAST_SHARE_IN_PICTURES:
            raise InputError(
                f"The cameras of '{path}' show only {100 * seen.mean():.0f} % of this scene, so they seem to be "
                "another scene's; give those that this scene was trained with, or none."
            )
        return replace(self, camera_path=path, cameras=cameras)

    def find_up(self, given: Point | None = None) -> UpVector:
        """Return the up vector: a given one, or that of the cameras, the ground, or the format.

        Raises:
            InputError: the given one is not a direction.
        """
        return find_up(self.scene, self.cameras, given)

    def basis(self, up: UpVector) -> Marks:
        """Return what marks are understood with, given an up vector; there are no marks in it."""
        return resolve_views(self.scene, (), cameras=self.cameras, up=up.direction, camera_path=self.camera_path)
