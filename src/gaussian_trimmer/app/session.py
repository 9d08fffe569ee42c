"""A scene and the history of what was done in it, without a browser."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from gaussian_trimmer.app.edits import Change
from gaussian_trimmer.app.snapshots import Document, Progress, Snapshot
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.selecting.marks import Click
from gaussian_trimmer.selecting.select import views_to_click_in

MAX_STEPS = 50
"""Number of steps that can be undone."""


class Cancelled(InputError):  # noqa: N818
    """The present job was asked to stop."""

    def __init__(self) -> None:
        super().__init__("Cancelled; everything is as it was.")


class Session:
    """The snapshots of one scene, and which of them is the present one.

    One thread uses it, the worker's; others may only `glance`.
    """

    def __init__(self, cancelled: Callable[[], bool] = lambda: False) -> None:
        """Begin without a scene; `cancelled` is asked after each edit whether to drop what it made."""
        self._history: list[Snapshot] = []
        self._place = 0
        self._cancelled = cancelled

    @property
    def now(self) -> Snapshot:
        """The present state.

        Raises:
            InputError: no scene is open yet.
        """
        if not self._history:
            raise InputError("Open a scene first.")
        return self._history[self._place]

    @property
    def document(self) -> Document:
        """The scene and its cameras. Raises as `now`."""
        return self.now.document

    @property
    def can_step(self) -> tuple[bool, bool]:
        """Whether there is something to undo, and something to redo."""
        return self._place > 0, self._place < len(self._history) - 1

    def glance(self) -> Snapshot | None:
        """Return the latest state, for any thread; None if no scene is open yet."""
        history, place = self._history, self._place
        return history[min(place, len(history) - 1)] if history else None

    def open(self, path: Path, camera_path: Path | None = None, progress: Progress = lambda stage: None) -> None:
        """Open a scene in place of the one before, whose history is lost; see `Document.read`.

        Raises:
            InputError: a file cannot be read; the scene before stays open.
        """
        document = Document.read(path, camera_path, progress)
        progress("looking for the ground")
        self._history, self._place = [Snapshot.first(document, document.find_up())], 0

    def do(self, edit: Callable[..., Change], *arguments: Any, joined: bool = False, **options: Any) -> str:
        """Make an edit of the present state; return what was done, in a sentence.

        Args:
            edit: one of `edits`.
            arguments: what it takes after the state.
            joined: it belongs to the step before, and both are undone together.
            options: what it takes by name.

        Raises:
            InputError: no scene is open, or as the edit; nothing has changed.
            Cancelled: the user has stopped it; nothing has changed.
        """
        after, sentence = edit(self.now, *arguments, **options)
        if self._cancelled():
            raise Cancelled
        if joined:
            self._history[self._place] = after
        elif after is not self.now:
            self._history = [*self._history[: self._place + 1], after][-MAX_STEPS - 1 :]
            self._place = len(self._history) - 1
        return sentence

    def undo(self) -> str:
        """Go back one step; return what was undone.

        Raises:
            InputError: there is nothing left to undo.
        """
        undone = self.now.last
        if self._place == 0:
            raise InputError("There is nothing to undo.")
        self._place -= 1
        return f"Undone: {undone}."

    def redo(self) -> str:
        """Go forward one step again; return what was redone.

        Raises:
            InputError: nothing was undone.
        """
        if self.now is self._history[-1]:
            raise InputError("There is nothing to redo.")
        self._place += 1
        return f"Done again: {self.now.last}."

    def warm_up(self) -> None:
        """Understand a click and forget it, so that the user's first one does not wait for code to be compiled."""
        now, document = self.now, self.document
        with suppress(InputError):  # nothing may be seen there, or cameras be distorted
            view = views_to_click_in(document.scene, document.cameras, now.up.direction)[0]
            now.applied(now.nothing(), [Click(view.camera.width // 2, view.camera.height // 2, view)])
