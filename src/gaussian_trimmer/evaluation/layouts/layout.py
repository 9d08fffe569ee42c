"""What the layout of a published data set says: its tasks, which are objects with masks in some pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError, clip_name

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
"""Endings of masks and photographs, in lower case."""
_N_EXAMPLES = 3


@dataclass(frozen=True)
class Target:
    """A picture with a mask."""

    view: str
    """Name of the picture without its ending."""
    mask: Path
    """Mask of the object in it."""
    image: Path | None = None
    """The picture itself, if it is there."""
    category: str | None = None
    """Which of the objects in a file of polygons it is; None if the mask is a picture."""


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
    """The layout's second metric."""
    protocol: str | None = None
    """The protocol of the figures, as the method's own code has it; None if it is not known."""
    source: str = "GaussianTrimmer, Table I"
    """Where the figures stand."""
    trimmed_iou: float | None = None
    """IoU after GaussianTrimmer, as the paper reports it."""
    trimmed_second: float | None = None
    looks: tuple[tuple[float, float], ...] = ()
    """CLIP-IQA before and after trimming, in percent: clear boundary, smooth boundary, complete object."""


@dataclass(frozen=True)
class Layout:
    """A published data set."""

    title: str
    find_tasks: Callable[[Path], list[LayoutTask]]
    """The tasks below a folder, by name; InputError if it has another layout, or a task lacks its target."""
    expected: int | None
    """Number of tasks that the published means are of; None if that is not known."""
    mean_by_scene: bool = False
    """Whether means are taken over the means of scenes, not over tasks."""
    mean_by_view: bool = False
    """Whether every view of every object counts the same, not every object."""
    second: Literal["accuracy", "boundary_iou"] = "accuracy"
    """The metric that is published beside IoU."""
    published: tuple[Published, ...] = ()


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
        target: the picture.
        cameras: all cameras of the scene.
        where: where the cameras come from, for the message.

    Raises:
        InputError: no camera has the name, or several have it.
    """
    found = [camera for camera in cameras if target.view in (camera.name, Path(camera.name).stem)]
    if len(found) != 1:
        examples = ", ".join(clip_name(camera.name) for camera in cameras[:_N_EXAMPLES])
        raise InputError(
            f"'{target.mask}' is a mask of '{clip_name(target.view)}', and {len(found)} of the {len(cameras)} cameras "
            "of "
            f"{where} have that name; exactly one must. They are named {examples}, ..."
        )
    return found[0]
