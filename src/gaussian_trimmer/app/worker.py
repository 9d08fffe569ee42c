"""One thread for all that takes time, so that callbacks of a web server return at once and nothing runs twice."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, eq=False)
class _Job:
    name: str
    work: Callable[[], None]


class Worker:
    """Does one job after the other, in the order in which they were given."""

    def __init__(self, failed: Callable[[str, BaseException], None]) -> None:
        """Begin to wait for jobs.

        Args:
            failed: told the name of a job and its exception, in the worker's thread; later jobs are done all the same.
        """
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._failed, self._cancelled, self._doing = failed, threading.Event(), ""
        self._thread = threading.Thread(target=self._work, name="gaussian-trimmer-app", daemon=True)
        self._thread.start()

    @property
    def doing(self) -> str:
        """Name of the job that is being done; empty if there is none."""
        return self._doing

    def submit(self, name: str, work: Callable[[], None]) -> None:
        """Give a job to be done after those that were given before."""
        self._jobs.put(_Job(name, work))

    def cancel(self) -> None:
        """Ask the present job to stop; those that come after it are done."""
        if self._doing:
            self._cancelled.set()

    def cancelled(self) -> bool:
        """Whether the present job was asked to stop."""
        return self._cancelled.is_set()

    def stop(self) -> None:
        """Let the present job be the last, and ask it to stop."""
        self._jobs.put(None)
        self.cancel()

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            self._cancelled.clear()
            self._doing = job.name
            try:
                job.work()
            except BaseException as error:
                self._failed(job.name, error)
            finally:
                self._doing = ""
