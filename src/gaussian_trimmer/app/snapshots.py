"""What is marked in a scene. Nothing here changes in place, so undoing means going back to an earlier state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from gaussian_trimmer.app.documents import Document, TrimChoices, basis_of, up_of
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import SH_C0, BoolArray
from gaussian_trimmer.output.result import TrimResult
from gaussian_trimmer.planning.up_vector import UpVector
from gaussian_trimmer.selecting.interpretation import MarkInterpreter, SelectionState
from gaussian_trimmer.selecting.marks import Mark, Marks

Colour = tuple[int, int, int]

PALETTE: tuple[Colour, ...] = (
    (255, 140, 30), (50, 150, 255), (110, 210, 70), (235, 80, 190), (250, 215, 50), (70, 215, 215), (160, 110, 255),
    (240, 80, 70),
)  # fmt: skip
"""Colours of objects, in the order in which they are added."""


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
    choices: TrimChoices = field(default_factory=TrimChoices)
    """What it was trimmed with."""
    before: SelectionState | None = None
    """What was selected before the last mark."""
    earlier: TrimResult | None = None
    """The trim that marks have made out of date; None if there is a present one, or none at all."""
    hidden: bool = False
    """Not to be seen; what is hidden cannot be marked either."""
    locked: bool = False
    """Other objects get none of what this one has."""
    to_cut_out: bool = False
    """It was cut out when the work on it was saved, and is to be again."""

    @property
    def trimmed(self) -> TrimResult | None:
        """The trim to look at: the present one or, until there is one, the one before the last marks."""
        return self.result or self.earlier

    @property
    def after(self) -> BoolArray:
        """Which Gaussians the object has after its trim, with what was marked since, (N,)."""
        if self.result is not None:
            return self.result.object_mask
        if self.earlier is None:
            return self.selected.mask
        mask, rough = self.selected.mask, self.earlier.selection
        return np.asarray((self.earlier.object_mask | (mask & ~rough)) & ~(rough & ~mask) & ~self.selected.excluded)

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

    def marked(self, marks: tuple[Mark, ...], selected: SelectionState, *, further: bool = False) -> MarkedObject:
        """The object with other marks, not trimmed yet; with further ones, the trim before is still to be seen."""
        earlier = self.trimmed if further else None
        return replace(
            self, marks=marks, selected=selected, result=None, before=self.selected, earlier=earlier, to_cut_out=False
        )


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
    def locked(self) -> BoolArray:
        """Gaussians of other objects that are locked or hidden, which marks leave alone, (N,)."""
        rows = np.zeros(len(self.document.scene), np.bool_)
        for place, part in enumerate(self.objects):
            if place != self.active and (part.locked or part.hidden):
                rows |= part.after
        return rows

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
            return f"{part.name}: {part.n_selected:,} Gaussians selected. Press 'Cut out', or go on marking."
        return "Choose 'Click' and click on the object that you want; 'Find objects' in the tab 'Objects' marks all."

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


def free_colours(now: Snapshot) -> list[Colour]:
    """The colours of the palette that no marked object has; all if there are none."""
    taken = {part.colour for part in now.objects if part.marks}
    return [colour for colour in PALETTE if colour not in taken] or list(PALETTE)


def contrasting(now: Snapshot, selected: BoolArray) -> Colour:
    """The colour of the palette that no object has and that is farthest from that of some Gaussians, (N,)."""
    own = np.median(np.clip(0.5 + SH_C0 * now.document.scene.sh_dc[selected], 0, 1), axis=0) * 255
    return max(free_colours(now), key=lambda colour: float(np.linalg.norm(own - colour)))


def first_snapshot(document: Document, up: UpVector) -> Snapshot:
    """A document in which nothing is marked."""
    empty = SelectionState.nothing(len(document.scene))
    return Snapshot(document, up, basis_of(document, up), (MarkedObject(1, "object 1", PALETTE[0], empty),), 0, "open")
