"""Processes on this machine, each a pool of its own: one that dies costs no other its item."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from typing import Any

from gaussian_trimmer.batch.items import Item
from gaussian_trimmer.batch.store import Outcome
from gaussian_trimmer.batch.trimming import ItemTrimmer
from gaussian_trimmer.errors import InputError

_THREAD_VARIABLES = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_trimmer: ItemTrimmer
"""That of a worker process."""


class LocalProcesses:
    """Starts processes that trim items.

    Args:
        workers: number of processes at a time.
        options: arguments of `ItemTrimmer`.
    """

    lost = BrokenProcessPool
    """What the future of an item raises whose process died."""

    def __init__(self, workers: int, options: dict[str, Any]) -> None:
        self.workers = workers
        self._options = {**options, "threads": max(1, cores() // workers)}
        # While this end is open, the processes run: it is closed when this process dies, too.
        self._stop, self._run = multiprocessing.Pipe(duplex=False)
        self._started: list[LocalProcess] = []

    def start(self, need: float) -> LocalProcess:
        """Start a process."""
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(1, context, initializer=_prepare, initargs=(self._stop, self._options))
        with _environment_of_worker(self._options["threads"]):
            self._started.append(LocalProcess(pool))
        return self._started[-1]

    def check(self) -> None:
        """Refuse to go on where no process could be started.

        Raises:
            InputError: none has ever answered.
        """
        if not any(process.has_answered() for process in self._started):
            raise InputError(
                "No worker process can be started. If the batch is started by a Python script, the call must stand "
                "below \"if __name__ == '__main__':\", since every process imports the script."
            )

    def close(self) -> None:
        """End all processes, also those that are at work."""
        self._run.close()
        for process in self._started:
            process.end()
        self._stop.close()


class LocalProcess:
    """A process that trims items."""

    def __init__(self, pool: ProcessPoolExecutor) -> None:
        self._pool, self._first = pool, pool.submit(bool)

    def submit(self, item: Item) -> Future[Outcome | None]:
        """Have it trim an item."""
        return self._pool.submit(_trim, item)

    def fits(self, need: float) -> bool:
        """Return whether it may trim a scene that needs so many bytes."""
        return True

    def has_answered(self) -> bool:
        """Return whether it was started."""
        return self._first.done() and self._first.exception() is None

    def end(self) -> None:
        """End it when it has nothing to do."""
        self._pool.shutdown(cancel_futures=True)


def cores() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def _environment_of_worker(threads: int) -> Iterator[None]:
    """Have a process that is started here keep to so many threads, and leave Ctrl-C to this one."""
    before = os.environ.copy()
    os.environ.update({**dict.fromkeys(_THREAD_VARIABLES, str(threads)), "OMP_WAIT_POLICY": "passive"})
    masked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if sys.platform != "win32" else None
    try:
        yield
    finally:
        if masked is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, masked)
        for name in {*_THREAD_VARIABLES, "OMP_WAIT_POLICY"}:
            os.environ.pop(name)
        os.environ.update(before)


# What a process does


def _prepare(stop: Connection, options: dict[str, Any]) -> None:
    global _trimmer
    threading.Thread(target=_end_with, args=(stop,), daemon=True).start()
    warnings.simplefilter("ignore")
    _trimmer = ItemTrimmer(**options)


def _end_with(stop: Connection) -> None:
    """End the process when the other end of a pipe is closed; what it was writing is removed by the driver."""
    with suppress(EOFError, OSError):
        stop.poll(None)
    os._exit(1)


def _trim(item: Item) -> Outcome | None:
    return _trimmer.trim(item)
