"""The state of the app: what is marked and cut out in a scene. Nothing here changes in place, so undoing means going
back to an earlier snapshot. N Gaussians of the scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import lru_cache

import numpy as np

from gaussian_trimmer.app.documents import Document
from gaussian_trimmer.cameras import Point, point_of
from gaussian_trimmer.gaussians import SH_C0, BoolArray
from gaussian_trimmer.output.report import describe, sentences
from gaussian_trimmer.selecting.interpretation import MarkInterpreter
from gaussian_trimmer.selecting.marks import Mark, Marks
from gaussian_trimmer.selecting.selection import Selection
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.evidence import EvidenceConfig
from gaussian_trimmer.trimming.result import TrimResult
from gaussian_trimmer.trimming.up_vector import FROM_FORMAT, UpVector

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

    def config(self, up: Point | None) -> TrimConfig:
        """Return the settings of all stages; an up vector that is None is found, as the command line does."""
        return TrimConfig(
            up=up,
            evidence=EvidenceConfig(recover=self.recover),
            refine="fit" if self.fit else "off",
            background="exact" if not self.clean else ("filled" if self.fill else "clean"),
        )


class CutState(Enum):
    """Where the cut-out of an object stands."""

    NONE = "not cut out"
    FRESH = "cut out as it is marked"
    STALE = "cut out, and marked since"
    WANTED = "cut out when the work was saved, and to be cut out again"


@dataclass(frozen=True, eq=False)
class Cut:
    """The cut-out of an object."""

    state: CutState = CutState.NONE
    result: TrimResult | None = None
    """Of a fresh or stale one."""
    choices: TrimChoices = field(default_factory=TrimChoices)
    """What it was, or is to be, made with."""


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
    cut: Cut = field(default_factory=Cut)
    before: BoolArray | None = None
    """The object's Gaussians before the marks since its last cut-out, or else before the last mark, (N,); None for an
    object that was cut out as it had been marked."""
    hidden: bool = False
    """Not to be seen; what is hidden cannot be marked either."""
    locked: bool = False
    """Other objects get none of what this one has."""

    @property
    def fresh(self) -> TrimResult | None:
        """The result of the marks as they are; None if there is none."""
        return self.cut.result if self.cut.state is CutState.FRESH else None

    @property
    def mask(self) -> BoolArray:
        """Which Gaussians the object has, with what was marked since it was cut out, (N,)."""
        if self.fresh is not None:
            return self.fresh.object_mask
        mask, stale = self.selected.mask, self.cut.result
        if stale is None:
            return mask
        rough = stale.selection
        return np.asarray((stale.object_mask | (mask & ~rough)) & ~(rough & ~mask) & ~self.selected.removed)

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
        said = " ".join([sentences(report)[0], *report["objects"][0]["warnings"]])
        return f"{self.name}: {said}" if result.objects[0].refused else f"{self.name} is cut out: {said}"

    def marked(self, marks: tuple[Mark, ...], selected: Selection, *, further: bool = False) -> MarkedObject:
        """Return the object with other marks; with further ones, its cut-out is stale and still to be seen."""
        stale = further and self.cut.result is not None
        before = self.before if self.cut.state is CutState.STALE and self.before is not None else self.mask
        cut = replace(self.cut, state=CutState.STALE) if stale else Cut(choices=self.cut.choices)
        return replace(self, marks=marks, selected=selected, before=before, cut=cut)


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
    return MarkInterpreter(document.scene, basis, cameras=document.cameras)
