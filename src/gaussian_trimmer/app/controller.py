"""What a user can ask for, by controls, keys and files. Everything is done by `Jobs`, one thing after the other."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.app import edits, files, gestures, panels
from gaussian_trimmer.app.jobs import STAGES_OF_A_TRIM, Jobs
from gaussian_trimmer.app.keys import Binding, bind_keys, help_text
from gaussian_trimmer.app.project import is_project
from gaussian_trimmer.app.showing import Event
from gaussian_trimmer.app.tools import Tools
from gaussian_trimmer.app.viewpoints import first_look, framed
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.selecting.marks import Point

_STAGES_OF_FINDING = 19
"""About as many stages as finding objects has, for the progress bar."""
_OBJECT_EDITS = {"New": edits.add_object, "Delete": edits.remove_object, "Show all": edits.show_all}
_TOOL_KEYS = dict(zip(("escape", "C", "R", "L", "P", "B", "X"), panels.TOOLS, strict=True))


class Controller:
    """The actions of the app."""

    def __init__(self, jobs: Jobs) -> None:
        """Connect controls, tools and keys to what they do."""
        self.jobs, self.session, self.panels = jobs, jobs.session, jobs.panels
        self._files, self._presenter, self._view = jobs.files, jobs.presenter, jobs.view
        self.tools = Tools(jobs.channel, jobs.session, jobs.panels, jobs.view, jobs.do)
        jobs.made_gesture = self.tools.heard
        self._connect()
        bindings = self._bindings()
        bind_keys(jobs.server.gui, bindings)
        self.panels.help.content = help_text(bindings)

    def open(self, client: Any = None) -> None:
        """Open the scene that the panel names, with its cameras."""
        self._open(self.panels.path.value, self.panels.camera_path.value, client)

    def cut_out(self, client: Any = None) -> None:
        """Trim the active object, and show it alone and large."""

        def work() -> str:
            sentence = self._cut_out()
            if client is not None:
                self._look_at_object(client)
            return sentence

        self.jobs.do("Cutting out", work, Event.CUT_OUT)

    def find_objects(self, client: Any = None) -> None:
        """Add every object that is found without a mark."""
        stages = self.jobs.stages(_STAGES_OF_FINDING, "Finding objects: ")
        self.jobs.do("Finding objects", lambda: self.session.do(edits.find, progress=stages), Event.OPENED)

    def load(self, path: Path | None, client: Any = None) -> None:
        """Replace the marks of the active object by those of a file."""

        def work() -> str:
            if path is None:
                raise InputError("Give the path of a selection file first.")
            return self.session.do(edits.load, path)

        self.jobs.do("Loading", work, Event.OPENED)

    def step(self, name: str, client: Any = None) -> None:
        """Undo, redo, or clear."""
        steps = {
            "Undo": self.session.undo, "Redo": self.session.redo, "Clear": lambda: self.session.do(edits.clear),
        }  # fmt: skip
        self.jobs.do(name, steps[name], Event.STEPPED)

    def show_part(self, part: str, client: Any = None) -> None:
        """Show everything, the object, or the scene without it, for which the object is cut out if it is not yet."""

        def work() -> str:
            now = self.session.now
            self.panels.part.value = part
            if part == files.WITHOUT and now.object.n_selected and now.object.cut.result is None:
                return self._cut_out()
            return self.panels.status_text

        self.jobs.do("Showing", work, Event.PART_CHOSEN)

    def change_objects(self, name: str, client: Any = None) -> None:
        """Add an object, delete the active one, or show all."""
        self.jobs.do("Changing", lambda: self.session.do(_OBJECT_EDITS[name]), Event.STEPPED)

    def hide(self, client: Any = None) -> None:
        """Hide the active object, or show it again."""
        self.panels.kept["Hidden"] = not self.panels.kept["Hidden"]
        self._keep_object(client)

    def focus(self, client: Any, *, whole: bool = False) -> None:
        """Let a tab look at the object from the side that it sees, or at the scene as it did at first."""

        def work() -> str:
            if whole or not self.session.now.object.n_selected:
                self._view.look(client, *self._first_look())
            else:
                self._look_at_object(client)
            return self.panels.status_text

        self.jobs.do("Looking", work)

    def switch_wipe(self, client: Any) -> None:
        """Compare what is shown with its other state, or show one state again."""
        on = self._presenter.wipe is None
        self.jobs.do("Comparing", lambda: self._presenter.begin_wipe() if on else self.session.now.sentence)

    def choose_next(self, choice: Any, client: Any = None) -> None:
        """Take the next option of a choice."""
        choice.value = choice.options[(choice.options.index(choice.value) + 1) % len(choice.options)]
        self.jobs.do("Showing", lambda: self.panels.status_text)

    def save(self, client: Any = None, *, together: bool = False) -> None:
        """Save the cut-out in the folder that the panel names, or all objects, trimmed together."""

        def work() -> str:
            stages = self.jobs.stages(2 * len(self.session.now.objects), "Trimming ")
            sentence, command = files.save(self.session.now, self.panels.target, stages, together=together)
            self.panels.show_command(command)
            return sentence

        self.jobs.do("Saving", work)

    def download(self, client: Any) -> None:
        """Send what the panel names to a tab."""
        controls = self.panels
        what, upright = controls.download.value, controls.placed[panels.UPRIGHT]
        self.jobs.do("Saving", lambda: self._files.download(what, controls.ending, client, upright=upright))

    def describe(self) -> None:
        """Give the active object the name and colour that somebody has just entered, if they can be given."""
        asked, name = self.session.glance(), self.panels.name.value
        red, green, blue = (int(value) for value in self.panels.colour.value)

        def work() -> str:
            now = self.session.now
            if asked is not None and asked.document.scene is now.document.scene and name.strip():
                return self.session.do(edits.describe, asked.object.id, name, (red, green, blue))
            return now.sentence  # it was meant for the scene before

        self.jobs.do("Naming", work)

    def receive(self, name: str, content: bytes, client: Any) -> None:
        """Take a file that was dropped or chosen, for what it is; ask what splats are if a scene is open."""
        if self.session.glance() is None or not any(name.lower().endswith(end) for end in formats.FORMATS):
            self._take(name, content, client, as_scene=None)
            return
        question = client.gui.add_modal(f"What is {name}?")

        def answer(as_scene: bool | None, event: Any) -> None:
            question.close()
            if as_scene is not None:
                self._take(name, content, client, as_scene=as_scene)

        answers = {"A scene to open": True, "A selection of the open scene": False, gestures.CANCEL: None}
        with question:
            for label, as_scene in answers.items():
                client.gui.add_button(label).on_click(partial(answer, as_scene))

    def _take(self, name: str, content: bytes, client: Any, *, as_scene: bool | None) -> None:
        """Take a file from the browser; splats for a scene, or a selection of the open one, or as they look."""
        try:
            path = self._files.store(name, content)
            if as_scene is None:
                as_scene = is_project(path) or formats.has_splats(path)
        except InputError as error:
            self.panels.say(str(error), wrong=True)
            return
        if path.name in files.CAMERA_NAMES:
            self.panels.camera_path.value = str(path)
            if self.session.glance() is not None:
                self._use_cameras(client)
        elif as_scene:
            self._open(str(path), "", client)
        else:
            self.load(path, client)

    def _open(self, path: str, camera_path: str, client: Any) -> None:
        """Open a scene or a project, and look at it if it is another scene."""

        def work() -> str:
            before, stages = self.session.glance(), self.jobs.stages(5, "")
            sentence = self._files.open(files.path_of(path), files.path_of(camera_path), stages)
            document = self.session.document
            self.panels.path.value, self.panels.camera_path.value = str(document.path), str(document.camera_path or "")
            if before is not None and document.scene is before.document.scene:
                return sentence
            self.panels.start_afresh()
            self.panels.busy("Preparing the display", 0.75)
            painter = self._presenter.painter()
            self.tools.begin(panels.LOOK, client)
            self._look_from_start()
            self.jobs.worker.submit_if_idle(self.session.warm_up)
            n = len(document.scene)
            room = f", {painter.most:,} of them shown at once" if painter.most < n else ""
            return f"{document.path.name}: {n:,} Gaussians{room}. {sentence}"

        self.jobs.do("Opening", work, Event.OPENED)

    def _cut_out(self) -> str:
        stages = self.jobs.stages(STAGES_OF_A_TRIM, "Cutting out: ")
        return self.session.do(edits.cut_out, self.panels.choices, stages)

    def _use_cameras(self, client: Any) -> None:
        path = files.path_of(self.panels.camera_path.value)

        def work() -> str:
            if path is None:
                raise InputError("Give the path of the cameras first.")
            return self.session.do(edits.use_cameras, path)

        self.jobs.do("Reading the cameras", work, Event.STEPPED)

    def _set_up(self, client: Any) -> None:
        given = panels.UPS[self.panels.up.value]

        def work() -> str:
            sentence = self.session.do(edits.set_up, given)
            self._look_from_start()
            return sentence

        self.jobs.do("Turning", work, Event.STEPPED)

    def _keep_object(self, client: Any) -> None:
        hidden, locked = (self.panels.kept[option] for option in ("Hidden", "Locked"))
        self.jobs.do("Changing", lambda: self.session.do(edits.keep_object, hidden=hidden, locked=locked))

    def _activate(self, client: Any) -> None:
        number = int(self.panels.active.value.partition(":")[0])
        work = partial(self.session.do, edits.activate, number, joined=True)
        self.jobs.do("Choosing", work, Event.STEPPED)

    def _first_look(self) -> tuple[Point, Point]:
        document = self.session.document
        return first_look(document.scene, document.cameras, self.session.now.up.direction)

    def _look_at_object(self, client: Any) -> None:
        now = self.session.now
        cut_out = now.object.fresh
        shown = cut_out.object if cut_out else now.document.scene.select(np.flatnonzero(now.object.selected.mask))
        self._view.look(client, *framed(shown, self.tools.viewpoint(client).camera))

    def _look_from_start(self) -> None:
        """Let all tabs look from the first view of the scene, up being up."""
        self._view.show_up(self.session.now.up.direction)
        for client in (None, *self.jobs.server.get_clients().values()):
            self._view.look(client, *self._first_look())

    def _connect(self) -> None:
        """Have the controls do what they say."""
        controls, do = self.panels, self.jobs.do

        def connect(control: Any, act: Callable[[Any], None]) -> None:
            control.on_click(lambda event: act(event.client))

        connect(controls.open, self.open)
        connect(controls.use_cameras, self._use_cameras)
        connect(controls.save_project, lambda tab: do("Saving", lambda: self._files.download_project(tab)))
        connect(controls.up, self._set_up)
        connect(controls.history, lambda tab: self.step(controls.history.value, tab))
        connect(controls.load, lambda tab: self.load(files.path_of(controls.selection_path.value), tab))
        connect(controls.objects, lambda tab: self.change_objects(controls.objects.value, tab))
        connect(controls.find_objects, self.find_objects)
        connect(controls.kept, self._keep_object)
        connect(controls.active, self._activate)
        connect(controls.cut_out, self.cut_out)
        connect(controls.save, self.save)
        connect(controls.save_all, lambda tab: self.save(tab, together=True))
        connect(controls.download, self.download)
        connect(controls.part, lambda tab: self.show_part(controls.part.value, tab))
        connect(controls.compare, self.switch_wipe)
        for choice in (controls.when, controls.colours, controls.backdrop, controls.overlays):
            connect(choice, lambda tab: do("Showing", lambda: controls.status_text))
        for control in (controls.name, controls.colour):
            control.on_update(lambda event: self.describe() if event.client is not None else None)
        controls.upload.on_upload(
            lambda event: self.receive(event.target.value.name, event.target.value.content, event.client)
        )

    def _bindings(self) -> list[Binding]:
        """Return what the keys do."""
        tools, controls = self.tools, self.panels
        return [
            *(Binding(key, tool, partial(tools.choose, tool)) for key, tool in _TOOL_KEYS.items()),
            Binding("G", "grow the selection", partial(tools.change_selection, "Grow")),
            Binding("G", "shrink the selection", partial(tools.change_selection, "Shrink"), "shift"),
            Binding("I", "invert the selection", partial(tools.change_selection, "Invert"), "cmd/ctrl"),
            Binding("M", "take by footprint / by centres", partial(self.choose_next, controls.taking)),
            Binding("Z", "undo", partial(self.step, "Undo"), "cmd/ctrl"),
            Binding("Z", "redo", partial(self.step, "Redo"), "cmd/ctrl+shift"),
            Binding("A", "select all that is shown", partial(tools.change_selection, "All"), "cmd/ctrl"),
            Binding("A", "clear the selection", partial(self.step, "Clear"), "cmd/ctrl+shift"),
            Binding("delete", "clear the selection", partial(self.step, "Clear")),
            Binding("T", "cut out", self.cut_out),
            Binding("F", "look at the object", self.focus),
            Binding("home", "look at the scene as at first", partial(self.focus, whole=True)),
            Binding("F", "look at the scene as at first", partial(self.focus, whole=True), "shift"),
            *(
                Binding(key, f"show: {part}", partial(self.show_part, part))
                for key, part in zip("123", panels.PARTS, strict=True)
            ),
            Binding("space", "before / after", partial(self.choose_next, controls.when)),
            Binding("space", "before / after, with a line to drag", self.switch_wipe, "shift"),
            Binding("V", "colours: own, objects, changes", partial(self.choose_next, controls.colours)),
            Binding("H", "hide the object", self.hide),
            Binding("U", "show all objects", partial(self.change_objects, "Show all")),
        ]
