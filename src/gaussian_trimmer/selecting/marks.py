"""Marks: what a user points at to select, as plain data.

A selection is a list of marks. Each adds to what the marks before it selected, removes from it, or keeps only what it
means itself. `select` makes the selection, `write_marks` and `read_marks` keep the list as JSON, with the views that
its pixels refer to.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from gaussian_trimmer._version import __version__
from gaussian_trimmer.camera_files.frames import make_lens, rigid_transforms
from gaussian_trimmer.cameras import Camera, Point, Viewpoint, unit_up
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import MARKS
from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.io.reading import read_json
from gaussian_trimmer.io.writing import write_json
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import Range, from_plain, to_plain, wrong_value

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

    runs: str
    """How many rows in a row are not meant, then how many are, and so on to the last row: "3 2 1" of six are two."""
    tool: str
    """What found them, in a word or two."""
    effect: Effect = "add"
    cut: Stroke | None = None
    """A stroke at whose edge a trim cuts what it crosses; what lies under it goes."""
    settled: bool = False
    """Whether it was drawn on a cut-out: a trim leaves these Gaussians where the mark puts them, and decides about all
    others as if it had not been made. After a mark that was not, the trim decides about them, too."""

    @classmethod
    def of(
        cls, mask: BoolArray, tool: str, effect: Effect = "add", cut: Stroke | None = None, *, settled: bool = False
    ) -> Rows:
        """Return the mark of the rows in a mask, (N,).

        >>> Rows.of(np.array([True, False, False, True]), "lasso").runs
        '0 1 2 1'
        """
        ends = np.flatnonzero(np.diff(mask, prepend=False, append=not mask[-1]))
        return cls(" ".join(map(str, np.diff(ends, prepend=0).tolist())), tool, effect, cut, settled)

    def mask(self, n: int) -> BoolArray:
        """Return which rows of a scene of n Gaussians are meant, (N,).

        Raises:
            InputError: they are of another scene, or damaged.
        """
        try:
            runs = np.array(self.runs.split(), np.int64)
        except (ValueError, OverflowError) as error:
            raise InputError("The rows that a mark names cannot be read; mark again.") from error
        if len(runs) > n + 1 or (runs < 0).any() or (runs > n).any() or runs.sum() != n:
            raise InputError(
                f"A mark names rows of another scene than this one of {n:,} Gaussians; open its own scene."
            )
        return np.repeat(np.arange(len(runs)) % 2 == 1, runs)


Mark = Click | Box | Box3D | Sphere | FromFile | FromMasks | Grow | Shrink | Rows
KINDS: dict[str, type[Mark]] = {
    "click": Click,
    "box": Box,
    "box3d": Box3D,
    "sphere": Sphere,
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
    scene: Path | None = None
    """File or folder of the scene, if known."""

    @property
    def exclude(self) -> bool:
        """Whether marks remove, cut or settle something, which an array of what is selected does not say."""
        return any(getattr(m, "effect", "add") == "remove" or getattr(m, "settled", False) for m in self.marks)

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
            scene=further.scene or self.scene,
        )


_Row = tuple[float, float, float, float]


@dataclass(frozen=True)
class _SavedView:
    """A view as the file has it."""

    width: int
    height: int
    K: tuple[Point, Point, Point]
    world_to_camera: tuple[_Row, _Row, _Row, _Row]
    near: float
    name: str = ""
    drawn: dict[str, Any] | None = None


def write_marks(marks: Marks, path: Path) -> None:
    """Write marks as JSON.

    Raises:
        InputError: the file cannot be written.
    """
    write_json(marks_as_json(marks, path.parent), path)


def marks_as_json(marks: Marks, folder: Path) -> dict[str, Any]:
    """Turn marks whose views are resolved into JSON; paths become relative to a folder where that is possible."""
    views: list[Viewpoint] = []

    def number_of(view: Viewpoint) -> int:
        if not any(view is known for known in views):
            views.append(view)
        return next(i for i, known in enumerate(views) if known is view)

    writers: dict[Any, Any] = {Path: lambda path: relative_to(path, folder), Viewpoint: number_of}
    names = {kind: name for name, kind in KINDS.items()}
    entries = [{"mark": names[type(mark)], **to_plain(mark, writers)} for mark in marks.marks]
    rest = to_plain(replace(marks, marks=()), writers)
    saved = [
        to_plain(view.camera)
        | {"drawn": None if view.drawn_centre is None else {"centre": view.drawn_centre, "radius": view.drawn_radius}}
        for view in views
    ]
    return {"content": MARKS, "version": __version__, **rest, "marks": entries, "views": saved}


def read_marks(path: str | Path) -> Marks:
    """Return the marks in a file that `write_marks` wrote. Paths in it are relative to its folder.

    Raises:
        InputError: the file cannot be read, holds no marks, or one of them is not possible.
    """
    path = Path(path)
    return marks_from_json(read_json(path), path)


def marks_from_json(raw: Any, path: Path) -> Marks:
    """Return the marks in what `marks_as_json` made, as it stands in a file.

    Raises:
        InputError: it holds no marks, or one of them is not possible.
    """
    where = f"'{path}': "
    if not isinstance(raw, dict) or raw.get("content") != MARKS:
        raise InputError(f"'{path}' holds no marks; give the .json that 'gaussian-trimmer select' wrote.")
    readers: dict[Any, Any] = {Path: lambda data, place: path.parent / from_plain(data, Path, place)}
    saved: tuple[_SavedView, ...] = from_plain(raw.get("views", []), tuple[_SavedView, ...], f"{where}views")
    views = [_view(view, f"{where}views[{i}]") for i, view in enumerate(saved)]

    def numbered_view(data: Any, place: str) -> Viewpoint:
        number: int = from_plain(data, int, place)
        if number not in range(len(views)):
            raise wrong_value(number, place, f"the number of one of the file's {len(views)} views")
        return views[number]

    def mark(data: Any, place: str) -> Mark:
        given = dict(data) if isinstance(data, dict) else {}
        kind = given.pop("mark", None)
        if kind not in [*KINDS]:
            raise InputError(f"{place} is of no known kind; available: {', '.join(KINDS)}.")
        return from_plain(given, KINDS[kind], place, readers)  # type: ignore[no-any-return]

    readers |= {View: numbered_view, Mark: mark}
    given = {field.name: raw[field.name] for field in fields(Marks) if field.name in raw}
    marks: Marks = from_plain(given, Marks, where, readers)
    unit_up(marks.up, f"{where}the up vector")
    return marks


def relative_to(path: Path, folder: Path) -> str:
    """Return a path as seen from a folder, with slashes, or an absolute one where the folder is no parent of it."""
    whole, base = path.absolute(), folder.absolute()
    return whole.relative_to(base).as_posix() if whole.is_relative_to(base) else whole.as_posix()


def _view(saved: _SavedView, where: str) -> Viewpoint:
    K, pose = np.array(saved.K), np.array(saved.world_to_camera)
    make_lens((K[0, 0], K[1, 1], K[0, 2], K[1, 2]), saved.width, saved.height, where)
    rigid_transforms([pose], lambda _: where)
    if not saved.near > 0:
        raise wrong_value(saved.near, f"{where}.near", "above zero")
    # The numbers are taken as they are, so that the view is the same to the last bit.
    camera = Camera(pose, K, saved.width, saved.height, saved.name, saved.near)
    if saved.drawn is None:
        return Viewpoint(camera)
    ends = ((saved.drawn.get(name), kind) for name, kind in (("centre", Point), ("radius", float)))
    return Viewpoint(camera, *(from_plain(value, kind, f"{where}.drawn") for value, kind in ends))
