"""Processes on this machine, each a pool of its own: one that dies costs no other its items."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from typing import Any

from gaussian_trimmer.batch.outcomes import Outcome
from gaussian_trimmer.batch.scenes import Part
from gaussian_trimmer.batch.trimming import trim_items
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.stop_signals import Stopped

_SECONDS_TO_END = 5.0
_THREAD_VARIABLES = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class LocalProcesses:
    """Processes that trim parts of batches, started when they are needed.

    Args:
        workers: number of processes.
        options: arguments of `trim_items`.
    """

    def __init__(self, workers: int, options: dict[str, Any]) -> None:
        self.workers = workers
        self._options = options
        # While this end is open, the processes run: it is closed when this process dies, too.
        self._stop, self._run = multiprocessing.Pipe(duplex=False)
        self._idle: list[ProcessPoolExecutor] = []
        self._busy: dict[Future[list[Outcome]], ProcessPoolExecutor] = {}
        self._started: dict[ProcessPoolExecutor, Future[bool]] = {}
        self._can_start = False

    def submit(self, part: Part) -> Future[list[Outcome]]:
        """Have a process that has nothing to do trim a part."""
        pool = self._idle.pop() if self._idle else self._start()
        future = pool.submit(_trim_items, part.items, **self._options)
        self._busy[future] = pool
        return future

    def result(self, future: Future[list[Outcome]]) -> list[Outcome] | None:
        """What became of the items of a part; None if its process has died.

        Raises:
            InputError: processes cannot be started.
        """
        pool = self._busy.pop(future)
        try:
            outcomes = future.result()
        except BrokenProcessPool as error:
            pool.shutdown(wait=False)
            if self._started.pop(pool).exception() is not None and not self._can_start:
                raise InputError(
                    "No worker process can be started. If the batch is started by a Python script, the call must stand "
                    "below \"if __name__ == '__main__':\", since every process imports the script."
                ) from error
            return None
        self._can_start = True
        self._idle.append(pool)
        return outcomes

    def close(self) -> None:
        """End all processes; what they are writing is removed."""
        self._run.close()
        for pool in (*self._idle, *self._busy.values()):
            pool.shutdown(cancel_futures=True)
        self._stop.close()

    def _start(self) -> ProcessPoolExecutor:
        threads = max(1, cores() // self.workers)
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(1, context, initializer=_prepare, initargs=(self._stop, threads))
        with _environment_of_worker(threads):
            self._started[pool] = pool.submit(bool)
        return pool


def cores() -> int:
    """Number of processors that this process may use."""
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


def _prepare(stop: Connection, threads: int) -> None:
    import cv2

    cv2.setNumThreads(threads)
    warnings.simplefilter("ignore")
    threading.Thread(target=_end_with, args=(stop,), daemon=True).start()


def _end_with(stop: Connection) -> None:
    """Stop what is being done when the other end of a pipe is closed."""
    with suppress(EOFError, OSError):
        stop.poll(None)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_SECONDS_TO_END)
    os._exit(1)


def _trim_items(*arguments: Any, **options: Any) -> list[Outcome]:
    try:
        return trim_items(*arguments, **options)
    except Stopped:
        os._exit(1)  # What was being written has been removed.
