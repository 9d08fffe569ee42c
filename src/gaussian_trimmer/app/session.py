"""Everything that a user of the app can do, without a browser: open, mark, undo, trim, save."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from gaussian_trimmer.app.documents import (
    PALETTE,
    Colour,
    Document,
    MarkedObject,
    Progress,
    Snapshot,
    TrimChoices,
    basis_of,
    first_snapshot,
    open_document,
    up_of,
)
from gaussian_trimmer.app.saving import save_all, save_one
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.planning.up_vector import UpVector
from gaussian_trimmer.selecting.interpretation import MarkInterpreter, SelectionState
from gaussian_trimmer.selecting.marks import Click, FromFile, Mark, Marks, Point
from gaussian_trimmer.selecting.marks_file import is_marks_file, read_marks
from gaussian_trimmer.selecting.view_lookup import views_to_click_in
from gaussian_trimmer.trimming.trim import trim

MAX_STEPS = 50
"""Number of steps that can be undone."""
_MAX_OBJECTS = 64
_MAX_NAME = 60
_DEFAULTS = TrimChoices()


class Cancelled(Exception):  # noqa: N818
    """The user has stopped what was going on; everything is as before."""


class Session:
    """A document and its history. Methods may be called from any thread; one at a time goes to work.

    Methods that change something either do so wholly or raise an error and change nothing.
    """

    def __init__(self) -> None:
        self._working = threading.RLock()
        self._document: Document | None = None
        self._history: list[Snapshot] = []
        self._place = 0

    @property
    def is_open(self) -> bool:
        """Whether a scene was opened."""
        return self._document is not None

    @property
    def document(self) -> Document:
        """The scene.

        Raises:
            InputError: none was opened yet.
        """
        if self._document is None:
            raise InputError("Open a scene first.")
        return self._document

    @property
    def now(self) -> Snapshot:
        """The present state.

        Raises:
            InputError: no scene was opened yet.
        """
        with self._working:
            return self._now()

    def glance(self) -> Snapshot | None:
        """The latest state, without waiting for what is going on; None if no scene was opened yet."""
        history, place = self._history, self._place
        return history[min(place, len(history) - 1)] if history else None

    def open(self, path: Path, camera_path: Path | None = None, progress: Progress = lambda stage: None) -> None:
        """Open a scene in place of the one before; see `open_document`.

        Raises:
            InputError: a file cannot be read; the scene before stays open.
        """
        with self._working:
            document = open_document(path, camera_path, progress)
            progress("looking for the ground")
            first = first_snapshot(document, up_of(document))
            self._document, self._history, self._place = document, [first], 0

    def warm_up(self) -> None:
        """Understand a click and forget it, so that the user's first one does not wait for code to be compiled."""
        with self._working:
            now, document = self._now(), self.document
            with suppress(InputError):  # nothing may be seen there, or cameras be distorted
                view = views_to_click_in(document.scene, document.cameras, now.up.direction)[0]
                click = Click(view.camera.width // 2, view.camera.height // 2, view)
                self._applied(now.basis, self._nothing(), [click])

    def mark(self, *marks: Mark) -> str:
        """Mark the active object, as one step; returns how the last mark was understood.

        Raises:
            InputError: a mark is not possible, or after it nothing is selected.
        """
        with self._working:
            now = self._now()
            selected = self._applied(now.basis, now.object.selected, marks)
            if not selected.mask.any():
                raise InputError("After this mark nothing would be selected; it was not made. To begin anew, clear.")
            changed = replace(now.object, marks=now.object.marks + marks, selected=selected, result=None)
            self._step(now.with_object(changed, selected.interpretations[-1]))
            return selected.interpretations[-1]

    def load(self, path: Path) -> str:
        """Take a selection file of any kind, or a file of marks, in place of the active object's marks.

        Raises:
            InputError: the file cannot be read, does not fit the scene, or selects nothing.
        """
        with self._working:
            now = self._now()
            loaded: tuple[Mark, ...] = (FromFile(path),)
            if is_marks_file(path):
                given = read_marks(path)
                loaded, now = given.marks, self._on_basis_of(given, now)
            selected = self._applied(now.basis, self._nothing(), loaded)
            if not selected.mask.any():
                raise InputError(f"'{path}' selects nothing in this scene.")
            self._step(
                now.with_object(replace(now.object, marks=loaded, selected=selected, result=None), "load a selection")
            )
            return "; ".join(selected.interpretations)

    def clear(self) -> None:
        """Take all marks of the active object away."""
        with self._working:
            now = self._now()
            self._step(
                now.with_object(replace(now.object, marks=(), selected=self._nothing(), result=None), "clear")
            )  # fmt: skip

    def undo(self) -> str:
        """Go one step back; returns what was undone.

        Raises:
            InputError: nothing is left to undo.
        """
        with self._working:
            undone = self._now().last
            if self._place == 0:
                raise InputError("There is nothing to undo.")
            self._place -= 1
            return undone

    def redo(self) -> str:
        """Go one step forward again; returns what was done again.

        Raises:
            InputError: nothing was undone.
        """
        with self._working:
            self._now()
            if self._place == len(self._history) - 1:
                raise InputError("There is nothing to redo.")
            self._place += 1
            return self._now().last

    def set_up(self, given: Point | None) -> UpVector:
        """Set the up vector, or find it from cameras or ground if none is given; marks are understood anew with it.

        Raises:
            InputError: it is no direction, or a mark is not possible with it.
        """
        with self._working:
            now, up = self._now(), up_of(self.document, given)
            basis = replace(basis_of(self.document, up), photographed_from=now.basis.photographed_from)
            self._step(replace(self._on_basis(now, basis), up=up, last="up vector"))
            return up

    def up_from_points(self, points: Sequence[Point], eye: Point) -> UpVector:
        """Set the up vector to the normal of the plane through three points, towards where the user looks from.

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
        x, y, z = (normal / np.linalg.norm(normal)).tolist()
        return self.set_up((x, y, z))

    def trim(
        self, choices: TrimChoices = _DEFAULTS, progress: Progress = lambda stage: None,
        cancelled: Callable[[], bool] = lambda: False,
    ) -> str:  # fmt: skip
        """Trim the active object; returns what came of it in a sentence.

        Args:
            progress: called with the name of each stage when it begins.
            cancelled: asked at each stage whether to stop.

        Raises:
            InputError: nothing is selected, or the trim is not possible.
            Cancelled: `cancelled` said so.
        """
        with self._working:
            now, document = self._now(), self.document
            if not now.object.n_selected:
                raise InputError("Nothing is selected; mark an object first.")

            def stage(name: str) -> None:
                if cancelled():
                    raise Cancelled
                progress(name)

            result = trim(
                document.scene, now.object.selected.mask, excluded=now.object.selected.excluded,
                config=choices.config(now.up), renderer=document.renderer,
                cameras=document.cameras, progress=stage,
            )  # fmt: skip
            if cancelled():
                raise Cancelled
            self._step(now.with_object(replace(now.object, result=result, choices=choices), "trim"))
        if result.refused:
            return f"Not trimmed: {result.refused}; the selection stays as it is."
        accepted = sum(not view.rejected for view in result.views)
        return " ".join([
            f"{len(result.object):,} Gaussians; {accepted} of {len(result.views)} views accepted.", *result.warnings,
        ])  # fmt: skip

    def add_object(self) -> MarkedObject:
        """Add an object and make it the active one.

        Raises:
            InputError: there are too many.
        """
        with self._working:
            now = self._now()
            if len(now.objects) >= _MAX_OBJECTS:
                raise InputError(f"There are {_MAX_OBJECTS} objects, which is all that the app can show.")
            number = 1 + max(part.id for snapshot in self._history for part in snapshot.objects)
            added = MarkedObject(number, f"object {number}", PALETTE[(number - 1) % len(PALETTE)], self._nothing())
            self._step(replace(now, objects=(*now.objects, added), active=len(now.objects), last="new object"))
            return added

    def remove_object(self) -> None:
        """Take the active object away.

        Raises:
            InputError: it is the only one.
        """
        with self._working:
            now = self._now()
            if len(now.objects) == 1:
                raise InputError("This is the only object; clear its marks instead.")
            objects = (*now.objects[: now.active], *now.objects[now.active + 1 :])
            self._step(replace(now, objects=objects, active=min(now.active, len(objects) - 1), last="remove object"))

    def activate(self, number: int) -> None:
        """Let marks go to the object of an id from now on; this is no step that can be undone.

        Raises:
            InputError: there is no such object.
        """
        with self._working:
            now = self._now()
            places = [place for place, part in enumerate(now.objects) if part.id == number]
            if not places:
                raise InputError(f"There is no object {number} any more.")
            self._history[self._place] = replace(now, active=places[0])

    def rename(self, name: str) -> None:
        """Name the active object.

        Raises:
            InputError: the name is empty, too long, or another object's.
        """
        with self._working:
            now, name = self._now(), " ".join(name.split())
            if not name or len(name) > _MAX_NAME or not name.isprintable():
                raise InputError(f"'{name}' is no name of 1 to {_MAX_NAME} printable characters.")
            if any(part.name == name and part is not now.object for part in now.objects):
                raise InputError(f"Another object has the name '{name}'.")
            if name != now.object.name:
                self._step(now.with_object(replace(now.object, name=name), "rename"))

    def recolour(self, colour: Colour) -> None:
        """Give the active object another colour."""
        with self._working:
            now = self._now()
            if colour != now.object.colour:
                self._step(now.with_object(replace(now.object, colour=colour), "colour"))

    def save(self, folder: Path, format: str | None = None, *, overwrite: bool = False) -> str:
        """Save the active object's trim and its marks; returns the command that does the same. See `save_one`."""
        with self._working:
            return save_one(self.document, self._now(), folder, format, overwrite=overwrite)

    def save_objects(
        self, folder: Path, format: str | None = None, *, overwrite: bool = False,
        progress: Progress = lambda stage: None, cancelled: Callable[[], bool] = lambda: False,
    ) -> str:  # fmt: skip
        """Trim all marked objects together and save them with their marks; see `save_all`.

        Raises:
            InputError: no object is marked, or the files cannot be written.
            Cancelled: `cancelled` said so; nothing has been written.
        """

        def stage(name: str) -> None:
            if cancelled():
                raise Cancelled
            progress(name)

        with self._working:
            return save_all(self.document, self._now(), folder, format, overwrite=overwrite, progress=stage)

    def _now(self) -> Snapshot:
        if not self._history:
            raise InputError("Open a scene first.")
        return self._history[self._place]

    def _step(self, after: Snapshot) -> None:
        """Go on to another state; what was undone before cannot be done again."""
        history = [*self._history[: self._place + 1], after][-MAX_STEPS - 1 :]
        self._history, self._place = history, len(history) - 1

    def _nothing(self) -> SelectionState:
        return SelectionState.nothing(len(self.document.scene))

    def _applied(self, basis: Marks, selected: SelectionState, marks: Sequence[Mark]) -> SelectionState:
        document = self.document
        interpreter = MarkInterpreter(document.scene, basis, cameras=document.cameras, renderer=document.renderer)
        for mark in marks:
            selected = interpreter.apply(selected, mark)
        return selected

    def _on_basis(self, now: Snapshot, basis: Marks) -> Snapshot:
        """The state in which all marks are understood with another basis; trims are gone where that can matter."""
        objects = tuple(
            replace(part, selected=self._applied(basis, self._nothing(), part.marks), result=None)
            if part.marks
            else part
            for part in now.objects
        )
        return replace(now, basis=basis, objects=objects)

    def _on_basis_of(self, given: Marks, now: Snapshot) -> Snapshot:
        """The state in which marks mean what they mean in a file of marks."""
        n = len(self.document.scene)
        if given.scene_size not in (None, n):
            raise InputError(
                f"The marks were made in a scene of {given.scene_size} Gaussians, and this one has {n}; open the scene "
                "that they were made in."
            )
        places = given.photographed_from or now.basis.photographed_from
        if (given.up, places) == (now.basis.up, now.basis.photographed_from):
            return now
        up = now.up if given.up == now.basis.up else UpVector(np.array(given.up), "given", 1.0)
        return replace(self._on_basis(now, replace(now.basis, up=given.up, photographed_from=places)), up=up)
