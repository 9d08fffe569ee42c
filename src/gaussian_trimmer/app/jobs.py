"""Jobs: a worker's thread does the work of the app, one thing after the other, and all tabs show what it made."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from gaussian_trimmer import sample
from gaussian_trimmer.app import edits
from gaussian_trimmer.app.files import DOWNLOADS, Files
from gaussian_trimmer.app.page import Page
from gaussian_trimmer.app.panels import PLACING, PROGRAM_ENDED, WELCOME, Panels
from gaussian_trimmer.app.scene_view import SceneView
from gaussian_trimmer.app.session import Cancelled, Session
from gaussian_trimmer.app.snapshots import Progress, Snapshot
from gaussian_trimmer.app.viewpoints import Event, due_after, showing_after
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


TAKE_OUT = "Take it out of the scene"
STAGES_OF_A_TRIM = 12
"""About as many stages as a trim has, for the progress bar."""


class Jobs:
    """Session, controls and 3D view, and the thread in which everything is done that takes time."""

    def __init__(self, most: int, state: Path, offered: tuple[str, str]) -> None:
        """Make them; the paths of scene and cameras are those that are offered at first."""
        self.worker, self.page = Worker(), Page()
        self.session = Session(self.worker.cancelled)
        self.files = Files(self.session, state)
        self.panels = Panels(self.page, *offered)
        self.view = SceneView(self.page, most)
        self._shown: dict[str, object] = {}
        self.due = False
        """Whether what a mark has corrected is to be cut out again."""
        name = "Open the sample" if offered[0] == str(sample.SCENE) else Path(offered[0]).name
        self.page.show(starts=[(name, *offered), *self.files.recent()], said=WELCOME)

    def do(self, name: str, work: Callable[[], str | None], event: Event | None = None) -> None:
        """Have something done in the worker's thread, show its sentence, if any, and what an event then shows."""

        def job() -> None:
            self._job(name, work, event)
            self._follow()

        self.worker.submit(job)

    def stop(self) -> None:
        """End the worker, and say so in all tabs."""
        self.worker.stop()
        self.panels.say(PROGRAM_ENDED, wrong=True)

    def _job(self, name: str, work: Callable[[], str | None], event: Event | None) -> None:
        """Do some work, and show its sentence and, if it succeeds, what is to be seen after an event."""
        self.panels.busy(name, 0)
        text, wrong = "", True
        try:
            try:
                text = work() or self.panels.status_text
                if event is not None:
                    now = self.session.now
                    self.panels.showing = showing_after(event, now, self.panels.showing)
                    self.due = due_after(event, now, self.panels.showing, self.due)
            finally:
                self._present()
            self.files.keep()
            wrong = False
        except InputError as error:
            text = str(error)
        except Exception as error:
            traceback.print_exc(file=sys.stderr)
            text = f"This is a defect of the program ({type(error).__name__}: {error}); everything is as it was."
        self.panels.say(text, wrong=wrong)

    def _present(self) -> None:
        """Show what of the state is new, if a scene is open; otherwise, what somebody is typing is kept."""
        if (now := self.session.glance()) is None:
            return
        views = now.object.fresh if self.panels.views.value else None
        shown: dict[str, object] = {"up": now.up, "views": views, "state": now}
        new = [what for what, state in shown.items() if self._shown.get(what) is not state]
        self._shown = shown
        if "up" in new:
            self.view.show_up(now.up.direction)
        if "views" in new:
            self.view.show_views(views)
        if "state" in new:
            self.view.show(now)
            self.panels.refresh(now, self._idle(now))

    def _idle(self, now: Snapshot) -> list[str]:
        """Return the actions that can do nothing in a state."""
        part, (back, forth) = now.object, self.session.can_step
        idle = {
            "Undo": not back,
            "Redo": not forth,
            "Unhide all": not any(each.hidden for each in now.objects),
            "Put it back": part.moved is None,
            **dict.fromkeys(("Cut out", "Grow", "Shrink", "Clear", TAKE_OUT, *PLACING), not part.n_selected),
            "Look at the object": not part.n_selected,
            **dict.fromkeys((*(f"Download: {what}" for what in DOWNLOADS), "Save in this folder"), part.fresh is None),
        }
        return [name for name, cannot in idle.items() if cannot]

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

    def stages(self, number: int, prefix: str) -> Progress:
        """Return what to call at each of about so many stages, to show the progress and to stop when asked."""
        steps = iter(range(1000))

        def stage(name: str) -> None:
            if self.worker.cancelled():
                raise Cancelled
            doing = prefix + name
            self.panels.busy(doing[:1].upper() + doing[1:], min(1.0, next(steps) / number))

        return stage
