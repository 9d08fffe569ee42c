"""What the app works on: a scene with its cameras, and the objects that are marked in it.

Nothing here changes in place, so that undoing is going back to what was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.geometry.limits import check_magnitudes
from gaussian_trimmer.planning.up_vector import UpVector, find_up
from gaussian_trimmer.rendering import DEFAULT_RENDERER, Renderer, get_renderer
from gaussian_trimmer.result import TrimResult
from gaussian_trimmer.selecting.interpretation import SelectionState
from gaussian_trimmer.selecting.marks import Mark, Marks
from gaussian_trimmer.selecting.view_lookup import resolve_views
from gaussian_trimmer.trimming.trim import TrimConfig

Colour = tuple[int, int, int]
Progress = Callable[[str], None]

PALETTE: tuple[Colour, ...] = (
    (255, 140, 30), (50, 150, 255), (110, 210, 70), (235, 80, 190), (250, 215, 50), (70, 215, 215), (160, 110, 255),
    (240, 80, 70),
)  # fmt: skip
"""Colours of objects, in the order in which they are added."""


@dataclass(frozen=True, eq=False)
class Document:
    """A scene that was opened."""

    path: Path
    """As it was given: a splat file, or the folder of a training."""
    camera_path: Path | None
    scene: Gaussians
    """N Gaussians."""
    cameras: CameraSet | None
    renderer: Renderer


@dataclass(frozen=True)
class TrimChoices:
    """The settings of a trim that the app offers; the others have their defaults."""

    recover: bool = True
    """Take in what the views show as attached to the object."""
    clean: bool = True
    """Leave out of the background what only the object hid."""
    fill: bool = False
    """Close the hole in a flat support."""
    fit: bool = True
    """Cut and fit the Gaussians at the object's outline."""

    def config(self, up: UpVector) -> TrimConfig:
        """The settings of all stages; an up vector that was not given is found anew, as the command line does."""
        config = TrimConfig(
            fill=self.fill, background="clean" if self.clean else "exact", refine="fit" if self.fit else "off"
        )
        if up.source == "given":
            x, y, z = up.direction.tolist()
            config = replace(config, up=(x, y, z))
        return replace(config, evidence=replace(config.evidence, recover=self.recover))

    def arguments(self) -> list[str]:
        """The same on the command line."""
        chosen = (
            (self.fill, ["--fill"]), (not self.clean, ["--background", "exact"]), (not self.fit, ["--refine", "off"]),
        )  # fmt: skip
        options = [part for given, parts in chosen if given for part in parts]
        return options if self.recover else [*options, "--evidence.no-recover"]


@dataclass(frozen=True, eq=False)
class MarkedObject:
    """An object that is being selected, and its trim if it has been trimmed since."""

    id: int
    """From 1; no other object of the scene has had it."""
    name: str
    colour: Colour
    selected: SelectionState
    """What the marks select."""
    marks: tuple[Mark, ...] = ()
    result: TrimResult | None = None
    choices: TrimChoices = TrimChoices()
    """What it was trimmed with."""

    @property
    def n_selected(self) -> int:
        """Number of selected Gaussians."""
        return int(np.count_nonzero(self.selected.mask))


@dataclass(frozen=True, eq=False)
class Snapshot:
    """All that can be undone."""

    up: UpVector
    basis: Marks
    """What the marks of all objects are understood with; it has no marks itself."""
    objects: tuple[MarkedObject, ...]
    active: int
    """Place of the object that marks go to."""
    last: str = ""
    """What was done to come here, in a few words."""

    @property
    def object(self) -> MarkedObject:
        """The object that marks go to."""
        return self.objects[self.active]

    def with_object(self, changed: MarkedObject, last: str) -> Snapshot:
        """The same with another state of the object that marks go to."""
        objects = (*self.objects[: self.active], changed, *self.objects[self.active + 1 :])
        return replace(self, objects=objects, last=last)


def open_document(path: Path, camera_path: Path | None, progress: Progress = lambda stage: None) -> Document:
    """Read a scene of any format, and its cameras if they are given.

    Args:
        progress: called with the name of each stage when it begins.

    Raises:
        InputError: a file cannot be read, or the scene holds numbers with which nothing can be computed.
    """
    progress("reading the scene")
    scene = formats.read(formats.find_scene(path))
    check_magnitudes(scene)
    progress("reading the cameras")
    cameras = read_camera_set(camera_path) if camera_path is not None else None
    return Document(path, camera_path, scene, cameras, get_renderer(DEFAULT_RENDERER))


def first_snapshot(document: Document, up: UpVector) -> Snapshot:
    """A document in which nothing is marked."""
    empty = SelectionState.nothing(len(document.scene))
    return Snapshot(up, basis_of(document, up), (MarkedObject(1, "object 1", PALETTE[0], empty),), 0, "open")


def basis_of(document: Document, up: UpVector) -> Marks:
    """What marks are understood with, with an up vector."""
    return resolve_views(
        document.scene, (), cameras=document.cameras, up=up.direction, camera_path=document.camera_path
    )  # fmt: skip


def up_of(document: Document, given: tuple[float, float, float] | None = None) -> UpVector:
    """The up vector of a scene: a given one, or else as the cameras or the ground have it.

    Raises:
        InputError: the given one is no direction.
    """
    return find_up(document.scene, document.cameras, given)
