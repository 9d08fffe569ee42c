"""Jobs: a worker's thread does the work of the app, one thing after the other, and all tabs show what it made."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer import sample
from gaussian_trimmer.app import edits
from gaussian_trimmer.app.display import Painter
from gaussian_trimmer.app.files import DOWNLOADS, Files
from gaussian_trimmer.app.page import BACKDROPS, PROGRAM_ENDED, WELCOME, Page, Panels
from gaussian_trimmer.app.scene_view import SceneView
from gaussian_trimmer.app.session import Cancelled, Session
from gaussian_trimmer.app.snapshots import Progress
from gaussian_trimmer.app.viewpoints import Event, Frame, Showing, compared, due_after, showing_after
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError

Job = Callable[[], None]


class Worker:
    """Does one job after the other, in the order in which they were submitted. One that fails is printed."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, "gaussian-trimmer-app")
        self.busy, self._ended, self._cancelled = False, False, False
        self.gave_way = False
        """Whether the present job was asked to stop by the next one."""
        self._submitted, self._yielding = 0, False

    def submit(self, job: Job) -> None:
        """Do a job after those that were submitted before, which stops one that gives way; none after the end."""
        if self._ended:
            return
        self._submitted += 1
        if self._yielding:
            self.gave_way = True
        self._thread.submit(self._do, job)

    def submit_if_idle(self, job: Job) -> None:
        """Do a job that gives way: it is dropped if another one is submitted before it begins, or cancelled after."""
        if self._ended:
            return
        expected = self._submitted

        def unless_others_came() -> None:
            if self._submitted != expected:
                return
            self._yielding = True
            try:
                job()
            finally:
                self._yielding = False

        self._thread.submit(self._do, unless_others_came)

    def cancel(self) -> None:
        """Ask the present job to stop; later ones are done."""
        self._cancelled = self.busy

    def cancelled(self) -> bool:
        """Tell whether the present job was asked to stop."""
        return self._cancelled or self.gave_way

    def stop(self) -> None:
        """Let the present job be the last, ask it to stop, and wait for that."""
        self._ended = True
        self.cancel()
        self._thread.shutdown(cancel_futures=True)

    def _do(self, job: Job) -> None:
        self._cancelled, self.gave_way, self.busy = False, False, True
        try:
            job()
        except Exception:
            traceback.print_exc()
        finally:
            self.busy = False


_EYE_STEP, _EYE_TURN = 0.1, 0.1
"""How far an eye moves, in the viewer's units, or turns, in radians, before the scene is drawn anew for it."""


class Presenter:
    """Shows the state of a session. Used by the worker's thread alone."""

    def __init__(self, session: Session, panels: Panels, view: SceneView, page: Page, most: int) -> None:
        self._session, self._panels, self._view, self._page = session, panels, view, page
        self._most = most
        self._painter: Painter | None = None
        self._eye: Camera | None = None
        self._shown: dict[str, object] = {}
        self._other: Showing | None = None
        """What is seen while it is compared with what is shown."""

    def refresh(self) -> None:
        """Show the present state, if a scene is open."""
        now = self._session.glance()
        if self._is_new("backdrop", self._panels.backdrop.value):
            self._view.show_backdrop(BACKDROPS[self._panels.backdrop.value])
        if now is None:
            return
        painter, controls = self.painter(), self._panels
        showing = self._other or controls.showing
        if self._is_new("splats", (now, showing, self._eye)):
            self._view.show(painter.paint(now, showing, self._eye))
        if self._is_new("up", now.up):
            self._view.show_up(now.up.direction)
        views = now.object.fresh if controls.views.value else None
        if self._is_new("views", views):
            self._view.show_views(views)
        if self._is_new("state", now):  # otherwise, what somebody is typing is kept
            controls.refresh(now, self._idle())

    def compare(self, *, on: bool) -> None:
        """Show another state in place of what is shown, or no longer.

        Raises:
            InputError: the object has not been cut out.
        """
        if on and self._session.now.object.result is None:
            raise InputError("There is nothing to compare yet: cut the object out first.")
        self._other, name = compared(self._panels.showing) if on else (None, "")
        self._page.show(compared=name)

    def look_from(self, eye: Camera) -> None:
        """Show the scene as it looks from an eye, and what is near it in full, if that differs from what is shown."""
        if self._session.glance() is None or not self.painter().depends_on_eye:
            return
        last = self._eye
        if last is None or _differ(last, eye, self.painter().frame):
            self._eye = eye
            self.refresh()

    def painter(self) -> Painter:
        """Return what draws the open scene; made anew for another scene."""
        scene = self._session.document.scene
        if self._painter is None or self._painter.scene is not scene:
            self._painter, self._eye = Painter(scene, self._most), None
            self._view.frame = self._painter.frame
        return self._painter

    def _idle(self) -> list[str]:
        """Return the actions that can do nothing in this state."""
        part, (back, forth) = self._session.now.object, self._session.can_step
        idle = {
            "Undo": not back,
            "Redo": not forth,
            **dict.fromkeys(("Cut out", "Grow", "Shrink", "Clear", "Look at the object"), not part.n_selected),
            **dict.fromkeys((*(f"Download: {what}" for what in DOWNLOADS), "Save in this folder"), part.fresh is None),
        }
        return [name for name, cannot in idle.items() if cannot]

    def _is_new(self, what: str, state: object) -> bool:
        """Tell whether something is not in this state yet; it is from now on."""
        if self._shown.get(what) == state:
            return False
        self._shown[what] = state
        return True


def _differ(one: Camera, other: Camera, frame: Frame) -> bool:
    """Tell whether two eyes are so far apart, or look so differently, that the scene looks different."""
    moved = float(np.linalg.norm(one.centre - other.centre)) * frame.scale
    return moved > _EYE_STEP or float(one.forward @ other.forward) < np.cos(_EYE_TURN)


STAGES_OF_A_TRIM = 12
"""About as many stages as a trim has, for the progress bar."""
_REST_SECONDS = 0.4
"""How long a view has to rest until it is refined."""


class Jobs:
    """Session, controls and 3D view of a viser server, and the thread in which everything is done that takes time."""

    def __init__(self, server: Any, most: int, state: Path, offered: tuple[str, str]) -> None:
        """Make them; the paths of scene and cameras are those that are offered at first."""
        self.server, self.worker = server, Worker()
        self.session = Session(self.worker.cancelled)
        self.files = Files(self.session, state)
        self.page = Page(server.gui)
        self.upload = server.gui.add_upload_button("Choose a file")
        """Not to be seen: the page's own buttons press it."""
        self.panels = Panels(self.page, *offered)
        self.view = SceneView(server)
        self.presenter = Presenter(self.session, self.panels, self.view, self.page, most)
        self.due = False
        """Whether what a mark has corrected is to be cut out again."""
        self._rest: threading.Timer | None = None
        name = "Open the sample" if offered[0] == str(sample.SCENE) else Path(offered[0]).name
        self.page.show(starts=[(name, *offered), *self.files.recent()], said=WELCOME)
        self.presenter.refresh()
        server.on_client_connect(self._welcome)

    def do(self, name: str, work: Callable[[], str | None], event: Event | None = None) -> None:
        """Have something done in the worker's thread, show its sentence, if any, and what an event then shows."""

        def job() -> None:
            self._job(name, work, event)
            self._follow()

        self.worker.submit(job)

    def stop(self) -> None:
        """End the worker, and say so in all tabs."""
        if self._rest is not None:
            self._rest.cancel()
        self.worker.stop()
        self.panels.say(PROGRAM_ENDED, wrong=True)
        self.server.flush()

    def _job(self, name: str, work: Callable[[], str | None], event: Event | None) -> None:
        """Do some work, and show its sentence and, if it succeeds, what is to be seen after an event."""
        self.panels.busy(name, 0)
        self.presenter.compare(on=False)
        text, wrong = "", True
        try:
            try:
                text = work() or self.panels.status_text
                if event is not None:
                    now = self.session.now
                    self.panels.showing = showing_after(event, now, self.panels.showing)
                    self.due = due_after(event, now, self.panels.showing, self.due)
            finally:
                self.presenter.refresh()
            self.files.keep()
            wrong = False
        except InputError as error:
            text = str(error)
        except Exception as error:
            traceback.print_exc(file=sys.stderr)
            text = f"This is a defect of the program ({type(error).__name__}: {error}); everything is as it was."
        self.panels.say(text, wrong=wrong)

    def _follow(self) -> None:
        """Cut out again what is due; whatever else is done goes first, and then it is still due."""
        if not self.due:
            return

        def correct() -> str:
            stages, said = self.stages(STAGES_OF_A_TRIM, "Cutting out again: "), self.panels.status_text
            trim, choices = edits.trim_object, self.panels.choices
            try:
                return f"{said} {self.session.do(trim, choices, stages, joined=True, again=True)}"
            except Cancelled:
                return self.session.now.sentence
            finally:
                if not self.worker.gave_way:  # otherwise it is tried once
                    self.due = False

        self.worker.submit_if_idle(partial(self._job, "Cutting out again", correct, None))

    def _welcome(self, client: Any) -> None:
        """Tell a second tab that it is one, and refine what a tab sees when its view rests."""
        client.camera.on_update(lambda camera: self._moved(client))
        if len(self.server.get_clients()) > 1:
            text = "All tabs show and change the same scene."
            client.add_notification("Open in several tabs", text, auto_close_seconds=8.0)

    def _moved(self, client: Any) -> None:
        """Refine what a tab sees once its view rests."""
        if self._rest is not None:
            self._rest.cancel()

        def look() -> None:
            self.presenter.look_from(self.view.viewpoint(client).camera)

        self._rest = threading.Timer(_REST_SECONDS, lambda: self.worker.submit_if_idle(look))
        self._rest.daemon = True
        self._rest.start()

    def stages(self, number: int, prefix: str) -> Progress:
        """Return what to call at each of about so many stages, to show the progress and to stop when asked."""
        steps = iter(range(1000))

        def stage(name: str) -> None:
            if self.worker.cancelled():
                raise Cancelled
            self.panels.busy((prefix + name).capitalize(), min(1.0, next(steps) / number))

        return stage
