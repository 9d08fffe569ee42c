"""The state of the app: a scene, and what is marked and cut out in it. N Gaussians of the scene.

Nothing here changes in place, so undoing means going back to an earlier snapshot.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import CameraSet, Point, point_of
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import SH_C0, BoolArray, Float64Array, Gaussians, rotation_matrices
from gaussian_trimmer.geometry.limits import check_magnitudes
from gaussian_trimmer.output.engines import Placement
from gaussian_trimmer.output.report import describe, sentences
from gaussian_trimmer.output.saving import suffix_of
from gaussian_trimmer.selecting.interpretation import MarkInterpreter
from gaussian_trimmer.selecting.marks import Mark, Marks
from gaussian_trimmer.selecting.select import resolve_views
from gaussian_trimmer.selecting.selection import Selection
from gaussian_trimmer.settings import Range
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.evidence import EvidenceConfig
from gaussian_trimmer.trimming.result import TrimResult
from gaussian_trimmer.trimming.up_vector import FROM_FORMAT, UpVector, find_up

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


Colour = tuple[int, int, int]

PALETTE: tuple[Colour, ...] = (
    (255, 140, 30), (50, 150, 255), (110, 210, 70), (235, 80, 190), (250, 215, 50), (70, 215, 215), (160, 110, 255),
    (240, 80, 70),
)  # fmt: skip
"""Colours of objects, in the order in which they are added."""


@dataclass(frozen=True)
class TrimChoices:
    """The settings of a trim that the app offers; the others have their defaults."""

    recover: bool = True
    """Take in what the views show as attached to the object."""
    clean: bool = True
    """Leave out of the background what only the object hid."""
    fill: bool = True
    """Fill the hole in the surfaces that the object hid."""
    fit: bool = True
    """Cut and fit the Gaussians at the object's outline."""

    with_standing: bool = False
    """Take out of the scene what stands on the object, too."""

    def config(self, up: Point | None) -> TrimConfig:
        """Return the settings of all stages; an up vector that is None is found, as the command line does."""
        return TrimConfig(
            up=up,
            evidence=EvidenceConfig(recover=self.recover),
            refine="fit" if self.fit else "off",
            background="exact" if not self.clean else ("filled" if self.fill else "clean"),
            with_what_stands_on_it=self.with_standing,
        )


@dataclass(frozen=True)
class Similarity:
    """A move, a turn and a scaling: a point x goes to scale * R @ x + to."""

    scale: Annotated[float, Range(1e-3, 1e3)] = 1.0
    turn: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """R as a quaternion, w first, of any length but zero."""
    to: Point = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not 0.5 < np.linalg.norm(self.turn) < 2:
            raise InputError("A turn is a quaternion of about unit length.")

    @property
    def rotation(self) -> Float64Array:
        """The rotation, (3, 3)."""
        return np.asarray(rotation_matrices(np.array([self.turn], np.float32))[0])

    def apply(self, gaussians: Gaussians) -> Gaussians:
        """Return Gaussians that lie there."""
        origin = -self.rotation.T @ np.array(self.to) / self.scale
        return Placement(self.rotation, origin, self.scale).apply(gaussians)


@dataclass(frozen=True, eq=False)
class MarkedObject:
    """An object that is being marked, and its cut-out."""

    id: int
    """From 1; no other object of the scene has had it."""
    name: str
    colour: Colour
    selected: Selection
    """What the marks select."""
    marks: tuple[Mark, ...] = ()
    result: TrimResult | None = None
    """The trim of the object; None if it is not cut out."""
    stale: bool = False
    """Whether it was marked since it was cut out."""
    together: bool = False
    """Whether it was cut out with other objects, so that the scene without it is without those, too."""
    choices: TrimChoices = field(default_factory=TrimChoices)
    """What it was, or is to be, trimmed with."""
    before: BoolArray | None = None
    """The object's Gaussians before the marks since its last cut-out, or else before the last mark, (N,); None for an
    object that was cut out as it had been marked."""
    hidden: bool = False
    """Not to be seen; what is hidden cannot be marked either."""
    locked: bool = False
    """Other objects get none of what this one has."""
    moved: Similarity | None = None
    """Where it is to lie in files; None: where it lies in the scene."""

    @property
    def fresh(self) -> TrimResult | None:
        """The result of the marks as they are; None if there is none."""
        return None if self.stale else self.result

    @property
    def mask(self) -> BoolArray:
        """Which Gaussians the object has, with what was marked since it was cut out, (N,)."""
        if self.fresh is not None:
            return self.fresh.object_mask
        mask, result = self.selected.mask, self.result
        if result is None:
            return mask
        rough, settled = result.selection | result.scene.blank, self.selected.settled
        added = mask & ~rough if settled is None else mask & (~rough | settled.touched)
        return np.asarray((result.object_mask | added) & ~(rough & ~mask) & ~self.selected.excluded_mask)

    @property
    def n_selected(self) -> int:
        """Number of selected Gaussians."""
        return int(np.count_nonzero(self.selected.mask))

    @property
    def summary(self) -> str:
        """What was cut out, in sentences; empty if nothing was."""
        result = self.fresh
        if result is None:
            return ""
        report = describe(result)
        entry = report["objects"][0]
        if entry["refused"]:
            return " ".join([f"{self.name}: {sentences(report)[0]}", *entry["warnings"]])
        removed, added = (entry["counts"][name] for name in ("removed", "added"))
        said = f"{self.name} is cut out: {entry['gaussians']:,} Gaussians; {removed:,} removed, {added:,} added."
        holes = [f"The hole is not filled: {entry['not_filled'].rstrip('.')}."] if entry["not_filled"] else []
        return " ".join([said, *filter(None, [entry["shrunk_side"]]), *holes, *entry["warnings"]])

    def marked(self, marks: tuple[Mark, ...], selected: Selection, *, further: bool = False) -> MarkedObject:
        """Return the object with other marks; with further ones, its cut-out is stale and still to be seen."""
        result = self.result if further else None
        before = self.before if self.stale and self.before is not None else self.mask
        return replace(self, marks=marks, selected=selected, before=before, result=result, stale=result is not None)


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
    next_id: int
    """Of the next object."""
    last: str = ""
    """The step that led here, in a few words."""

    @classmethod
    def first(cls, document: Document, up: UpVector) -> Snapshot:
        """Return the state in which nothing is marked."""
        empty = MarkedObject(1, "object 1", PALETTE[0], Selection.nothing(len(document.scene)))
        return cls(document, up, document.basis(up), (empty,), 0, 2, "open")

    @property
    def object(self) -> MarkedObject:
        """The object that is being marked."""
        return self.objects[self.active]

    def part(self, number: int) -> MarkedObject:
        """Return the object with this id.

        Raises:
            InputError: there is none any more.
        """
        found = next((part for part in self.objects if part.id == number), None)
        if found is None:
            raise InputError(f"There is no object {number} any more.")
        return found

    @property
    def given_up(self) -> Point | None:
        """The up vector, if it has to be told to find it again."""
        return point_of(self.up.direction) if self.up.source in ("given", FROM_FORMAT) else None

    @property
    def locked(self) -> BoolArray:
        """Gaussians of other objects that are locked or hidden, which marks leave alone, (N,)."""
        others = [part for part in self.objects if part is not self.object and (part.locked or part.hidden)]
        return np.asarray(np.any([self.nothing().mask, *(part.mask for part in others)], axis=0))

    @property
    def has_work(self) -> bool:
        """Whether something is marked that would be lost with the scene."""
        return any(part.marks for part in self.objects)

    @property
    def sentence(self) -> str:
        """What there is, and what to do next."""
        part = self.object
        if part.fresh is not None:
            return part.summary
        if part.n_selected:
            return f"{part.name}: {part.n_selected:,} Gaussians selected. Press 'Cut out', or go on marking."
        return "Choose 'Click' and click on the object that you want; 'Find objects' marks all."

    def with_object(self, changed: MarkedObject, last: str) -> Snapshot:
        """Return the snapshot with another state of the object of the same id."""
        return replace(self, objects=tuple(changed if o.id == changed.id else o for o in self.objects), last=last)

    def nothing(self) -> Selection:
        """Return an empty selection."""
        return Selection.nothing(len(self.document.scene))

    def applied(self, selected: Selection, marks: Sequence[Mark]) -> Selection:
        """Return a selection after further marks.

        Raises:
            InputError: a mark is not possible.
        """
        for mark in marks:
            selected = _interpreter(self.document, self.basis).apply(selected, mark)
        return selected

    def selection_of(self, part: MarkedObject) -> Selection:
        """Return what an object's marks select as `select` does, with what they removed and cut."""
        return replace(part.selected, marks=replace(self.basis, marks=part.marks))

    def understood_anew(self, last: str) -> Snapshot:
        """Return the same marks, understood with this up vector and these cameras; what is marked is not cut out.

        Raises:
            InputError: a mark is not possible with them.
        """
        objects = tuple(
            part.marked(part.marks, self.applied(self.nothing(), part.marks)) if part.marks else part
            for part in self.objects
        )
        return replace(self, objects=objects, last=last)

    def contrasting_colour(self, own: BoolArray) -> Colour:
        """Return the palette's colour that no marked object has and that is farthest from some Gaussians', (N,)."""
        taken = {part.colour for part in self.objects if part.marks}
        free = [colour for colour in PALETTE if colour not in taken] or list(PALETTE)
        if not own.any():
            return free[0]
        mean = np.median(np.clip(0.5 + SH_C0 * self.document.scene.sh_dc[own], 0, 1), axis=0) * 255
        return max(free, key=lambda colour: float(np.linalg.norm(mean - colour)))


@lru_cache(maxsize=1)
def _interpreter(document: Document, basis: Marks) -> MarkInterpreter:
    """Return what understands marks; in a large capture, what it has found out about floors is kept for the next."""
    return MarkInterpreter(document.scene, basis, document.cameras)
