"""A task of a published data set: an object of a scene, and the pictures in which its mask is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError, shown

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
"""Endings of masks and photographs, in small letters."""
_LISTED = 3


@dataclass(frozen=True)
class Target:
    """A picture with a mask."""

    view: str
    """Name of the picture without its ending."""
    mask: Path
    """Mask of the object in it."""
    image: Path | None = None
    """The picture itself, if it is there."""


@dataclass(frozen=True)
class LayoutTask:
    """An object whose masks are known."""

    scene: str
    """Name of the scene; several tasks may share one."""
    object: str
    """Name of the object within the scene, or the scene's if it has one object."""
    targets: tuple[Target, ...]

    @property
    def name(self) -> str:
        """A name that no other task has."""
        return self.object if self.object.startswith(self.scene) else f"{self.scene}/{self.object}"


@dataclass(frozen=True)
class Published:
    """A row of a published table; figures in percent, None where the paper has none."""

    method: str
    iou: float
    second: float | None
    """Accuracy, or boundary IoU for LERF-Mask."""
    trimmed_iou: float | None = None
    """IoU after GaussianTrimmer, as the paper reports it."""
    trimmed_second: float | None = None
    looks: tuple[tuple[float, float], ...] = ()
    """CLIP-IQA before and after trimming, in percent: clear boundary, smooth boundary, complete object."""


def pictures_in(folder: Path) -> list[Path]:
    """Pictures directly in a folder, by name; none if there is no such folder."""
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in PICTURES and path.is_file())


def folders_in(folder: Path) -> list[Path]:
    """Folders directly in a folder, by name; none if there is no such folder."""
    return sorted(path for path in folder.iterdir() if path.is_dir()) if folder.is_dir() else []


def camera_of(target: Target, cameras: Sequence[Camera], where: str) -> Camera:
    """The camera of a target's picture, by name; never by its number.

    Args:
        where: what the cameras are of, for the message.

    Raises:
        InputError: no camera has the name, or several have it.
    """
    found = [camera for camera in cameras if target.view in (camera.name, Path(camera.name).stem)]
    if len(found) != 1:
        examples = ", ".join(shown(camera.name) for camera in cameras[:_LISTED])
        raise InputError(
            f"{len(found)} of the {len(cameras)} cameras of {where} are named '{shown(target.view)}', the picture that "
            f"'{target.mask}' is of; the cameras are {examples} and so on, and one must have the target's name."
        )
    return found[0]
