"""What happens when a control is used: the session does it in the worker's thread, and all tabs see what came of it."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer.app import panels as controls
from gaussian_trimmer.app.keys import bind_keys
from gaussian_trimmer.app.panels import Panels
from gaussian_trimmer.app.presenter import Presenter
from gaussian_trimmer.app.scene_view import SceneView
from gaussian_trimmer.app.session import Cancelled, Session
from gaussian_trimmer.app.tools import Tools
from gaussian_trimmer.app.worker import Worker
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.selecting.marks import Point
from gaussian_trimmer.selecting.view_lookup import views_to_click_in

_STAGES = 12.0
"""About as many stages as a trim has, for the progress bar."""
_AXES: dict[str, Point] = {
    "+X": (1.0, 0.0, 0.0), "-X": (-1.0, 0.0, 0.0), "+Y": (0.0, 1.0, 0.0), "-Y": (0.0, -1.0, 0.0),
    "+Z": (0.0, 0.0, 1.0), "-Z": (0.0, 0.0, -1.0),
}  # fmt: skip
_AWAY = 3.0
"""Distance from which an object is looked at, in its radius."""


class Controller:
    """Connects controls, session and 3D view. All that takes time is done in one worker's thread."""

    def __init__(self, server: Any, session: Session, most: int, path: str, camera_path: str) -> None:
        self._server, self.session = server, session
        self.panels = Panels(server.gui, path, camera_path)
        self._view = SceneView(server)
        self._presenter = Presenter(session, self.panels, self._view, most)
        self.worker = Worker(lambda name, error: traceback.print_exception(error))
        self.tools = Tools(server, session, self.panels, self._view, self.do)
        self._connect()

    def open(self, path: str, camera_path: str, client: Any = None) -> None:
        """Open a scene."""

        def work() -> str:
            if not path.strip():
                raise InputError("Give the path of a splat file first.")
            steps = iter(range(100))
            self.session.open(
                Path(path.strip()).expanduser(),
                Path(camera_path.strip()).expanduser() if camera_path.strip() else None,
                lambda stage: self.panels.busy(stage.capitalize(), next(steps) / 4),
            )
            self.panels.busy("Preparing the display", 0.75)
            document = self.session.document
            painter = self._presenter.painter()
            self.panels.when.value, self.panels.summary.content = "Before", ""
            self.panels.folder.value = str(Path("trimmed") / document.path.name.split(".")[0])
            self._look_from_camera()
            self.worker.submit("warm up", self.session.warm_up)
            n, shown = len(document.scene), painter.shown
            thinned = f", {shown:,} of them shown" if shown < n else ""
            return f"{document.path.name}: {n:,} Gaussians{thinned}."

        self.do("Opening", work, client)

    def stop(self) -> None:
        """End the worker."""
        self.worker.stop()

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

        self.worker.submit(name, job)

    def _complain(self, text: str, client: Any) -> None:
        """Show a message in the tab that it concerns, or in all."""
        for tab in [client] if client is not None else self._server.get_clients().values():
            tab.add_notification("Not done", text, color="red", auto_close_seconds=12.0)

    def _connect(self) -> None:
        panels = self.panels
        panels.open.on_click(lambda event: self.open(panels.path.value, panels.camera_path.value, event.client))
        panels.cancel.on_click(lambda event: self.worker.cancel())
        panels.up.on_click(lambda event: self._set_up(panels.up.value, event.client))
        panels.history.on_click(lambda event: self.step(panels.history.value, event.client))
        panels.load.on_click(lambda event: self._load(event.client))
        panels.objects.on_click(lambda event: self._change_object(panels.objects.value, event.client))
        panels.active.on_update(lambda event: self._activate(event.client))
        panels.trim.on_click(lambda event: self.trim(event.client))
        panels.save.on_click(lambda event: self._save(event.client))
        panels.save_all.on_click(lambda event: self._save_all(event.client))
        for control in (
            panels.part, panels.when, panels.colours, panels.straddlers, panels.unchecked, panels.views,
            panels.up_shown,
        ):  # fmt: skip
            control.on_update(lambda event: self.show_again(event.client))
        self._server.on_client_connect(self._welcome)
        bind_keys(self._server.gui, self)

    def _welcome(self, client: Any) -> None:
        """Tell a second tab that it is one."""
        if len(self._server.get_clients()) > 1:
            client.add_notification(
                "Open in several tabs", "All tabs show and change the same scene.", auto_close_seconds=8.0
            )  # fmt: skip

    def show_again(self, client: Any) -> None:
        """Show what the panel now asks for, after a tab has changed it."""
        if client is not None:
            self.do("Showing", lambda: self.panels.status_text, client)

    def _set_up(self, name: str, client: Any) -> None:
        def work() -> str:
            up = self.session.set_up(_AXES.get(name))
            return f"Up is {' '.join(f'{value:.3f}' for value in up.direction)} ({up.source})."

        self.do("Turning", work, client)

    def step(self, name: str, client: Any) -> None:
        """Undo, redo, or clear."""

        def work() -> str:
            if name == "Clear":
                self.session.clear()
                return "Cleared."
            done = self.session.undo() if name == "Undo" else self.session.redo()
            self.panels.when.value = "After" if self.session.now.object.result is not None else "Before"
            return f"{'Undone' if name == 'Undo' else 'Done again'}: {done}."

        self.do(name, work, client)

    def _load(self, client: Any) -> None:
        path = self.panels.selection_path.value.strip()

        def work() -> str:
            if not path:
                raise InputError("Give the path of a selection file first.")
            how = self.session.load(Path(path).expanduser())
            self.panels.when.value = "Before"
            return f"{self.session.now.object.n_selected:,} Gaussians selected: {how}."

        self.do("Loading", work, client)

    def _change_object(self, name: str, client: Any) -> None:
        def work() -> str:
            if name == "New":
                return f"{self.session.add_object().name}: mark it."
            if name == "Delete":
                self.session.remove_object()
                return "Deleted."
            self.session.rename(self.panels.name.value)
            red, green, blue = self.panels.colour.value
            self.session.recolour((int(red), int(green), int(blue)))
            return "Applied."

        self.do(name, work, client)

    def _activate(self, client: Any) -> None:
        if client is None:
            return
        number = int(self.panels.active.value.partition(":")[0])

        def work() -> str:
            self.session.activate(number)
            return f"Marks go to {self.session.now.object.name}."

        self.do("Choosing", work, client)

    def trim(self, client: Any) -> None:
        """Trim the active object."""
        choices = self.panels.choices
        steps = iter(range(1000))

        def work() -> str:
            text = self.session.trim(
                choices, lambda stage: self.panels.busy(f"Trimming: {stage}", min(1.0, next(steps) / _STAGES)),
                self.worker.cancelled,
            )  # fmt: skip
            self.panels.when.value = "After"
            self.panels.summary.content = controls.escaped(text)
            return text

        self.do("Trimming", work, client)

    def _save(self, client: Any) -> None:
        folder, format, overwrite = self._target()

        def work() -> str:
            command = self.session.save(folder, format, overwrite=overwrite)
            self.panels.command.content = f"The same by command:\n\n```\n{command}\n```"
            return f"Saved in {folder.absolute()}."

        self.do("Saving", work, client)

    def _save_all(self, client: Any) -> None:
        folder, format, overwrite = self._target()

        def work() -> str:
            text = self.session.save_objects(
                folder, format, overwrite=overwrite, progress=lambda stage: self.panels.busy(f"Trimming {stage}", 0.5),
                cancelled=self.worker.cancelled,
            )  # fmt: skip
            return f"{text} saved in {folder.absolute()}."

        self.do("Saving", work, client)

    def _target(self) -> tuple[Path, str | None, bool]:
        panels = self.panels
        format = None if panels.format.value == controls.AS_SCENE else panels.format.value
        return Path(panels.folder.value.strip() or "trimmed").expanduser(), format, panels.overwrite.value

    def _look_from_camera(self) -> None:
        """Let all tabs look from the first view of the scene."""
        document, up = self.session.document, self.session.now.up.direction
        camera = (
            document.cameras.cameras[0] if document.cameras is not None
            else views_to_click_in(document.scene, None, up)[0].camera
        )  # fmt: skip
        ahead = (document.scene.means - camera.centre) @ camera.forward
        depth = float(np.median(ahead[ahead > 0])) if (ahead > 0).any() else 1.0
        eye, target = camera.centre.tolist(), (camera.centre + depth * camera.forward).tolist()
        self._view.show_up(up, self.panels.up_shown.value)
        for client in (None, *self._server.get_clients().values()):
            self._view.look(client, (eye[0], eye[1], eye[2]), (target[0], target[1], target[2]), up)

    def focus(self, client: Any) -> None:
        """Let a tab look at the selection from where it looks now."""

        def work() -> str:
            now, scene = self.session.now, self.session.document.scene
            if not now.object.n_selected:
                raise InputError("Nothing is selected to look at.")
            points = scene.means[now.object.selected.mask].astype(np.float64)
            centre = np.median(points, axis=0)
            radius = float(np.quantile(np.linalg.norm(points - centre, axis=1), 0.9))
            backward = -self.tools.viewpoint(client).camera.forward
            eye = (centre + _AWAY * max(radius, 1e-9) * backward).tolist()
            target = centre.tolist()
            self._view.look(
                client, (eye[0], eye[1], eye[2]), (target[0], target[1], target[2]), now.up.direction
            )  # fmt: skip
            return self.panels.status_text

        self.do("Looking", work, client)
