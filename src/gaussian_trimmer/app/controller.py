"""What controls and keys do: a worker's thread has the session do it, and all tabs see what comes of it."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from gaussian_trimmer import formats
from gaussian_trimmer.app import panels as controls
from gaussian_trimmer.app.files import Files, ask_whether_scene, path_of
from gaussian_trimmer.app.gestures import STILL_TAKEN, Gesture, GestureChannel
from gaussian_trimmer.app.keys import bind_keys
from gaussian_trimmer.app.panels import EVERYTHING, OBJECT, OBJECTS, OWN, PROGRAM_ENDED, WITHOUT, Panels
from gaussian_trimmer.app.presenter import Presenter
from gaussian_trimmer.app.scene_view import SceneView
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.app.snapshots import Snapshot
from gaussian_trimmer.app.tools import Tools
from gaussian_trimmer.app.viewpoints import first_look, look_at_points
from gaussian_trimmer.app.wipe import Wipe
from gaussian_trimmer.app.worker import Cancelled, Worker
from gaussian_trimmer.errors import InputError

_STAGES_OF_A_TRIM, _STAGES_OF_FINDING = 12, 19
"""About as many stages as a trim and finding objects have, for the progress bar."""
_REST_SECONDS = 0.4
"""How long a view has to rest until it is refined."""


class Controller:
    """Connects controls, session and 3D view. Everything that takes time is done in one worker's thread."""

    def __init__(self, server: Any, session: Session, most: int, state: Path, path: str, camera_path: str) -> None:
        self._server, self.session = server, session
        self.panels = Panels(server.gui, path, camera_path)
        self._view = SceneView(server)
        self._presenter = Presenter(session, self.panels, self._view, most)
        self.worker = Worker()
        self._rest: threading.Timer | None = None
        self.files = Files(session, self.panels, state, self._stages, self.worker.cancelled)
        self._given_up: Snapshot | None = None
        channel = GestureChannel(server.gui, self._heard)
        self.tools = Tools(channel, session, self.panels, self._view, self.do)
        self._wipe = Wipe(self.panels, channel)
        self._presenter.refresh()
        self._connect()
        bind_keys(server.gui, self)

    def open(self, client: Any = None) -> str:
        """Open the scene that the panel names, with its cameras; returns what to do with it."""
        return self._opened(self.files.open, client)

    def stop(self) -> None:
        """End the worker, and say so in all tabs."""
        if self._rest is not None:
            self._rest.cancel()
        self.worker.stop()
        self.panels.busy("", 0)
        self.panels.say(PROGRAM_ENDED)
        for client in self._server.get_clients().values():
            client.add_notification("The program has ended", PROGRAM_ENDED, color="red", auto_close_seconds=None)
        self._server.flush()

    def do(self, name: str, work: Callable[[], str], client: Any = None) -> None:
        """Have something done in the worker's thread, and show what comes of it."""

        def job() -> None:
            if self.worker.gave_way:
                self._given_up = None
            self._job(name, work, client)
            self._follow(client)

        self.worker.submit(job)

    def trim(self, *, joined: bool = False) -> str:
        """Trim the active object and show it; returns the result in a sentence.

        Args:
            joined: the trim belongs to the step before.
        """
        panels = self.panels
        sentence = self.session.trim(
            panels.choices, self._stages(_STAGES_OF_A_TRIM, "Cutting out: "), self.worker.cancelled, joined=joined
        )
        panels.look_at(panels.part.value, "After", OWN)
        return sentence

    def cut_out(self) -> str:
        """Trim the active object and show it alone."""
        sentence = self.trim()
        self.panels.part.value = OBJECT
        return sentence

    def find_objects(self) -> str:
        """Add every object that is found without a mark, and show them; returns what was found."""
        sentence = self.session.find_objects(
            self._stages(_STAGES_OF_FINDING, "Finding objects: "), self.worker.cancelled
        )
        self.panels.look_at(EVERYTHING, "Before", OBJECTS)
        return sentence

    def focus(self, client: Any, *, whole: bool = False) -> str:
        """Let a tab look at the selection, or at the scene if nothing is selected, from where it looks now."""
        now, means = self.session.now, self.session.document.scene.means
        rows = now.object.selected.mask
        points = means if whole or not rows.any() else means[rows]
        self._view.look(client, *look_at_points(points, self.tools.viewpoint(client).camera.forward))
        return self.panels.status_text

    def switch_wipe(self, client: Any) -> None:
        """Compare what is shown with its other state, or show one state again."""
        on = not self._wipe.on
        self.do("Comparing", lambda: self._wipe.begin(self.session.now) if on else self.session.now.sentence, client)

    def step(self, name: str) -> str:
        """Undo, redo, or clear; returns what was done."""
        if name == "Clear":
            self.session.clear()
            done = "Cleared."
        else:
            done = f"Undone: {self.session.undo()}." if name == "Undo" else f"Done again: {self.session.redo()}."
        self._show_object()
        return done

    def show_part(self, part: str) -> str:
        """Show everything, the object, or the scene without it, for which the object is cut out if it is not yet.

        Alone they have their own colours: a tint would hide what is wrong at the edge.
        """
        panels = self.panels
        panels.part.value = part
        if part == WITHOUT and self.session.now.object.n_selected and self.session.now.object.trimmed is None:
            return self.trim()
        panels.colours.value = OBJECTS if part == EVERYTHING else OWN
        return panels.status_text

    def _job(self, name: str, work: Callable[[], str], client: Any) -> None:
        self.panels.busy(name, 0)
        self._wipe.end()
        text, wrong = "", True
        try:
            try:
                text = work()
            finally:
                self._presenter.refresh()
            self.files.keep()
            wrong = False
        except InputError as error:
            text = str(error)
        except Exception as error:
            traceback.print_exc(file=sys.stderr)
            text = f"This is a defect of the program ({type(error).__name__}: {error}); everything is as it was."
        self.panels.busy("", 0)
        self.panels.say(text)
        if wrong:
            self._complain(text, client)

    def _follow(self, client: Any) -> None:
        """Trim again what a mark has corrected, or what was trimmed last time; whatever else is done goes first."""
        now = self.session.glance()
        if now is None or now is self._given_up:
            return
        lost = any(part.to_cut_out for part in now.objects)
        corrected = now.object.earlier is not None and now.object.n_selected and self.panels.when.value == "After"
        if not lost and not corrected:
            return

        def again() -> str:
            try:
                if not lost:
                    return self.trim(joined=True)
                return self.session.cut_out_again(self._stages(_STAGES_OF_A_TRIM, "Again: "), self.worker.cancelled)
            except Cancelled:
                return self.session.now.sentence
            finally:
                self._given_up = self.session.now  # unless it is to give way, it is tried once

        self.worker.submit_if_idle(lambda: self._job("Cutting out again", again, client))

    def _opened(self, work: Callable[[], str], client: Any) -> str:
        """Open something, and look at it if it is another scene."""
        before = self.session.glance()
        sentence = work()
        document = self.session.document
        if before is None or document.scene is not before.document.scene:
            self.panels.busy("Preparing the display", 0.75)
            painter = self._presenter.painter()
            self.tools.begin(controls.LOOK, client)
            self._look_from_camera()
            self.worker.submit_if_idle(self.session.warm_up)
            n = len(document.scene)
            room = f", {painter.most:,} of them shown at once" if painter.most < n else ""
            sentence = f"{document.path.name}: {n:,} Gaussians{room}. {sentence}"
        return sentence

    def _complain(self, text: str, client: Any) -> None:
        """Show a message in the tab that it concerns, or in all."""
        for tab in [client] if client is not None else self._server.get_clients().values():
            tab.add_notification("Not done", text, color="red", auto_close_seconds=12.0)

    def _connect(self) -> None:
        panels, files = self.panels, self.files

        def connect(control: Any, name: str, work: Callable[[], str]) -> None:
            control.on_click(lambda event: self.do(name, work, event.client))

        def connect_with_tab(control: Any, name: str, work: Callable[[Any], str]) -> None:
            control.on_click(lambda event: self.do(name, lambda: work(event.client), event.client))

        connect_with_tab(panels.open, "Opening", self.open)
        connect(panels.use_cameras, "Reading the cameras", files.use_cameras)
        connect_with_tab(panels.save_project, "Saving", files.download_project)
        connect(panels.up, "Turning", lambda: self._set_up(panels.up.value))
        connect(panels.history, "Stepping", lambda: self.step(panels.history.value))
        connect(panels.load, "Loading", lambda: files.load(path_of(panels.selection_path.value)))
        connect(panels.objects, "Changing", lambda: self.change_objects(panels.objects.value))
        connect(panels.find_objects, "Finding objects", self.find_objects)
        connect(panels.kept, "Changing", self._keep)
        connect(panels.active, "Choosing", self._activate)
        connect(panels.cut_out, "Cutting out", self.cut_out)
        connect(panels.save, "Saving", files.save)
        connect(panels.save_all, "Saving", files.save_all)
        connect_with_tab(panels.download, "Saving", lambda client: files.download(panels.download.value, client))
        connect(panels.part, "Showing", lambda: self.show_part(panels.part.value))
        for choice in (panels.when, panels.colours, panels.backdrop, panels.overlays):
            connect(choice, "Showing", lambda: panels.status_text)
        for control in (panels.name, panels.colour):
            control.on_update(lambda event: self._describe() if event.client is not None else None)
        panels.compare.on_click(lambda event: self.switch_wipe(event.client))
        panels.upload.on_upload(lambda event: self._receive(event.target.value, event.client))
        panels.cancel.on_click(lambda event: self.worker.cancel())
        self._server.on_client_connect(self._welcome)

    def _welcome(self, client: Any) -> None:
        """Tell a second tab that it is one, and refine what a tab sees when its view rests."""
        client.camera.on_update(lambda camera: self._moved(client))
        if len(self._server.get_clients()) > 1:
            text = "All tabs show and change the same scene."
            client.add_notification("Open in several tabs", text, auto_close_seconds=8.0)

    def _heard(self, gesture: Gesture, client: Any) -> None:
        """Do what the page has said."""
        if gesture.tool == STILL_TAKEN:
            self.worker.submit(lambda: self._change_wipe(self._wipe.show_other))
        else:
            self.tools.heard(gesture, client)

    def _change_wipe(self, change: Callable[[], None]) -> None:
        change()
        if not self._wipe.on:
            self.panels.say(self.session.now.sentence)
        self._presenter.refresh()

    def _moved(self, client: Any) -> None:
        if self._wipe.on:
            self.worker.submit(lambda: self._change_wipe(self._wipe.end))
        if self._rest is not None:
            self._rest.cancel()
        look = partial(
            self.worker.submit_if_idle, lambda: self._presenter.look_from(self.tools.viewpoint(client).camera)
        )
        self._rest = threading.Timer(_REST_SECONDS, look)
        self._rest.daemon = True
        self._rest.start()

    def _stages(self, number: int, prefix: str) -> Callable[[str], None]:
        """What to call at each of about so many stages, to show the progress."""
        steps = iter(range(1000))
        return lambda stage: self.panels.busy((prefix + stage).capitalize(), min(1.0, next(steps) / number))

    def _show_object(self) -> None:
        """Show the active object as it is now: trimmed, or selected; where nothing is selected, the scene."""
        part, panels = self.session.now.object, self.panels
        if not part.n_selected:
            panels.look_at(EVERYTHING, "Before", OBJECTS)
        elif part.trimmed is not None:
            panels.when.value = "After"
        else:
            panels.look_at(EVERYTHING if panels.part.value == WITHOUT else panels.part.value, "Before", OBJECTS)

    def choose_next(self, choice: Any) -> str:
        """Take the next option of a choice."""
        choice.value = choice.options[(choice.options.index(choice.value) + 1) % len(choice.options)]
        return self.panels.status_text

    def _receive(self, file: Any, client: Any) -> None:
        """Take a file that was dropped or chosen; ask what splats are if a scene is open."""

        def take(as_scene: bool | None) -> None:
            work = partial(self.files.received, file.name, file.content, as_scene=as_scene)
            self.do("Reading the file", lambda: self._opened(work, client), client)

        if self.session.glance() is None or not any(file.name.lower().endswith(end) for end in formats.FORMATS):
            take(None)
        else:
            ask_whether_scene(client, file.name, take)

    def _set_up(self, name: str) -> str:
        up = self.session.set_up(controls.UPS[name])
        self._show_object()
        self._look_from_camera()
        return controls.describe_up(up)

    def change_objects(self, name: str) -> str:
        """Add an object, delete the active one, or show all."""
        session = self.session
        {"New": session.add_object, "Delete": session.remove_object, "Show all": session.show_all}[name]()
        self._show_object()
        return session.now.sentence

    def _keep(self) -> str:
        kept = self.panels.kept
        self.session.keep_object(hidden=kept["Hidden"], locked=kept["Locked"])
        return self.session.now.sentence

    def hide(self) -> str:
        """Hide the active object, or show it again."""
        self.panels.kept["Hidden"] = not self.panels.kept["Hidden"]
        return self._keep()

    def _describe(self) -> None:
        """Give the active object the name and colour that somebody has just entered, if they can be given."""

        def work() -> str:
            red, green, blue = self.panels.colour.value
            if self.panels.name.value.strip():
                self.session.describe_object(self.panels.name.value, (int(red), int(green), int(blue)))
            return self.session.now.sentence

        self.do("Naming", work)

    def _activate(self) -> str:
        self.session.activate(int(self.panels.active.value.partition(":")[0]))
        self._show_object()
        return self.session.now.sentence

    def _look_from_camera(self) -> None:
        """Let all tabs look from the first view of the scene, up being up."""
        document, up = self.session.document, self.session.now.up.direction
        eye, target = first_look(document.scene, document.cameras, up)
        self._view.show_up(up)
        for client in (None, *self._server.get_clients().values()):
            self._view.look(client, eye, target)
