"""Jobs: a worker's thread does the work of the app, and all tabs show what it made."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from gaussian_trimmer import sample
from gaussian_trimmer.app import edits
from gaussian_trimmer.app.documents import Progress
from gaussian_trimmer.app.files import Files
from gaussian_trimmer.app.page import Page
from gaussian_trimmer.app.panels import PROGRAM_ENDED, REPLACE, WELCOME, Panels
from gaussian_trimmer.app.presenter import Presenter
from gaussian_trimmer.app.scene_view import SceneView
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.app.showing import Due, Event, due_after, showing_after
from gaussian_trimmer.app.worker import Cancelled, Worker
from gaussian_trimmer.errors import InputError, OutputExistsError

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
        self.due = Due.NOTHING
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
        except OutputExistsError as error:
            text = f"'{error.folder}' is not empty; choose another folder, or '{REPLACE}' beside 'Earlier results'."
        except InputError as error:
            text = str(error)
        except Exception as error:
            traceback.print_exc(file=sys.stderr)
            text = f"This is a defect of the program ({type(error).__name__}: {error}); everything is as it was."
        self.panels.say(text, wrong=wrong)

    def _follow(self) -> None:
        """Cut out again what is due; whatever else is done goes first, and then it is still due."""
        if self.due is Due.NOTHING:
            return

        def work() -> str:
            stages, said = self.stages(STAGES_OF_A_TRIM, "Cutting out again: "), self.panels.status_text
            try:
                if self.due is Due.WORK_OF_LAST_TIME:
                    return self.session.do(edits.cut_out_wanted, stages, joined=True)
                return f"{said} {self.session.do(edits.cut_out, self.panels.choices, stages, joined=True, again=True)}"
            except Cancelled:
                return self.session.now.sentence
            finally:
                if not self.worker.gave_way:  # otherwise it is tried once
                    self.due = Due.NOTHING

        self.worker.submit_if_idle(partial(self._job, "Cutting out again", work, None))

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
