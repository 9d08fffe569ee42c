"""Everything that a user of the app can do, without a browser: open, mark, undo, trim, save."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from gaussian_trimmer.app.documents import Document, Progress, TrimChoices, open_document, up_of
from gaussian_trimmer.app.found_objects import with_found
from gaussian_trimmer.app.marking import after_marks
from gaussian_trimmer.app.saving import Target, save_all, save_one
from gaussian_trimmer.app.snapshots import (
    Colour,
    MarkedObject,
    Snapshot,
    first_snapshot,
    free_colours,
)
from gaussian_trimmer.app.worker import Cancelled, stopping
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.planning.up_vector import UpVector
from gaussian_trimmer.selecting.marks import Click, FromFile, Mark, Point, Rows
from gaussian_trimmer.selecting.marks_file import is_marks_file, read_marks
from gaussian_trimmer.selecting.row_packing import pack_rows
from gaussian_trimmer.selecting.view_lookup import views_to_click_in
from gaussian_trimmer.trimming.trim import trim

MAX_STEPS = 50
"""Number of steps that can be undone."""
_MAX_NAME = 60
_DEFAULTS = TrimChoices()
_DESCRIBED = "name and colour"


class Session:
    """A scene and the history of what was done in it. One thread uses it, the worker's; others may only `glance`.

    Methods that change something either do so wholly or raise an error and change nothing.
    """

    def __init__(self) -> None:
        self._history: list[Snapshot] = []
        self._place = 0

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

    def glance(self) -> Snapshot | None:
        """The latest state, for any thread; None if no scene is open yet."""
        history, place = self._history, self._place
        return history[min(place, len(history) - 1)] if history else None

    def open(self, path: Path, camera_path: Path | None = None, progress: Progress = lambda stage: None) -> None:
        """Open a scene in place of the one before, whose history is lost; see `open_document`.

        Raises:
            InputError: a file cannot be read; the scene before stays open.
        """
        document = open_document(path, camera_path, progress)
        progress("looking for the ground")
        self._history, self._place = [first_snapshot(document, up_of(document))], 0

    def restore(self, restored: Snapshot) -> None:
        """Go on from a state of the same scene that was saved; undoing goes back to the present one."""
        self._step(restored)

    def use_cameras(self, path: Path) -> None:
        """Give the open scene cameras; marks are kept, and understood anew with them.

        Raises:
            InputError: the cameras cannot be read or are another scene's, or a mark is not possible with them.
        """
        self._step(self.now.with_cameras(path))

    def warm_up(self) -> None:
        """Understand a click and forget it, so that the user's first one does not wait for code to be compiled."""
        now, document = self.now, self.document
        with suppress(InputError):  # nothing may be seen there, or cameras be distorted
            view = views_to_click_in(document.scene, document.cameras, now.up.direction)[0]
            click = Click(view.camera.width // 2, view.camera.height // 2, view)
            now.applied(now.nothing(), [click])

    def mark(self, *marks: Mark, among: BoolArray | None = None) -> str:
        """Mark the active object, as one step; returns what changed, in a sentence.

        Args:
            marks: what to select, in order.
            among: Gaussians that may change, (N,), all if they are not given; those of objects that are locked or
                hidden never do. What else would change is put back by further marks.

        Raises:
            InputError: a mark is not possible, it changes nothing, or after it nothing is selected.
        """
        after, sentence = after_marks(self.now, marks, among)
        self._step(after)
        return sentence

    def invert(self) -> str:
        """Select what is not selected, but what is locked, and nothing else; returns what changed.

        Raises:
            InputError: everything is selected.
        """
        mask = self.now.object.selected.mask
        rest = Rows(pack_rows(~mask & ~self.now.locked), "inverted")
        return self.mark(rest, Rows(pack_rows(mask), "inverted", "remove")) if mask.any() else self.mark(rest)

    def keep_object(self, *, hidden: bool, locked: bool) -> None:
        """Hide the active object or lock it, or no longer; other objects get nothing of what is hidden or locked."""
        now = self.now
        self._step(now.with_object(replace(now.object, hidden=hidden, locked=locked), "hide or lock"))

    def show_all(self) -> None:
        """Hide no object any more."""
        objects = tuple(replace(part, hidden=False) for part in self.now.objects)
        self._step(replace(self.now, objects=objects, last="show all"))

    def load(self, path: Path) -> str:
        """Replace the active object's marks by a selection file of any kind, or by saved marks.

        Raises:
            InputError: the file cannot be read, does not fit the scene, or selects nothing.
        """
        now = self.now
        loaded: tuple[Mark, ...] = (FromFile(path),)
        if is_marks_file(path):
            given = read_marks(path)
            loaded, now = given.marks, now.with_basis_of(given)
        selected = now.applied(now.nothing(), loaded)
        if not selected.mask.any():
            raise InputError(f"'{path}' selects nothing in this scene.")
        self._step(now.with_object(now.object.marked(loaded, selected), "load a selection"))
        return "; ".join(selected.interpretations)

    def clear(self) -> None:
        """Remove all marks of the active object."""
        now = self.now
        self._step(now.with_object(now.object.marked((), now.nothing()), "clear"))

    def undo(self) -> str:
        """Go back one step; returns what was undone.

        Raises:
            InputError: there is nothing left to undo.
        """
        undone = self.now.last
        if self._place == 0:
            raise InputError("There is nothing to undo.")
        self._place -= 1
        return undone

    def redo(self) -> str:
        """Go forward one step again; returns what was redone.

        Raises:
            InputError: nothing was undone.
        """
        if self.now is self._history[-1]:
            raise InputError("There is nothing to redo.")
        self._place += 1
        return self.now.last

    def set_up(self, given: Point | None) -> UpVector:
        """Set the up vector, or find it from cameras or ground if none is given; marks are understood anew with it.

        Raises:
            InputError: it is not a direction, or a mark is not possible with it.
        """
        up = up_of(self.document, given)
        self._step(self.now.with_up(up, "up vector"))
        return up

    def trim(
        self,
        choices: TrimChoices = _DEFAULTS,
        progress: Progress = lambda stage: None,
        cancelled: Callable[[], bool] = lambda: False,
        *,
        joined: bool = False,
    ) -> str:
        """Trim the active object; returns the result in a sentence.

        Args:
            choices: settings.
            progress: called with the name of each stage when it begins.
            cancelled: asked at each stage whether to stop.
            joined: the trim belongs to the step before, and both are undone together.

        Raises:
            InputError: nothing is selected, or the trim is not possible.
            Cancelled: `cancelled` said so.
        """
        now = self.now
        trimmed = self._trimmed(now.object, choices, stopping(progress, cancelled))
        if cancelled():
            raise Cancelled
        if joined:
            self._history[self._place] = now.with_object(trimmed, now.last)
        else:
            self._step(now.with_object(trimmed, "trim"))
        return self.now.object.summary

    def cut_out_again(self, progress: Progress, cancelled: Callable[[], bool]) -> str:
        """Trim what was cut out when the work was saved, as part of the step that brought it back; says what was done.

        Raises:
            InputError: as `trim`; what was trimmed until then stays.
        """
        wanted = [place for place, part in enumerate(self.now.objects) if part.to_cut_out]
        for place in wanted:
            objects = list(self.now.objects)
            objects[place] = self._trimmed(objects[place], objects[place].choices, stopping(progress, cancelled))
            self._history[self._place] = replace(self.now, objects=tuple(objects))
        return f"What you had cut out is back: {len(wanted)} object{'s' * (len(wanted) > 1)}. {self.now.sentence}"

    def add_object(self) -> MarkedObject:
        """Add an object and make it the active one."""
        now, number = self.now, self._free_number()
        added = MarkedObject(number, f"object {number}", free_colours(now)[0], now.nothing())
        self._step(replace(now, objects=(*now.objects, added), active=len(now.objects), last="new object"))
        return added

    def find_objects(
        self, progress: Progress = lambda stage: None, cancelled: Callable[[], bool] = lambda: False
    ) -> str:
        """Add every object that is found without a mark, as one step; returns what was found. See `with_found`.

        Raises:
            InputError: nothing is found that is sure and not marked yet, or hardly anything shows.
            Cancelled: `cancelled` said so.
        """
        after, sentence = with_found(self.now, self._free_number(), stopping(progress, cancelled))
        if cancelled():
            raise Cancelled
        self._step(after)
        return sentence

    def remove_object(self) -> None:
        """Delete the active object.

        Raises:
            InputError: it is the only one.
        """
        now = self.now
        if len(now.objects) == 1:
            raise InputError("This is the only object; clear its marks instead.")
        objects = (*now.objects[: now.active], *now.objects[now.active + 1 :])
        self._step(replace(now, objects=objects, active=min(now.active, len(objects) - 1), last="delete object"))

    def activate(self, number: int) -> None:
        """Mark the object with this id from now on; this is not a step that can be undone.

        Raises:
            InputError: there is no such object.
        """
        now = self.now
        places = [place for place, part in enumerate(now.objects) if part.id == number]
        if not places:
            raise InputError(f"There is no object {number} any more.")
        self._history[self._place] = replace(now, active=places[0])

    def describe_object(self, name: str, colour: Colour) -> None:
        """Give the active object another name or colour.

        Raises:
            InputError: the name is empty, too long, or another object's.
        """
        now, name = self.now, " ".join(name.split())
        if not name or len(name) > _MAX_NAME or not name.isprintable():
            raise InputError(f"'{name}' cannot be a name: give 1 to {_MAX_NAME} printable characters.")
        if any(part.name == name and part is not now.object for part in now.objects):
            raise InputError(f"Another object is already called '{name}'.")
        if (name, colour) == (now.object.name, now.object.colour):
            return
        described = now.with_object(replace(now.object, name=name, colour=colour), _DESCRIBED)
        if now.last == _DESCRIBED and self._place == len(self._history) - 1:
            self._history[self._place] = described  # letters of one name are one step
        else:
            self._step(described)

    def save(self, target: Target) -> str:
        """Save the active object's trim and its marks; returns the command that does the same. See `save_one`."""
        return save_one(self.now, target)

    def save_objects(
        self, target: Target, progress: Progress = lambda stage: None, cancelled: Callable[[], bool] = lambda: False
    ) -> str:
        """Trim all marked objects together and save them with their marks; see `save_all`.

        Raises:
            InputError: no object is marked, or the files cannot be written.
            Cancelled: `cancelled` said so; nothing has been written.
        """
        return save_all(self.now, target, stopping(progress, cancelled))

    def _trimmed(self, part: MarkedObject, choices: TrimChoices, progress: Progress) -> MarkedObject:
        """An object with its trim. Raises as `trim`."""
        now, document = self.now, self.document
        if not part.n_selected:
            raise InputError("Nothing is selected; mark an object first.")
        result = trim(
            document.scene,
            part.selected.mask,
            excluded=part.selected.excluded,
            config=choices.config(now.up),
            renderer=document.renderer,
            cameras=document.cameras,
            progress=progress,
        )
        return replace(part, result=result, choices=choices, earlier=None, to_cut_out=False)

    def _free_number(self) -> int:
        """The number from which on no object has had one."""
        return 1 + max(part.id for snapshot in self._history for part in snapshot.objects)

    def _step(self, after: Snapshot) -> None:
        """Go on to another state; what was undone before cannot be redone."""
        history = [*self._history[: self._place + 1], after][-MAX_STEPS - 1 :]
        self._history, self._place = history, len(history) - 1
