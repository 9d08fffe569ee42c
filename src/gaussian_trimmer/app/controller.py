"""What controls and keys do: a worker's thread has the session do it, and all tabs see what comes of it."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer.app import panels as controls
from gaussian_trimmer.app.panels import PARTS, TINT, Panels
from gaussian_trimmer.app.presenter import Presenter
from gaussian_trimmer.app.scene_view import SceneView
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.app.tools import Tools
from gaussian_trimmer.app.worker import Worker
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.selecting.marks import Point, point_of
from gaussian_trimmer.selecting.view_lookup import views_to_click_in

_STAGES_OF_A_TRIM = 12
"""About as many stages as a trim has, for the progress bar."""
_AXIS_DIRECTIONS: dict[str, Point] = {
    "+X": (1.0, 0.0, 0.0),
    "-X": (-1.0, 0.0, 0.0),
    "+Y": (0.0, 1.0, 0.0),
    "-Y": (0.0, -1.0, 0.0),
    "+Z": (0.0, 0.0, 1.0),
    "-Z": (0.0, 0.0, -1.0),
}
_VIEW_DISTANCE_RADII = 3.0
"""Distance from which something is looked at, in its radius."""
_BRUSH_STEP = 1.25
_TOOL_KEYS = {
    "escape": controls.LOOK,
    "C": controls.CLICK,
    "R": controls.BOX,
    "X": controls.BOX3D,
    "B": controls.BRUSH,
}
_PROGRAM_ENDED = "The program has ended. Nothing on this page works any more; start 'gaussian-trimmer view' again."


class Controller:
    """Connects controls, session and 3D view. Everything that takes time is done in one worker's thread."""

    def __init__(self, server: Any, session: Session, most: int, path: str, camera_path: str) -> None:
        self._server, self.session = server, session
        self.panels = Panels(server.gui, path, camera_path)
        self._view = SceneView(server)
        self._presenter = Presenter(session, self.panels, self._view, most)
        self.worker = Worker()
        self.tools = Tools(server, session, self.panels, self._view, self.do)
        self._connect()
        self._bind_keys()

    def open(self, client: Any = None) -> str:
        """Open the scene that the panel names, with its cameras; returns what it is."""
        panels = self.panels
        if not panels.path.value.strip():
            raise InputError("Give the path of a splat file first.")
        cameras = _path(panels.camera_path.value) if panels.camera_path.value.strip() else None
        self.session.open(_path(panels.path.value), cameras, self._stages(4, ""))
        panels.busy("Preparing the display", 0.75)
        now, painter = self.session.now, self._presenter.painter()
        panels.start_afresh(now.document.path)
        self.tools.begin(controls.LOOK, client)
        self._look_from_camera()
        self.worker.submit(self.session.warm_up)
        n = len(now.document.scene)
        thinned = f", {painter.shown:,} of them shown (see --max-shown)" if painter.shown < n else ""
        return f"{now.document.path.name}: {n:,} Gaussians{thinned}. {now.sentence}"

    def stop(self) -> None:
        """End the worker, and say so in all tabs."""
        self.worker.stop()
        self.panels.busy("", 0)
        self.panels.say(_PROGRAM_ENDED)
        for client in self._server.get_clients().values():
            client.add_notification("The program has ended", _PROGRAM_ENDED, color="red", auto_close_seconds=None)
        self._server.flush()

    def do(self, name: str, work: Callable[[], str], client: Any = None) -> None:
        """Have something done in the worker's thread, and show what comes of it."""

        def job() -> None:
            self.panels.busy(name, 0)
            text, wrong = "", True
            try:
                try:
                    text = work()
                finally:
                    self._presenter.refresh()
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

        self.worker.submit(job)

    def trim(self) -> str:
        """Trim the active object; returns the result in a sentence."""
        panels = self.panels
        sentence = self.session.trim(
            panels.choices, self._stages(_STAGES_OF_A_TRIM, "Trimming: "), self.worker.cancelled
        )
        panels.when.value, panels.overlays[TINT] = "After", panels.part.value == "Both"
        return sentence

    def focus(self, client: Any) -> str:
        """Let a tab look at the selection, or at the scene if nothing is selected, from where it looks now."""
        now, means = self.session.now, self.session.document.scene.means
        points = (means[now.object.selected.mask] if now.object.n_selected else means).astype(np.float64)
        centre = np.median(points, axis=0)
        radius = max(float(np.quantile(np.linalg.norm(points - centre, axis=1), 0.9)), 1e-9)
        eye = centre - _VIEW_DISTANCE_RADII * radius * self.tools.viewpoint(client).camera.forward
        self._view.look(client, point_of(eye), point_of(centre))
        return self.panels.status_text

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
        """Show the object, the background or both: alone without a tint, which would hide what is wrong at the edge."""
        self.panels.part.value = part
        self.panels.overlays[TINT] = part == "Both"
        return self.panels.status_text

    def _complain(self, text: str, client: Any) -> None:
        """Show a message in the tab that it concerns, or in all."""
        for tab in [client] if client is not None else self._server.get_clients().values():
            tab.add_notification("Not done", text, color="red", auto_close_seconds=12.0)

    def _connect(self) -> None:
        panels = self.panels

        def connect(control: Any, name: str, work: Callable[[], str]) -> None:
            control.on_click(lambda event: self.do(name, work, event.client))

        connect(panels.use_cameras, "Reading the cameras", self._use_cameras)
        connect(panels.up, "Turning", lambda: self._set_up(panels.up.value))
        connect(panels.history, "Stepping", lambda: self.step(panels.history.value))
        connect(panels.load, "Loading", self._load)
        connect(panels.objects, "Changing", lambda: self._change_object(panels.objects.value))
        connect(panels.active, "Choosing", self._activate)
        connect(panels.trim, "Trimming", self.trim)
        connect(panels.save, "Saving", self._save)
        connect(panels.save_all, "Saving", self._save_all)
        connect(panels.part, "Showing", lambda: self.show_part(panels.part.value))
        connect(panels.when, "Showing", lambda: panels.status_text)
        connect(panels.overlays, "Showing", lambda: panels.status_text)
        panels.open.on_click(lambda event: self._ask_to_open(event.client))
        panels.cancel.on_click(lambda event: self.worker.cancel())
        self._server.on_client_connect(self._welcome)

    def _bind_keys(self) -> None:
        """Bind all keys, those of SuperSplat where it has a habit; Ctrl+K lists them, as the panel's last tab does."""

        def bind(label: str, key: str, work: Callable[[], str], modifier: str | None = None) -> None:
            command = self._server.gui.add_command(label, hotkey=key, modifier=modifier)
            command.on_trigger(lambda event: self.do(label, work, event.client))

        for key, tool in _TOOL_KEYS.items():
            command = self._server.gui.add_command(f"Tool: {tool}", hotkey=key)
            command.on_trigger(lambda event, tool=tool: self.tools.choose(tool, event.client))
        bind("Undo", "Z", lambda: self.step("Undo"), "cmd/ctrl")
        bind("Redo", "Z", lambda: self.step("Redo"), "cmd/ctrl+shift")
        bind("Clear the selection", "A", lambda: self.step("Clear"), "cmd/ctrl+shift")
        bind("Trim", "T", self.trim)
        focus = self._server.gui.add_command("Look at the selection", hotkey="F")
        focus.on_trigger(lambda event: self.do("Looking", lambda: self.focus(event.client), event.client))
        bind("Larger brush", "pageup", lambda: self._grow_brush(_BRUSH_STEP))
        bind("Smaller brush", "pagedown", lambda: self._grow_brush(1 / _BRUSH_STEP))
        for key, part in zip("123", PARTS, strict=True):
            bind(f"Show: {part}", key, partial(self.show_part, part))
        bind("Before / after", "space", self._turn_around)
        bind("Tint on / off", "V", self._toggle_tint)

    def _welcome(self, client: Any) -> None:
        """Tell a second tab that it is one."""
        if len(self._server.get_clients()) > 1:
            text = "All tabs show and change the same scene."
            client.add_notification("Open in several tabs", text, auto_close_seconds=8.0)

    def _stages(self, number: int, prefix: str) -> Callable[[str], None]:
        """What to call at each of about so many stages, to show the progress."""
        steps = iter(range(1000))
        return lambda stage: self.panels.busy((prefix + stage).capitalize(), min(1.0, next(steps) / number))

    def _show_object(self) -> None:
        """Show the active object as it is now: trimmed, or selected; where nothing is selected, the scene."""
        part = self.session.now.object
        self.panels.when.value = "After" if part.result is not None else "Before"
        if not part.n_selected:
            self.panels.look_at_whole()

    def _turn_around(self) -> str:
        self.panels.when.value = "Before" if self.panels.when.value == "After" else "After"
        return self.panels.status_text

    def _toggle_tint(self) -> str:
        self.panels.overlays[TINT] = not self.panels.overlays[TINT]
        return self.panels.status_text

    def _grow_brush(self, factor: float) -> str:
        brush = self.panels.brush
        brush.value = min(max(brush.value * factor, brush.min), brush.max)
        return self.panels.status_text

    def _ask_to_open(self, client: Any) -> None:
        """Open what the panel names; if marks would be lost, ask first."""
        now = self.session.glance()
        if now is None or not now.has_work:
            self.do("Opening", lambda: self.open(client), client)
            return
        question = client.gui.add_modal("Open another scene?")

        def answer(accepted: bool) -> None:
            question.close()
            if accepted:
                self.do("Opening", lambda: self.open(client), client)

        with question:
            client.gui.add_markdown(controls.ABOUT_OPENING)
            client.gui.add_button("Open and lose the marks", color="red").on_click(lambda event: answer(True))
            client.gui.add_button("Keep working here").on_click(lambda event: answer(False))

    def _use_cameras(self) -> str:
        if not self.panels.camera_path.value.strip():
            raise InputError("Give the path of the cameras first.")
        self.session.use_cameras(_path(self.panels.camera_path.value))
        self._show_object()
        return "The scene has these cameras now; your marks are kept, and understood with them."

    def _set_up(self, name: str) -> str:
        up = self.session.set_up(_AXIS_DIRECTIONS.get(name))
        self._show_object()
        self._look_from_camera()
        return controls.describe_up(up)

    def _load(self) -> str:
        if not self.panels.selection_path.value.strip():
            raise InputError("Give the path of a selection file first.")
        how = self.session.load(_path(self.panels.selection_path.value))
        self.panels.when.value, self.panels.overlays[TINT] = "Before", True
        return f"{self.session.now.object.n_selected:,} Gaussians selected: {how}."

    def _change_object(self, name: str) -> str:
        if name == "New":
            self.session.add_object()
        elif name == "Delete":
            self.session.remove_object()
        else:
            red, green, blue = self.panels.colour.value
            self.session.describe_object(self.panels.name.value, (int(red), int(green), int(blue)))
            return self.session.now.sentence
        self._show_object()
        return self.session.now.sentence

    def _activate(self) -> str:
        self.session.activate(int(self.panels.active.value.partition(":")[0]))
        self._show_object()
        return self.session.now.sentence

    def _save(self) -> str:
        target = self.panels.target
        self.panels.show_command(self.session.save(target))
        return f"Saved in {target.folder}."

    def _save_all(self) -> str:
        target, stages = self.panels.target, self._stages(2 * len(self.session.now.objects), "Trimming ")
        saved = self.session.save_objects(target, stages, self.worker.cancelled)
        self.panels.show_command("")
        return f"{saved} saved in {target.folder}."

    def _look_from_camera(self) -> None:
        """Let all tabs look from the first view of the scene, up being up."""
        document, up = self.session.document, self.session.now.up.direction
        if document.cameras is not None:
            camera = document.cameras.cameras[0]
        else:
            camera = views_to_click_in(document.scene, None, up)[0].camera
        ahead = (document.scene.means - camera.centre) @ camera.forward
        depth = float(np.median(ahead[ahead > 0])) if (ahead > 0).any() else 1.0
        self._view.show_up(up)
        for client in (None, *self._server.get_clients().values()):
            self._view.look(client, point_of(camera.centre), point_of(camera.centre + depth * camera.forward))


def _path(text: str) -> Path:
    return Path(text.strip()).expanduser()
