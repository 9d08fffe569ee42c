"""What the app works on: a scene with its cameras, and the objects that are marked in it.

Nothing here changes in place, so undoing means going back to an earlier state.
"""

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
from gaussian_trimmer.result import TrimResult
from gaussian_trimmer.selecting.interpretation import MarkInterpreter, SelectionState
from gaussian_trimmer.selecting.marks import Mark, Marks, Point, point_of
from gaussian_trimmer.selecting.view_lookup import resolve_views

Colour = tuple[int, int, int]
Progress = Callable[[str], None]

PALETTE: tuple[Colour, ...] = (
    (255, 140, 30), (50, 150, 255), (110, 210, 70), (235, 80, 190), (250, 215, 50), (70, 215, 215), (160, 110, 255),
    (240, 80, 70),
)  # fmt: skip
"""Colours of objects, in the order in which they are added."""
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

    @property
    def summary(self) -> str:
        """What the trim made, in a sentence; empty if there is none."""
        result = self.result
        if result is None:
            return ""
        if result.refused:
            return f"Not trimmed: {result.refused}; the selection stays as it is."
        accepted = sum(not view.rejected for view in result.views)
        counts = f"{len(result.object):,} Gaussians; {accepted} of {len(result.views)} views accepted."
        return " ".join([counts, *result.warnings])

    def marked(self, marks: tuple[Mark, ...], selected: SelectionState) -> MarkedObject:
        """The object with other marks, not trimmed yet."""
        return replace(self, marks=marks, selected=selected, result=None)


@dataclass(frozen=True, eq=False)
class Snapshot:
    """Everything that can be undone."""

    document: Document
    up: UpVector
    basis: Marks
    """What the marks of all objects are understood with; it has no marks itself."""
    objects: tuple[MarkedObject, ...]
    active: int
    """Place of the object that is being marked."""
    last: str = ""
    """The step that led here, in a few words."""

    @property
    def object(self) -> MarkedObject:
        """The object that is being marked."""
        return self.objects[self.active]

    @property
    def has_work(self) -> bool:
        """Whether something is marked that would be lost with the scene."""
        return any(part.marks for part in self.objects)

    @property
    def sentence(self) -> str:
        """What there is, and what to do next."""
        part = self.object
        if part.result is not None:
            return part.summary
        if part.n_selected:
            return f"{part.name}: {part.n_selected:,} Gaussians selected. Press T to trim, or go on marking."
        return "Now mark the object: press C and click on it."

    def with_object(self, changed: MarkedObject, last: str) -> Snapshot:
        """The same with another state of the object that is being marked."""
        objects = (*self.objects[: self.active], changed, *self.objects[self.active + 1 :])
        return replace(self, objects=objects, last=last)

    def nothing(self) -> SelectionState:
        """An empty selection."""
        return SelectionState.nothing(len(self.document.scene))

    def applied(self, selected: SelectionState, marks: Sequence[Mark]) -> SelectionState:
        """A selection after further marks.

        Raises:
            InputError: a mark is not possible.
        """
        document = self.document
        selector = MarkInterpreter(document.scene, self.basis, cameras=document.cameras, renderer=document.renderer)
        for mark in marks:
            selected = selector.apply(selected, mark)
        return selected

    def understood_anew(self, last: str) -> Snapshot:
        """The same marks, understood with this up vector and these cameras; trims of marked objects are out of date.

        Raises:
            InputError: a mark is not possible with them.
        """
        objects = tuple(
            part.marked(part.marks, self.applied(self.nothing(), part.marks)) if part.marks else part
            for part in self.objects
        )
        return replace(self, objects=objects, last=last)

    def with_up(self, up: UpVector, last: str) -> Snapshot:
        """Another up vector. Raises as `understood_anew`."""
        basis = replace(basis_of(self.document, up), photographed_from=self.basis.photographed_from)
        return replace(self, up=up, basis=basis).understood_anew(last)

    def with_cameras(self, path: Path) -> Snapshot:
        """Cameras for the scene, and what they say of the up vector unless it was given. The marks stay.

        Raises:
            InputError: the cameras cannot be read or are another scene's, or a mark is not possible with them.
        """
        document = self.document.with_cameras(path)
        up = self.up if self.up.source == "given" else up_of(document)
        return replace(self, document=document, up=up, basis=basis_of(document, up)).understood_anew("cameras")

    def with_basis_of(self, given: Marks) -> Snapshot:
        """The state in which marks mean what they mean in a file of marks.

        Raises:
            InputError: they were made in another scene, or a mark is not possible with them.
        """
        n = len(self.document.scene)
        if given.scene_size not in (None, n):
            raise InputError(
                f"These marks belong to a scene of {given.scene_size:,} Gaussians, and this one has {n:,}; open the "
                "scene in which they were made."
            )
        places = given.photographed_from or self.basis.photographed_from
        if (given.up, places) == (self.basis.up, self.basis.photographed_from):
            return self
        up = self.up if given.up == self.basis.up else UpVector(np.array(given.up), "given", 1.0)
        basis = replace(self.basis, up=given.up, photographed_from=places)
        return replace(self, up=up, basis=basis).understood_anew(self.last)


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
        pixels, _ = camera.project(points)  # NaN behind the camera, which no comparison lets through
        shown |= ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(axis=1)
    if shown.mean() < _LEAST_SHARE_IN_PICTURES:
        raise InputError(
            f"The cameras of '{path}' show only {100 * shown.mean():.0f} % of this scene, so they seem to be another "
            "scene's; give those that this scene was trained with, or none."
        )


def first_snapshot(document: Document, up: UpVector) -> Snapshot:
    """A document in which nothing is marked."""
    empty = SelectionState.nothing(len(document.scene))
    return Snapshot(document, up, basis_of(document, up), (MarkedObject(1, "object 1", PALETTE[0], empty),), 0, "open")


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
