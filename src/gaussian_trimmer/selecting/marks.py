"""Marks: what a user points at to select, as plain data.

A selection is a list of marks. Each adds to what the marks before it selected, removes from it, or keeps only what it
means itself. `select` makes the selection, `write_marks` and `read_marks` keep the list as JSON.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

from gaussian_trimmer.cameras import Camera, Point, Viewpoint
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import Range

Effect = Literal["add", "remove", "intersect"]
"""What a mark does to the selection that the marks before it made."""
Coordinates = Literal["scene", "up"]
"""Whether numbers are the scene's own coordinates, or turned so that z is up."""


View = Viewpoint | Camera | str | int
"""A view: the view itself or its camera, or the name or number of one of the views that `select` knows."""


@dataclass(frozen=True)
class Click:
    """A pixel on what is meant.

    On a thing of which nothing is selected it adds the thing, and on one that is selected beside others it removes it.
    Elsewhere it moves the boundary of the selection: what is around the pixel changes sides.
    """

    x: int
    """Pixels from the left."""
    y: int
    """Pixels from the top."""
    view: View
    effect: Effect = "add"
    tolerance: Annotated[float, Range(0, 1)] = 0.0
    """Above zero, the click means what goes on from the pixel in colours that differ by no more in any channel."""


@dataclass(frozen=True)
class Box:
    """A box in a view around what is meant."""

    x0: int
    y0: int
    x1: int
    """Right end, exclusive."""
    y1: int
    """Lower end, exclusive."""
    view: View
    effect: Effect = "add"


@dataclass(frozen=True)
class Box3D:
    """All Gaussians whose centres lie between two corners."""

    low: Point
    high: Point
    coordinates: Coordinates = "scene"
    effect: Effect = "add"


@dataclass(frozen=True)
class Sphere:
    """All Gaussians whose centres lie in a ball."""

    centre: Point
    radius: float
    coordinates: Coordinates = "scene"
    effect: Effect = "add"


@dataclass(frozen=True)
class Plane:
    """All Gaussians whose centres p lie above a plane: normal . p > offset."""

    normal: Point
    """Of any length but zero."""
    offset: float
    """In units of that length."""
    coordinates: Coordinates = "scene"
    effect: Effect = "add"


@dataclass(frozen=True)
class FromFile:
    """What a selection file of any kind selects."""

    path: Path
    options: SelectionOptions = field(default_factory=SelectionOptions)
    """How the file is read: the ids of the objects that are meant, if it has several, and more."""
    effect: Effect = "add"


@dataclass(frozen=True)
class FromMasks:
    """What masks of posed pictures select; the pictures' cameras must be given to `select`."""

    folder: Path
    gamma: float = 0.0
    """Bias towards the background, -1 to 1."""
    effect: Effect = "add"


@dataclass(frozen=True)
class Grow:
    """Also take what lies near the selection."""

    spacings: float
    """How near: in median distances between neighbouring Gaussians of the selection."""


@dataclass(frozen=True)
class Shrink:
    """Leave out what lies near Gaussians that are not selected."""

    spacings: float
    """How near, as for `Grow`."""


@dataclass(frozen=True)
class Stroke:
    """What was drawn over in a view."""

    view: View
    places: tuple[tuple[float, float], ...]
    """Where the line goes, from (0, 0) at the upper left of the picture to (1, 1)."""
    radius: float | None = None
    """Of a brush, in pixels of the view; None: what the line surrounds is meant."""


@dataclass(frozen=True)
class Rows:
    """Gaussians by their rows in the scene, as a lasso or a brush found them."""

    packed: str
    """Which rows they are, as `pack_rows` writes it."""
    tool: str
    """What found them, in a word or two."""
    effect: Effect = "add"
    cut: Stroke | None = None
    """A stroke at whose edge a trim cuts what it crosses; what lies under it goes."""


Mark = Click | Box | Box3D | Sphere | Plane | FromFile | FromMasks | Grow | Shrink | Rows
KINDS: dict[str, type[Mark]] = {
    "click": Click,
    "box": Box,
    "box3d": Box3D,
    "sphere": Sphere,
    "plane": Plane,
    "file": FromFile,
    "masks": FromMasks,
    "grow": Grow,
    "shrink": Shrink,
    "rows": Rows,
}
"""The marks by the names that they have in files."""


@dataclass(frozen=True, eq=False)
class Marks:
    """A list of marks with what their meaning depends on; the same marks on the same scene select the same."""

    marks: tuple[Mark, ...]
    up: Point
    """The scene's unit up vector."""
    photographed_from: tuple[Point, ...] = ()
    """Positions of the training cameras, if known: objects are not looked at from other sides."""
    scene_size: int | None = None
    """Number of Gaussians of the scene that the marks were made in, if known."""
    cameras: Path | None = None
    """File or folder of the cameras of the pictures, which masks need."""

    @property
    def have_cuts(self) -> bool:
        """Whether a mark is a stroke that cuts, which an array of Gaussians cannot hold."""
        return any(isinstance(mark, Rows) and mark.cut is not None for mark in self.marks)

    def followed_by(self, further: Marks, cameras: Path | None = None) -> Marks:
        """Return these marks and then further ones, with what these depend on.

        Args:
            further: marks in the same scene; theirs is what these do not say.
            cameras: where the cameras are now, if they are given anew.
        """
        return replace(
            self,
            marks=self.marks + further.marks,
            photographed_from=self.photographed_from or further.photographed_from,
            cameras=cameras or self.cameras,
        )
