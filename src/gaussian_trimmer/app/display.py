"""Which Gaussians the app shows, and in which colours. N Gaussians of the scene, M shown."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.app.documents import MarkedObject, Snapshot
from gaussian_trimmer.app.viewpoints import Frame
from gaussian_trimmer.gaussians import SH_C0, BoolArray, FloatArray, Gaussians, IntArray
from gaussian_trimmer.result import RowLabel

Part = Literal["both", "object", "background"]
When = Literal["before", "after"]

_TINT_SHARE = 0.6
"""Share of the object's colour in that of a selected Gaussian."""


@dataclass(frozen=True)
class Showing:
    """What is to be seen."""

    part: Part = "both"
    when: When = "before"
    """What is selected, or what was trimmed; an object that has not been trimmed is shown as it is selected."""
    tint: bool = True
    """Tint the objects in their colours."""


@dataclass(frozen=True, eq=False)
class Splats:
    """M Gaussians as a viewer draws them, without view-dependent colours."""

    centres: FloatArray
    """In the viewer's coordinates, (M, 3)."""
    covariances: FloatArray
    """(M, 3, 3)."""
    colours: FloatArray
    """RGB from 0 to 1, (M, 3)."""
    opacities: FloatArray
    """(M, 1)."""
    rows: IntArray
    """Rows of the scene that they come from, -1 for none, (M,)."""

    def __len__(self) -> int:
        return len(self.centres)

    def select(self, on: BoolArray) -> Splats:
        """Those that are on, (M,)."""
        return Splats(*(getattr(self, field.name)[on] for field in fields(self)))


class Painter:
    """Draws states of one scene. What it keeps is bounded by the number of Gaussians that are shown at most."""

    def __init__(self, scene: Gaussians, most: int) -> None:
        """Prepare the whole scene, thinned if it has more Gaussians than `most`."""
        self.scene = scene
        self.frame = Frame.around(scene.means)
        self._most = most
        self._rows, self._growth = thinned(np.ones(len(scene), np.bool_), most)
        self._whole = self._splats_of(scene.select(self._rows), self._rows, self._growth)

    @property
    def shown(self) -> int:
        """Number of Gaussians of the scene that are shown at once."""
        return len(self._rows)

    def paint(self, now: Snapshot, showing: Showing) -> Splats:
        """The Gaussians to show of a state, in their colours.

        Args:
            now: the state.
            showing: what of it is to be seen.
        """
        after = showing.when == "after"
        splats = self._splats(shown_rows(now, showing) & ~_replaced_rows(now, after))
        if after:
            splats = _joined([splats, *self._replacements(now, showing.part)])
        colours, owner = splats.colours.copy(), np.where(splats.rows >= 0, _owners(now, after)[splats.rows], -1)
        if showing.tint:
            for place, marked in enumerate(now.objects):
                mine = owner == place
                colours[mine] = (1 - _TINT_SHARE) * colours[mine] + _TINT_SHARE * np.array(
                    marked.colour, np.float32
                ) / 255
        return replace(splats, colours=colours)

    def _splats(self, visible: BoolArray) -> Splats:
        """What is shown of the visible Gaussians of the scene, (N,)."""
        if self._growth == 1 or visible.all():
            return self._whole.select(visible[self._rows])
        rows, growth = thinned(visible, self._most)
        return self._splats_of(self.scene.select(rows), rows, growth)

    def _replacements(self, now: Snapshot, part: Part) -> Iterator[Splats]:
        """Gaussians that the scene does not have: parts of split ones, fitted ones, and what was filled in."""
        for place, marked in enumerate(now.objects):
            result = marked.result
            if result is None:
                continue
            if part == "both" or (part == "object" and place == now.active):
                rows = _changed_rows(marked)
                yield self._splats_of(result.object.select(rows), result.source_index[rows])
            if part != "object":
                yield self._splats_of(result.appended, np.full(len(result.appended), -1))

    def _splats_of(self, gaussians: Gaussians, rows: IntArray, growth: float = 1.0) -> Splats:
        """Gaussians from rows of the scene as a viewer draws them, their variances larger by a factor."""
        return Splats(
            self.frame.to_viewer(gaussians.means).astype(np.float32),
            (gaussians.covariances() * (growth * self.frame.scale**2)).astype(np.float32),
            np.clip(0.5 + SH_C0 * gaussians.sh_dc, 0, 1).astype(np.float32),
            gaussians.opacities[:, None].astype(np.float32),
            rows,
        )


def thinned(visible: BoolArray, most: int) -> tuple[IntArray, float]:
    """Rows of at most `most` of the visible Gaussians (N,), and by how much variances grow to cover for the others.

    The rows are drawn at random, the same every time. Surfaces stay closed where areas grow as numbers shrink.
    """
    rows = np.flatnonzero(visible)
    if len(rows) <= most:
        return rows, 1.0
    chosen = np.random.default_rng(0).choice(len(rows), most, replace=False)
    return rows[np.sort(chosen)], len(rows) / most


def shown_rows(now: Snapshot, showing: Showing) -> BoolArray:
    """Which Gaussians of the scene are to be seen, whole or by what an object's trim has in their place, (N,)."""
    after = showing.when == "after"
    owner = _owners(now, after)
    if showing.part == "object":
        return np.asarray(owner == now.active)
    dropped = np.zeros(len(owner), np.bool_)
    for part in now.objects:
        if after and part.result is not None:
            dropped[part.result.dropped] = True
            dropped[part.result.source_index[part.result.label == RowLabel.RELIT]] = True
    return ~dropped & (owner < 0) if showing.part == "background" else ~dropped


def _owners(now: Snapshot, after: bool) -> NDArray[np.int16]:
    """Place of the object that has each Gaussian of the scene, (N,); -1 for none. The active one comes first."""
    owner = np.full(len(now.object.selected.mask), -1, np.int16)
    order = [place for place in range(len(now.objects)) if place != now.active] + [now.active]
    for place in order:
        part = now.objects[place]
        owner[part.result.object_mask if after and part.result is not None else part.selected.mask] = place
    return owner


def _changed_rows(part: MarkedObject) -> IntArray:
    """Rows of an object's trim that the scene does not have: parts of split Gaussians, and fitted ones."""
    assert part.result is not None
    labels = part.result.label[: len(part.result.object)]
    return np.union1d(np.flatnonzero(labels == RowLabel.SPLIT_INSIDE), part.result.fitted)


def _replaced_rows(now: Snapshot, after: bool) -> BoolArray:
    """Gaussians of the scene in whose place a trim has others, (N,)."""
    replaced = np.zeros(len(now.object.selected.mask), np.bool_)
    for part in now.objects:
        if after and part.result is not None:
            replaced[part.result.source_index[_changed_rows(part)]] = True
    return replaced


def _joined(parts: list[Splats]) -> Splats:
    return Splats(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Splats)))
