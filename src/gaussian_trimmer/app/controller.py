"""What a user can ask for, by controls, keys and files. Everything is done by `Jobs`, one thing after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer.app import edits, files, panels
from gaussian_trimmer.app.jobs import STAGES_OF_A_TRIM, TAKE_OUT, Jobs
from gaussian_trimmer.app.page import Action, Move
from gaussian_trimmer.app.tools import Tools
from gaussian_trimmer.app.viewpoints import PARTS, Event, doubts, framed
from gaussian_trimmer.cameras import look_at, point_of
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.trimming.result import TrimResult

_STAGES_OF_FINDING = 19
"""About as many stages as finding objects has, for the progress bar."""
_AWAY = 2.5
"""From how much farther away than alone an object is seen that was put beside a scene."""
_TOOL_KEYS = dict(zip(("Esc", "C", "O", "R", "L", "P", "B", "Shift+B", "X"), panels.TOOLS, strict=True))


class Controller:
    """The actions of the app."""

    def __init__(self, jobs: Jobs) -> None:
        """Connect controls, tools and keys to what they do."""
        self.jobs, self.session, self.panels = jobs, jobs.session, jobs.panels
        self._files, self._view = jobs.files, jobs.view
        self.tools = Tools(jobs)
        jobs.page.drawn, jobs.page.changed_object = self.tools.heard, self.change_object
        jobs.page.moved = self.move
        self._doubted: TrimResult | None = None
        self._doubts: Iterator[tuple[str, Float64Array]] = iter(())
        self._connect()
        jobs.page.offer(self._actions())

    def open(self, client: Any = None, path: str = "") -> None:
        """Open a scene or a project, or the scene and cameras that the panel names; look at it if it is another one."""
        camera_path = "" if path else self.panels.camera_path.value.strip()
        path = path or self.panels.path.value

        def open_scene() -> str:
            before, stages = self.session.glance(), self.jobs.stages(5, "")
            cameras = files.path_of(camera_path, "the cameras") if camera_path else None
            sentence = self._files.open(files.path_of(path, "a splat file"), cameras, stages)
            document = self.session.document
            self.panels.path.value, self.panels.camera_path.value = str(document.path), str(document.camera_path or "")
            if before is not None and document.scene is before.document.scene:
                return sentence
            self.panels.start_afresh()
            self.panels.busy("Preparing the display", 0.75)
            self._look_from_start()
            self.tools.begin(client)
            self.jobs.worker.submit_if_idle(self.session.warm_up)
            return f"{document.path.name}: {len(document.scene):,} Gaussians. {sentence}"

        self.jobs.do("Opening", open_scene, Event.OPENED)

    def cut_out(self, client: Any = None) -> None:
        """Trim the active object, and show it alone and large."""

        def trim_and_look() -> str:
            sentence = self._trim()
            if client is not None:
                self._look_at_object(client)
            return sentence

        self.jobs.do("Cutting out", trim_and_look, Event.CUT_OUT)

    def take_out(self, client: Any = None) -> None:
        """Take the active object out of the scene, as one step."""
        stages = self.jobs.stages(STAGES_OF_A_TRIM, "Taking out: ")
        self.jobs.do(
            "Taking out", lambda: self.session.do(edits.take_out, self.panels.choices, stages), Event.TAKEN_OUT
        )

    def find_objects(self, client: Any = None) -> None:
        """Add every object that is found without a mark."""
        stages = self.jobs.stages(_STAGES_OF_FINDING, "Finding objects: ")
        self.jobs.do("Finding objects", lambda: self.session.do(edits.find, progress=stages), Event.OPENED)

    def load(self, path: str) -> None:
        """Replace the marks of the active object by those of a file."""
        given = partial(files.path_of, path, "a selection file")
        self.jobs.do("Loading", lambda: self.session.do(edits.load, given()), Event.OPENED)

    def show_part(self, part: str, client: Any = None) -> None:
        """Show everything, the object, or the scene without it, for which the object is cut out if it is not yet."""

        def choose() -> str | None:
            now = self.session.now
            self.panels.part.value = part
            wanted = part == files.WITHOUT and now.object.n_selected and now.object.result is None
            return self._trim() if wanted else None

        self.jobs.do("Showing", choose, Event.PART_CHOSEN)

    def change_object(self, number: int, what: str, value: Any, client: Any = None) -> None:
        """Choose or delete an object, or give it a name or a colour, hide or lock it."""
        edit, asked = {"active": edits.activate, "delete": edits.remove_object}.get(what), self.session.glance()

        def change() -> str | None:
            if asked is None or asked.document.scene is not self.session.document.scene:
                return None  # it was meant for the scene before
            if edit is None:
                return self.session.do(edits.describe, number, what, value)
            return self.session.do(edit, number, joined=what == "active")

        self.jobs.do("Changing", change, Event.STEPPED if edit else None)

    def move(self, move: Move) -> None:
        """Let an object lie where a tab has moved it."""
        asked = self.session.glance()

        def work() -> str | None:
            if asked is None or asked.document.scene is not self.session.document.scene:
                return None
            return self.session.do(edits.move, move.object, self._view.frame.moved(move.by, to_scene=True))

        self.jobs.do("Moving", work)

    def hide(self, client: Any = None) -> None:
        """Hide the active object, or show it again."""
        now = self.session.glance()
        if now is not None:
            self.change_object(now.object.id, "hidden", not now.object.hidden)

    def focus(self, client: Any, *, whole: bool = False) -> None:
        """Let a tab look at the object from the side that it sees, or at the scene as it did at first."""

        def look() -> None:
            if whole or not self.session.now.object.n_selected:
                self._view.look(client, *self._view.start)
            else:
                self._look_at_object(client)

        self.jobs.do("Looking", look)

    def look_at_doubt(self, client: Any) -> None:
        """Let a tab look at what is to be doubted of the cut-out, at one thing after the other."""

        def look_at_next() -> str:
            now = self.session.now
            result = files.fresh_result(now)
            if self._doubted is not result:
                self._doubted, self._doubts = result, cycle(doubts(result))
            said, away = next(self._doubts, ("Nothing is to be doubted.", None))
            if away is not None:
                centre = result.objects[0].bounds.centre
                pose = look_at(centre + away, centre, now.up.direction)
                camera = replace(self._view.viewpoint(client).camera, world_to_camera=pose)
                self._view.look(client, *framed(result.object, camera))
            return said

        self.jobs.do("Looking", look_at_next)

    def refresh(self, client: Any = None) -> None:
        """Show what the controls ask for."""
        self.jobs.do("Showing", lambda: None)

    def save(self, client: Any = None, *, together: bool = False) -> None:
        """Save the cut-out in the folder that the panel names, or all objects, trimmed together."""

        def save_results() -> str:
            parts = [part for part in self.session.now.objects if part.n_selected]
            names = {f"object {number}": part.name for number, part in enumerate(parts, 1)}
            stages = self.jobs.stages(2 * len(parts), "Saving: ")
            folder = files.path_of(self.panels.folder_for(together), "the folder").absolute()
            overwrite = self.panels.existing.value == panels.REPLACE
            sentence, self.panels.command.value = files.save(
                self.session.now,
                folder,
                self.panels.ending,
                lambda stage: stages(names.get(stage, stage)),
                engine=self.panels.engine,
                together=together,
                overwrite=overwrite,
                kept=lambda result: self.session.do(edits.keep_cuts, result),
            )
            return sentence

        self.jobs.do("Saving", save_results)

    def download(self, what: str, client: Any) -> None:
        """Send one of `files.DOWNLOADS` to a tab."""
        ending, engine = self.panels.ending, self.panels.engine
        self.jobs.do("Saving", lambda: self._files.download(what, ending, client, engine))

    def receive(self, path: Path, client: Any, *, beside: bool = False) -> None:
        """Take a file that was dropped or chosen, for what it is; a part of the open scene is a selection of it.

        With `beside`, it is a scene that is put beside the open one, as an object.
        """
        try:
            kind = identify(path).kind
        except InputError as error:
            self.panels.say(str(error), wrong=True)
            return
        if beside and kind == "splats" and self.session.glance() is not None:
            self.jobs.do("Adding a scene", lambda: self._add(path, client))
        elif path.name in files.CAMERA_NAMES:
            self.panels.camera_path.value = str(path)
            if self.session.glance() is not None:
                self._use_cameras(client)
        elif kind == "project" or (kind in ("splats", "torch") and self.session.glance() is None):
            self.open(client, str(path))
        elif kind in ("splats", "torch"):
            self.jobs.do("Loading", lambda: self._load_or_open(path, client), Event.OPENED)
        else:
            self.load(str(path))

    def _add(self, path: Path, client: Any) -> str:
        said = self._files.add(path, self.jobs.stages(3, ""))
        self.panels.path.value = str(self.session.document.path)
        self.panels.tool.value = panels.MOVE
        self.tools.begin(None)
        self._look_from_start()
        if client is not None and client.view is not None:
            self._look_at_object(client, _AWAY)
        return said

    def _load_or_open(self, path: Path, client: Any) -> str | None:
        """Take splats as a selection where they are a part of the open scene, and open them otherwise."""
        with suppress(InputError):
            return self.session.do(edits.load, path, whole=True)
        self.open(client, str(path))
        return None

    def _trim(self) -> str:
        stages = self.jobs.stages(STAGES_OF_A_TRIM, "Cutting out: ")
        return self.session.do(edits.trim_object, self.panels.choices, stages)

    def _use_cameras(self, client: Any) -> None:
        given = partial(files.path_of, self.panels.camera_path.value, "the cameras")
        self.jobs.do("Reading the cameras", lambda: self.session.do(edits.use_cameras, given()), Event.STEPPED)

    def _set_up(self, client: Any) -> None:
        given = panels.UPS[self.panels.up.value]

        def turn() -> str:
            sentence = self.session.do(edits.set_up, given)
            self._look_from_start()
            return sentence

        self.jobs.do("Turning", turn, Event.STEPPED)

    def _look_at_object(self, client: Any, away: float = 1.0) -> None:
        now = self.session.now
        cut_out = now.object.fresh
        shown = cut_out.object if cut_out else now.document.scene.select(np.flatnonzero(now.object.selected.mask))
        eye, target = framed(shown, self._view.viewpoint(client).camera)
        self._view.look(client, point_of(target + away * np.subtract(eye, target)), target)

    def _look_from_start(self) -> None:
        """Let all tabs look from the first view of the scene, up being up."""
        self._view.open(self.session.now)

    def _connect(self) -> None:
        """Have the controls do what they say."""
        controls = self.panels
        controls.tool.changed = lambda tab: self.tools.choose(controls.tool.value, tab)
        controls.part.changed = lambda tab: self.show_part(controls.part.value, tab)
        controls.up.changed = self._set_up
        controls.tolerance.changed = self.tools.tolerate
        controls.views.changed = self.refresh

    def _step(self, name: str, work: Callable[[], str], key: str = "") -> Action:
        """Return what a button or a key does that goes from one state to another."""
        return Action(name, lambda tab: self.jobs.do(name, work, Event.STEPPED), key)

    def _actions(self) -> list[Action]:
        """Return what buttons and keys do."""
        tools, controls, session, do = self.tools, self.panels, self.session, self.jobs.do
        return [
            *(Action(tool, partial(tools.choose, tool), key) for key, tool in _TOOL_KEYS.items()),
            Action("Grow", partial(tools.change_selection, "Grow"), "G"),
            Action("Shrink", partial(tools.change_selection, "Shrink"), "Shift+G"),
            Action("Invert", partial(tools.change_selection, "Invert"), "Ctrl+I"),
            Action("Select all that is shown", partial(tools.change_selection, "All"), "Ctrl+A"),
            Action("Footprint or centres", None, "M"),
            Action("Surface or through", None, "N"),
            self._step("Undo", session.undo, "Ctrl+Z"),
            self._step("Redo", session.redo, "Ctrl+Shift+Z"),
            self._step("Clear", partial(session.do, edits.clear), "Ctrl+Shift+A"),
            Action(TAKE_OUT, self.take_out, "Delete"),
            Action("Cut out", self.cut_out, "T"),
            Action("Look at the object", self.focus, "F"),
            Action("Look at the next doubt", self.look_at_doubt, "J"),
            Action("First view", partial(self.focus, whole=True), "Home, Shift+F"),
            *(Action(tool, partial(tools.choose, tool), key) for key, tool in zip("123", panels.PLACING, strict=True)),
            self._step("Put it back", lambda: session.do(edits.move, session.now.object.id, None)),
            *(Action(part, partial(self.show_part, part), key) for key, part in zip("456", PARTS, strict=True)),
            Action("Own colours, objects, changes", None, "V"),
            Action("Hide the object", self.hide, "H"),
            self._step("Unhide all", partial(session.do, edits.show_all), "U"),
            self._step("New object", partial(session.do, edits.add_object)),
            Action("Find objects", self.find_objects),
            Action("Apply the box", tools.apply_box),
            Action("Smaller brush", partial(tools.resize_brush, larger=False), "["),
            Action("Larger brush", partial(tools.resize_brush, larger=True), "]"),
            Action("Up by three clicks on the ground", partial(tools.choose, panels.POINTS)),
            Action("Cancel", lambda tab: self.jobs.worker.cancel()),
            Action("Open", self.open),
            Action("Apply cameras to this scene", self._use_cameras),
            Action("Replace the marks by this file", lambda tab: self.load(controls.selection_path.value)),
            Action("Download the project", lambda tab: do("Saving", lambda: self._files.download_project(tab))),
            *(Action(f"Download: {what}", partial(self.download, what)) for what in files.DOWNLOADS),
            Action("Save in this folder", self.save),
            Action("Cut out and save all objects", partial(self.save, together=True)),
        ]
