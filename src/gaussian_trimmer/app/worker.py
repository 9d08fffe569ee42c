"""One thread for everything that takes time, so that callbacks of the web server return at once."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from gaussian_trimmer.errors import InputError

Job = Callable[[], None]


class Cancelled(InputError):  # noqa: N818
    """The present job was asked to stop."""

    def __init__(self) -> None:
        super().__init__("Cancelled; everything is as it was.")


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
