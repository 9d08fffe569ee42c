"""One thread for everything that takes time, so that callbacks of the web server return at once."""

from __future__ import annotations

import queue
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress

_PATIENCE_SECONDS = 10.0
Job = Callable[[], None]


class Worker:
    """Does one job after the other, in the order in which they were submitted. One that fails is printed."""

    def __init__(self) -> None:
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._cancelled, self.busy = threading.Event(), False
        self._thread = threading.Thread(target=self._work, name="gaussian-trimmer-app", daemon=True)
        self._thread.start()

    def submit(self, job: Job) -> None:
        """Do a job after those that were submitted before."""
        self._jobs.put(job)

    def cancel(self) -> None:
        """Ask the present job to stop; later ones are done."""
        if self.busy:
            self._cancelled.set()

    def cancelled(self) -> bool:
        """Whether the present job was asked to stop."""
        return self._cancelled.is_set()

    def stop(self) -> None:
        """Let the present job be the last, ask it to stop, and wait for that."""
        with suppress(queue.Empty):
            while True:
                self._jobs.get_nowait()
        self._jobs.put(None)
        self.cancel()
        self._thread.join(_PATIENCE_SECONDS)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            self._cancelled.clear()
            self.busy = True
            try:
                job()
            except BaseException:
                traceback.print_exc()
            finally:
                self.busy = False
