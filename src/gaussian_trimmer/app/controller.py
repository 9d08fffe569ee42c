"""What controls and keys do: a worker's thread has the session do it, and all tabs see what comes of it."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer.app import panels as controls
from gaussian_trimmer.app.panels import PARTS, TINT, Panels
from gaussian_trimmer.app.presenter import Presenter
from gaussian_trimmer.app.scene_view import SceneView
from gaussian_trimmer.app.session import Cancelled, Session
from gaussian_trimmer.app.tools import Tools
from gaussian_trimmer.app.worker import Worker
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array
from gaussian_trimmer.selecting.marks import Point
from gaussian_trimmer.selecting.select import views_to_click_in

_STAGES = 12.0
"""About as many stages as a trim has, for the progress bar."""
_AXES: dict[str, Point] = {
    "+X": (1.0, 0.0, 0.0),
    "-X": (-1.0, 0.0, 0.0),
    "+Y": (0.0, 1.0, 0.0),
    "-Y": (0.0, -1.0, 0.0),
    "+Z": (0.0, 0.0, 1.0),
    "-Z": (0.0, 0.0, -1.0),
}
_DISTANCE = 3.0
"""Distance from which something is looked at, in its radius."""
_BRUSH_STEP = 1.25
_TOOL_KEYS = {
    "escape": controls.LOOK,
    "C": controls.CLICK,
    "R": controls.BOX,
    "X": controls.BOX3D,
    "B": controls.BRUSH,
}
_ENDED = "The program has ended. Nothing on this page works any more; start 'gaussian-trimmer view' again."


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

    def open(self, path: str, camera_path: str, client: Any = None) -> None:
        """Open a scene."""

        def work() -> str:
            if not path.strip():
                raise InputError("Give the path of a splat file first.")
            steps = iter(range(100))
            self.session.open(
                _path(path),
                _path(camera_path) if camera_path.strip() else None,
                lambda stage: self.panels.busy(stage.capitalize(), next(steps) / 4),
            )
            self.panels.busy("Preparing the display", 0.75)
            now, painter = self.session.now, self._presenter.painter()
            self.panels.look_at_whole()
            self.panels.show_tool(controls.LOOK)
            self.tools.begin(controls.LOOK, client)
            self.panels.show_command("")
            self.panels.folder.value = str(Path("trimmed") / now.document.path.name.split(".")[0])
            self._look_from_camera()
            self.worker.submit(self.session.warm_up)
            n = len(now.document.scene)
            thinned = f", {painter.shown:,} of them shown (see --most)" if painter.shown < n else ""
            return f"{now.document.path.name}: {n:,} Gaussians{thinned}. {now.sentence}"

        self.do("Opening", work, client)

    def stop(self) -> None:
        """End the worker, and say so in all tabs."""
        self.worker.stop()
        self.panels.busy("", 0)
        self.panels.say(_ENDED)
        for client in self._server.get_clients().values():
            client.add_notification("The program has ended", _ENDED, color="red", auto_close_seconds=None)
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
            except Cancelled:
                text = "Cancelled; everything is as it was."
            except MemoryError:
                text = "There is not enough memory for this; everything is as it was."
            except OSError as error:
                text = f"{error.strerror or error}: '{error.filename}'." if error.filename else f"{error}."
            except Exception as error:
                traceback.print_exc(file=sys.stderr)
                text = f"This is a defect of the program ({type(error).__name__}: {error}); everything is as it was."
            self.panels.busy("", 0)
            self.panels.say(text)
            if wrong:
                self._complain(text, client)

        self.worker.submit(job)

    def trim(self, client: Any) -> None:
        """Trim the active object."""
        choices = self.panels.choices
        steps = iter(range(1000))

        def work() -> str:
            sentence = self.session.trim(
                choices,
                lambda stage: self.panels.busy(f"Trimming: {stage}", min(1.0, next(steps) / _STAGES)),
                self.worker.cancelled,
            )
            self.panels.when.value = "After"
            self.panels.overlays[TINT] = self.panels.part.value == "Both"
            return sentence

        self.do("Trimming", work, client)

    def focus(self, client: Any) -> None:
        """Let a tab look at the selection, or at the scene if nothing is selected, from where it looks now."""

        def work() -> str:
            now, means = self.session.now, self.session.document.scene.means
            points = (means[now.object.selected.mask] if now.object.n_selected else means).astype(np.float64)
            centre = np.median(points, axis=0)
            radius = max(float(np.quantile(np.linalg.norm(points - centre, axis=1), 0.9)), 1e-9)
            eye = centre - _DISTANCE * radius * self.tools.viewpoint(client).camera.forward
            self._view.look(client, _point(eye), _point(centre))
            return self.panels.status_text

        self.do("Looking", work, client)

    def step(self, name: str, client: Any) -> None:
        """Undo, redo, or clear."""

        def work() -> str:
            if name == "Clear":
                self.session.clear()
                done = "Cleared."
            else:
                done = f"Undone: {self.session.undo()}." if name == "Undo" else f"Done again: {self.session.redo()}."
            self._show_object()
            return done

        self.do(name, work, client)

    def show_part(self, part: str, client: Any) -> None:
        """Show the object, the background or both: alone without a tint, which would hide what is wrong at the edge."""
        self.panels.part.value = part
        self.panels.overlays[TINT] = part == "Both"
        self._show_again(client)

    def _complain(self, text: str, client: Any) -> None:
        """Show a message in the tab that it concerns, or in all."""
        for tab in [client] if client is not None else self._server.get_clients().values():
            tab.add_notification("Not done", text, color="red", auto_close_seconds=12.0)

    def _connect(self) -> None:
        panels = self.panels
        panels.open.on_click(lambda event: self._ask_to_open(event.client))
        panels.use_cameras.on_click(lambda event: self._use_cameras(event.client))
        panels.cancel.on_click(lambda event: self.worker.cancel())
        panels.up.on_click(lambda event: self._set_up(panels.up.value, event.client))
        panels.history.on_click(lambda event: self.step(panels.history.value, event.client))
        panels.load.on_click(lambda event: self._load(event.client))
        panels.objects.on_click(lambda event: self._change_object(panels.objects.value, event.client))
        panels.active.on_change(self._activate)
        panels.trim.on_click(lambda event: self.trim(event.client))
        panels.save.on_click(lambda event: self._save(event.client))
        panels.save_all.on_click(lambda event: self._save_all(event.client))
        panels.part.on_change(lambda client: self.show_part(panels.part.value, client))
        panels.when.on_change(self._show_again)
        panels.overlays.on_change(self._show_again)
        self._server.on_client_connect(self._welcome)

    def _bind_keys(self) -> None:
        """Bind all keys, those of SuperSplat where it has a habit; Ctrl+K lists them, as the panel's last tab does."""

        def bind(label: str, key: str, act: Callable[[Any], None], modifier: str | None = None) -> None:
            command = self._server.gui.add_command(label, hotkey=key, modifier=modifier)
            command.on_trigger(lambda event: act(event.client))

        for key, tool in _TOOL_KEYS.items():
            bind(f"Tool: {tool}", key, lambda client, tool=tool: self.tools.choose(tool, client))  # type: ignore[misc]
        bind("Undo", "Z", lambda client: self.step("Undo", client), "cmd/ctrl")
        bind("Redo", "Z", lambda client: self.step("Redo", client), "cmd/ctrl+shift")
        bind("Clear the selection", "A", lambda client: self.step("Clear", client), "cmd/ctrl+shift")
        bind("Trim", "T", self.trim)
        bind("Look at the selection", "F", self.focus)
        bind("Larger brush", "pageup", lambda client: self._grow_brush(_BRUSH_STEP))
        bind("Smaller brush", "pagedown", lambda client: self._grow_brush(1 / _BRUSH_STEP))
        for key, part in zip("123", PARTS, strict=True):
            bind(f"Show: {part}", key, lambda client, part=part: self.show_part(part, client))  # type: ignore[misc]
        bind("Before / after", "space", self._turn_around)
        bind("Tint on / off", "V", self._toggle_tint)

    def _welcome(self, client: Any) -> None:
        """Tell a second tab that it is one."""
        if len(self._server.get_clients()) > 1:
            client.add_notification(
                "Open in several tabs", "All tabs show and change the same scene.", auto_close_seconds=8.0
            )

    def _show_again(self, client: Any) -> None:
        self.do("Showing", lambda: self.panels.status_text, client)

    def _show_object(self) -> None:
        """Show the active object as it is now: trimmed, or selected; where nothing is selected, the scene."""
        part = self.session.now.object
        self.panels.when.value = "After" if part.result is not None else "Before"
        if not part.n_selected:
            self.panels.look_at_whole()

    def _turn_around(self, client: Any) -> None:
        self.panels.when.value = "Before" if self.panels.when.value == "After" else "After"
        self._show_again(client)

    def _toggle_tint(self, client: Any) -> None:
        self.panels.overlays[TINT] = not self.panels.overlays[TINT]
        self._show_again(client)

    def _grow_brush(self, factor: float) -> None:
        brush = self.panels.brush
        brush.value = min(max(brush.value * factor, brush.min), brush.max)

    def _ask_to_open(self, client: Any) -> None:
        """Open what the panel names; if marks would be lost, ask first."""
        panels, now = self.panels, self.session.glance()
        if now is None or not now.has_work:
            return self.open(panels.path.value, panels.camera_path.value, client)
        question = client.gui.add_modal("Open another scene?")

        def answer(accepted: bool) -> None:
            question.close()
            if accepted:
                self.open(panels.path.value, panels.camera_path.value, client)

        with question:
            client.gui.add_markdown(
                "Everything that you have marked and trimmed in this scene will be lost, and cannot be undone. To only "
                "add cameras, choose *Use these cameras with the open scene*, which keeps your marks."
            )
            client.gui.add_button("Open and lose the marks", color="red").on_click(lambda event: answer(True))
            client.gui.add_button("Keep working here").on_click(lambda event: answer(False))
        return None

    def _use_cameras(self, client: Any) -> None:
        path = self.panels.camera_path.value

        def work() -> str:
            if not path.strip():
                raise InputError("Give the path of the cameras first.")
            self.session.use_cameras(_path(path))
            self._show_object()
            return "The scene has these cameras now; your marks are kept, and understood with them."

        self.do("Reading the cameras", work, client)

    def _set_up(self, name: str, client: Any) -> None:
        def work() -> str:
            up = self.session.set_up(_AXES.get(name))
            self._show_object()
            self._look_from_camera()
            return controls.describe_up(up)

        self.do("Turning", work, client)

    def _load(self, client: Any) -> None:
        path = self.panels.selection_path.value

        def work() -> str:
            if not path.strip():
                raise InputError("Give the path of a selection file first.")
            how = self.session.load(_path(path))
            self.panels.when.value, self.panels.overlays[TINT] = "Before", True
            return f"{self.session.now.object.n_selected:,} Gaussians selected: {how}."

        self.do("Loading", work, client)

    def _change_object(self, name: str, client: Any) -> None:
        def work() -> str:
            if name == "New":
                added = self.session.add_object().name
                self._show_object()
                return f"{added}: mark it."
            if name == "Delete":
                self.session.remove_object()
                self._show_object()
                return self.session.now.sentence
            self.session.rename(self.panels.name.value)
            red, green, blue = self.panels.colour.value
            self.session.recolour((int(red), int(green), int(blue)))
            return self.session.now.sentence

        self.do(name, work, client)

    def _activate(self, client: Any) -> None:
        number = int(self.panels.active.value.partition(":")[0])

        def work() -> str:
            self.session.activate(number)
            self._show_object()
            return self.session.now.sentence

        self.do("Choosing", work, client)

    def _save(self, client: Any) -> None:
        folder, format, overwrite = self._target()

        def work() -> str:
            self.panels.show_command(self.session.save(folder, format, overwrite=overwrite))
            return f"Saved in {folder}."

        self.do("Saving", work, client)

    def _save_all(self, client: Any) -> None:
        folder, format, overwrite = self._target()

        def work() -> str:
            text = self.session.save_objects(
                folder,
                format,
                overwrite=overwrite,
                progress=lambda stage: self.panels.busy(f"Trimming {stage}", 0.5),
                cancelled=self.worker.cancelled,
            )
            self.panels.show_command("")
            return f"{text} saved in {folder}."

        self.do("Saving", work, client)

    def _target(self) -> tuple[Path, str | None, bool]:
        """Folder, format and whether to replace earlier results, as the panel has them."""
        panels = self.panels
        format = None if panels.format.value == controls.AS_SCENE else panels.format.value
        return _path(panels.folder.value.strip() or "trimmed").absolute(), format, panels.existing.value == "Replace"

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
            self._view.look(client, _point(camera.centre), _point(camera.centre + depth * camera.forward))


def _path(text: str) -> Path:
    return Path(text.strip()).expanduser()


def _point(values: Float64Array) -> Point:
    x, y, z = values.tolist()
    return x, y, z
