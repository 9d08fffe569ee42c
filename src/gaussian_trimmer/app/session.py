"""A scene and the history of what was done in it, without a browser, and what is kept of it as a project."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer._version import __version__
from gaussian_trimmer.app.edits import Change, check_name, understood_with
from gaussian_trimmer.app.snapshots import Document, MarkedObject, Progress, Similarity, Snapshot
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import PROJECT
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.io.reading import read_json
from gaussian_trimmer.selecting.marks import Click, Marks, marks_as_json, marks_from_json
from gaussian_trimmer.selecting.select import views_to_click_in
from gaussian_trimmer.settings import from_plain

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


_HASHED_GAUSSIANS = 1000


@dataclass(frozen=True)
class Project:
    """What a project's file says: a scene, and the names and marks of the objects in it."""

    scene: Path
    cameras: Path | None
    objects: dict[str, Marks]
    """By name; all know the number of the scene's Gaussians."""
    moved: dict[str, Similarity]
    """Where those lie in files that were moved."""

    @property
    def scene_size(self) -> int | None:
        """Number of Gaussians of the scene."""
        return next(iter(self.objects.values())).scene_size


def autosave_path(folder: Path, scene: Gaussians) -> Path:
    """Return where work on a scene is kept: by what the scene holds, wherever its file lies."""
    rows = np.linspace(0, len(scene) - 1, min(len(scene), _HASHED_GAUSSIANS)).astype(np.int64)
    data = np.concatenate([scene.means[rows], scene.sh_dc[rows]], axis=1)
    return folder / f"{hashlib.sha256(data.tobytes()).hexdigest()[:16]}-{len(scene)}.json"


def project_as_json(now: Snapshot, folder: Path) -> str:
    """Return a state as a project's file in a folder has it."""
    document = now.document
    plain = {
        "content": PROJECT,
        "version": __version__,
        "scene": str(document.path.absolute()),
        "cameras": None if document.camera_path is None else str(document.camera_path.absolute()),
        "objects": {part.name: marks_as_json(replace(now.basis, marks=part.marks), folder) for part in now.objects},
        "moved": {part.name: asdict(part.moved) for part in now.objects if part.moved},
    }
    return json.dumps(plain, indent=1, allow_nan=False)


def read_project(path: Path) -> Project:
    """Return the project in a file.

    Raises:
        InputError: it cannot be read, or is not a project.
    """
    raw = read_json(path)
    if not isinstance(raw, dict) or raw.get("content") != PROJECT:
        raise InputError(f"'{path}' is not a project.")
    where, objects = f"'{path}': project.", raw.get("objects")
    if not isinstance(objects, dict) or not objects:
        raise InputError(f"'{path}' is damaged: it has no objects.")
    project = Project(
        from_plain(raw.get("scene"), Path, f"{where}scene"),
        from_plain(raw.get("cameras"), Path | None, f"{where}cameras"),
        {check_name(name): marks_from_json(marks, path) for name, marks in objects.items()},
        from_plain(raw.get("moved", {}), dict[str, Similarity], f"{where}moved"),
    )
    if len({marks.scene_size for marks in project.objects.values()}) > 1:
        raise InputError(f"'{path}' is damaged: its objects are of different scenes.")
    return project


def restore(now: Snapshot, project: Project, progress: Progress = lambda stage: None) -> Change:
    """Go on with a project in its scene, its marks understood anew.

    Args:
        now: a state of the scene.
        project: what was saved.
        progress: called with what is understood.

    Raises:
        InputError: the scene is another one, or a mark is not possible.
    """
    n, first = len(now.document.scene), next(iter(project.objects.values()))
    if first.scene_size != n:
        raise InputError(
            f"This project is of '{project.scene.name}', which has {first.scene_size or 0:,} Gaussians, and this "
            f"scene has {n:,}; open its own scene first."
        )
    now = understood_with(now, first)
    parts: list[MarkedObject] = []
    for number, (name, saved) in enumerate(project.objects.items(), 1):
        progress(f"the marks of {name}")
        selected = now.applied(now.nothing(), saved.marks)
        colour = replace(now, objects=tuple(parts)).contrasting_colour(selected.mask)
        parts.append(MarkedObject(number, name, colour, selected, saved.marks, moved=project.moved.get(name)))
    last = len(parts) - 1
    after = replace(now, objects=tuple(parts), active=last, next_id=len(parts) + 1, last="work of last time")
    marked = sum(bool(part.marks) for part in parts)
    said = f"Your work is back: {marked} object{'s' * (marked > 1)} marked. Undo takes it away."
    return Change(after, f"{said} {after.sentence}")
