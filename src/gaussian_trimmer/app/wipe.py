"""Compares two states in the same view: a line across the picture, dragged, with one state at each side.

The browser draws one state at a time. So the page takes a picture of what is shown, lays it over one side of the line,
and answers; only then the 3D view shows the other state. The two meet as long as the view does not move.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gaussian_trimmer.app.display import Showing
from gaussian_trimmer.app.gestures import GestureChannel, Still
from gaussian_trimmer.app.panels import WIPE, Panels
from gaussian_trimmer.app.snapshots import Snapshot
from gaussian_trimmer.errors import InputError

_BEFORE_AFTER, _WITH_WITHOUT = ("Before", "After"), ("With it", "Without it")


@dataclass(frozen=True)
class _Comparison:
    """What is compared with what is shown."""

    other: Showing
    still: Still
    """What the page's picture is, which is what was shown before."""


class Wipe:
    """A comparison, while there is one."""

    def __init__(self, panels: Panels, channel: GestureChannel) -> None:
        self._panels, self._channel = panels, channel
        self._comparison: _Comparison | None = None

    @property
    def on(self) -> bool:
        """Whether something is compared."""
        return self._comparison is not None

    def begin(self, now: Snapshot) -> str:
        """Have the page take its picture; returns what is compared.

        Raises:
            InputError: the object has not been cut out.
        """
        if now.object.trimmed is None:
            raise InputError("There is nothing to compare yet: cut the object out first.")
        self._comparison = compared(self._panels.showing)
        self._panels.compare[WIPE] = True
        self._channel.tell_still(self._comparison.still)
        left, right = self._comparison.still.names
        return f"Left of the line: {left.lower()}; right: {right.lower()}. Drag it. Moving the view ends this."

    def show_other(self) -> None:
        """Show the other state in the 3D view, now that the page has its picture."""
        if self._comparison is not None:
            self._panels.compared = self._comparison.other

    def end(self) -> None:
        """Show one state again."""
        if self._comparison is not None:
            self._comparison = self._panels.compared = None
            self._channel.tell_still(None)
        self._panels.compare[WIPE] = False


def compared(showing: Showing) -> _Comparison:
    """What to compare with what is shown: the object before and after its trim, or the scene with it and without it."""
    if showing.part == "object":
        after = showing.when == "after"
        other = replace(showing, when="before" if after else "after")
        return _Comparison(other, Still(_BEFORE_AFTER, is_left=not after))
    if showing.part == "background":
        return _Comparison(Showing("both", "before", "own"), Still(_WITH_WITHOUT, is_left=False))
    return _Comparison(Showing("background", "after", "own"), Still(_WITH_WITHOUT, is_left=True))
