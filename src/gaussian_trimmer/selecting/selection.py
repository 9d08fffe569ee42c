"""A selection: what it is in memory and on disk, and how it is read from whatever file holds one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, Float64Array, IntArray
from gaussian_trimmer.io.writing import atomic_file, npy_bytes
from gaussian_trimmer.selecting.marks import Effect, Marks, write_marks

if TYPE_CHECKING:  # most selections are read from files, and need no kernels
    from gaussian_trimmer.trimming.arguments import Settled, StrokeCut
from collections.abc import Callable, Sequence
from contextlib import suppress

from gaussian_trimmer.cameras import Camera, CameraSet, Viewpoint
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import Gaussians, check_gaussians
from gaussian_trimmer.geometry.copies import Distinct
from gaussian_trimmer.selecting.marks import Box, Click, FromFile, Mark, read_marks
from gaussian_trimmer.selection_files import SelectionOptions, load_selection
from gaussian_trimmer.selection_files.selection_file import flag


@dataclass(frozen=True, eq=False)
class Seed:
    """A place that the user said belongs to the object, or does not."""

    point: Float64Array
    """World point, (3,)."""
    radius: float
    """How far around it that holds, in scene units."""
    inside: bool


@dataclass(frozen=True, eq=False)
class Selection:
    """What a file or marks select; `trim` takes it as it is. Arrays are not changed in place."""

    mask: BoolArray
    """(N,)."""
    excluded: BoolArray | None = None
    """What a trim does not take in, since marks removed it and none selected it again, (N,); None: nothing."""
    cuts: tuple[StrokeCut, ...] = ()
    """Strokes at which a trim cuts."""
    settled: Settled | None = None
    """What strokes on a cut-out have settled; None: nothing."""
    marks: Marks | None = None
    """The marks, with everything that their meaning depends on; None if it was not made by marks."""
    interpretations: tuple[str, ...] = ()
    """How each mark was understood."""
    seeds: tuple[Seed, ...] = ()
    """What clicks have said about places."""
    other_sizes: tuple[IntArray, ...] = ()
    """Rows, among the distinct Gaussians, of what the last click means if it is made again, and again: the next larger
    thing, the next smaller one."""
    before_click: Selection | None = None
    """What of these was selected before that click; None if it has no other sizes."""

    @classmethod
    def nothing(cls, n: int) -> Selection:
        """Return what no mark selects, in a scene of n Gaussians."""
        return cls(np.zeros(n, np.bool_), np.zeros(n, np.bool_))

    def __repr__(self) -> str:
        made = f", {', '.join(self.interpretations)}" if self.interpretations else ""
        return f"<Selection: {np.count_nonzero(self.mask):,} of {len(self.mask):,} Gaussians{made}>"

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the mask, for NumPy."""
        return np.array(self.mask, dtype, copy=bool(copy) or dtype not in (None, np.bool_))

    @property
    def excluded_mask(self) -> BoolArray:
        """What marks removed and none selected again, (N,)."""
        return np.zeros_like(self.mask) if self.excluded is None else self.excluded

    @property
    def marked_from(self) -> tuple[Camera, ...]:
        """Cameras of the views in which marks added to it."""
        added = (m for m in self.marks.marks if isinstance(m, Click | Box) and m.effect == "add") if self.marks else ()
        return tuple(mark.view.camera for mark in added if isinstance(mark.view, Viewpoint))

    def combined(self, found: BoolArray, effect: Effect) -> Selection:
        """Combine with what a mark means, (N,); what one removes is excluded whether or not it was selected."""
        if effect == "remove":
            return replace(self, mask=self.mask & ~found, excluded=self.excluded_mask | found)
        mask = self.mask | found if effect == "add" else self.mask & found
        spared = found if effect == "add" else np.zeros_like(found)
        cuts = tuple(replace(cut, spared=cut.spared | spared) for cut in self.cuts)
        return replace(self, mask=mask, excluded=self.excluded_mask & ~mask, cuts=cuts)

    def among(self, rows: IntArray) -> Selection:
        """Return the same for some rows of the scene, (M,)."""
        cuts = tuple(replace(cut, spared=cut.spared[rows]) for cut in self.cuts)
        return replace(self, mask=self.mask[rows], excluded=self.excluded_mask[rows], cuts=cuts)

    def changed_by(self, after: Selection, distinct: Distinct) -> Selection:
        """Return what a mark made, (N,), that made another selection of the M distinct Gaussians; copies follow."""
        if len(distinct.rows) == len(distinct.of):
            return after
        before = self.among(distinct.rows)

        def followed(new: BoolArray, old: BoolArray, mask: BoolArray) -> BoolArray:
            return np.where((new != old)[distinct.of], new[distinct.of], mask)

        each = zip(after.cuts, before.cuts, self.cuts, strict=True)
        return replace(
            after,
            mask=followed(after.mask, before.mask, self.mask),
            excluded=followed(after.excluded_mask, before.excluded_mask, self.excluded_mask),
            cuts=tuple(replace(cut, spared=followed(new.spared, old.spared, cut.spared)) for new, old, cut in each),
        )

    def save(self, path: str | Path) -> None:
        """Write the mask as .npy and, if marks made it, these beside it as .json: `trim` takes either.

        Marks say what the mask alone does not: what they removed, and where they cut.

        Raises:
            InputError: a file cannot be written.
        """
        path = Path(path)
        with atomic_file(path) as part:  # both are on the disk before either takes its place
            part.write_bytes(npy_bytes(self.mask))
            if self.marks is not None:
                write_marks(self.marks, path.with_suffix(".json"))

    def save_marks(self, path: str | Path) -> None:
        """Write the marks to a .json file, from which `select` makes the selection again.

        Raises:
            InputError: the file cannot be written.
        """
        assert self.marks is not None, "only what marks select has marks to save"
        write_marks(self.marks, Path(path))


def read_selection(
    path: str | Path,
    scene: Gaussians,
    options: SelectionOptions | None = None,
    say: Callable[[str], None] = lambda note: None,
) -> BoolArray:
    """Return which Gaussians of the scene a file selects, (N,); at least one.

    Args:
        path: a selection file of any kind, a folder in which a method left one, or marks saved as .json.
        scene: the scene, of N Gaussians.
        options: how a selection file is read.
        say: called with what a user should know of how the file was understood, such as rows that matched nothing.

    Raises:
        InputError: an option is not possible, or the file cannot be read, does not fit the scene or the options, could
            be of several kinds, or selects nothing.
    """
    check_gaussians(scene)
    return read_selection_result(path, scene, options, say=say).mask


def read_selection_result(
    path: str | Path | None,
    scene: Gaussians,
    options: SelectionOptions | None = None,
    further: Sequence[Mark] = (),
    *,
    cameras: CameraSet | None = None,
    camera_path: Path | None = None,
    up: Any = None,
    say: Callable[[str], None] = lambda note: None,
) -> Selection:
    """Return what a file or marks select, with all that marks say of it.

    Args:
        path: as for `read_selection`; None: only `further` selects, or everything is selected.
        scene, options, say: as for `read_selection`.
        further: marks that come after the file.
        cameras, camera_path: those that the scene was trained with, and where they came from.
        up: the scene's up vector, (3,), if known.

    Raises:
        InputError: as `read_selection`.
    """
    path, options = None if path is None else Path(path), options or SelectionOptions()
    earlier = read_marks(path) if path is not None and identify(path).kind == "marks" else None
    if earlier is not None and (unused := sorted(options.given())):
        raise InputError(f"'{path}' holds marks and does not use {flag(unused[0])}; leave that out.")
    if earlier is not None or further:
        # Late, since most files hold no marks, and need no kernels.
        from gaussian_trimmer.selecting.select import resolve_views, select

        if path is not None and earlier is None:
            further = [FromFile(path, options), *further]
        marks = resolve_views(scene, further, cameras=cameras, up=up, camera_path=camera_path)
        marks = marks if earlier is None else earlier.followed_by(marks, camera_path)
        return select(scene, marks, cameras=cameras)
    if path is None:
        return Selection(np.ones(len(scene), np.bool_))
    with suppress(InputError):
        if identify(beside := path.with_suffix(".json")).kind == "marks" and read_marks(beside).exclude:
            say(f"{path.name} does not say what its marks removed; give {beside} as the selection to keep that out.")
    return Selection(load_selection(path, scene, options, say))
