"""A worker: a process that trims one item after another, and is replaced when it dies or takes too long."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from typing import Any

from gaussian_trimmer.batch.items import Item
from gaussian_trimmer.batch.outcomes import Outcome
from gaussian_trimmer.batch.scene_trimmer import SceneTrimmer
from gaussian_trimmer.batch.storage import open_store
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.stop_signals import Stopped, stop_signals_raised

_SECONDS_TO_START = 300.0
"""What the first item of a worker is granted beyond the time limit: kernels may have to be compiled."""
_SECONDS_TO_END = 5.0
_STARTING = threading.Lock()
_THREAD_VARIABLES = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class WorkerSettings:
    """What all workers of a batch have in common."""

    output: str
    """Folder or address of the results."""
    retry_failed: bool = False
    time_limit: float | None = None
    """Seconds that one item, or the check of its inputs, may take."""
    memory_limit: int | None = None
    """Bytes of data that a worker may have; an item that needs more fails."""
    threads: int = 1


class Worker:
    """A pool of one process, which keeps its scene and its compiled kernels from item to item.

    A pool of several would lose all their items when one process dies, and could not say which item it died of.
    """

    def __init__(self, settings: WorkerSettings) -> None:
        self._settings = settings
        self._store = open_store(settings.output)
        self._pool: ProcessPoolExecutor | None = None
        self._process: BaseProcess | None = None
        self._is_new = self._stopped = False

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def trim(self, item: Item) -> Outcome:
        """What becomes of an item.

        Raises:
            InputError: no process can be started.
        """
        fingerprint = ""
        try:
            found = self._ask(_check, item)
            if isinstance(found, Outcome):
                return found
            fingerprint = found
            outcome: Outcome = self._ask(_trim, item, fingerprint)
            self._is_new = False
            return outcome
        except TimeoutError:
            self._give_up(item)
            message = f"It took longer than the time limit of {self._settings.time_limit:g} seconds."
            self._store.record_failure(item.name, message, fingerprint)
            return Outcome(item, "failed", message, fingerprint=fingerprint)
        except BrokenProcessPool:
            message = f"Its worker {self._how_it_ended()}."
            self._give_up(item)
            return Outcome(item, "failed", message, fingerprint=fingerprint, cause="worker")

    def release_scene(self) -> None:
        """Let the process forget its scene, so that it takes little memory until the next item."""
        if self._pool is not None:
            self._pool.submit(_release)

    def stop(self) -> None:
        """End the process, which removes what it was writing; for another thread than the one that waits for it."""
        self._stopped = True
        if self._process is not None:
            self._process.terminate()

    def kill(self) -> None:
        """End the process, whatever it is doing."""
        if self._process is not None:
            self._process.kill()
            self._process.join(_SECONDS_TO_END)

    def close(self) -> None:
        """End the process when it has nothing to do; `trim` starts another."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
        self._pool = self._process = None

    def _give_up(self, item: Item) -> None:
        """End the process, and remove what it has left of an item."""
        self.kill()
        self.close()
        self._store.clean(item.name)

    def _ask(self, function: Callable[..., Any], *arguments: Any) -> Any:
        if self._pool is None:
            self._start()
        assert self._pool is not None
        if self._stopped:
            raise BrokenProcessPool
        limit = self._settings.time_limit
        if limit is not None and self._is_new:
            limit += _SECONDS_TO_START
        return self._pool.submit(function, *arguments).result(limit)

    def _start(self) -> None:
        self._pool = ProcessPoolExecutor(
            1, multiprocessing.get_context("spawn"), initializer=_prepare, initargs=(self._settings,)
        )
        with _STARTING, _environment_of_worker(self._settings.threads):
            others = multiprocessing.active_children()
            started: Future[int] = self._pool.submit(os.getpid)
            self._process = next((p for p in multiprocessing.active_children() if p not in others), None)
        self._is_new = True
        try:
            started.result()
        except BrokenProcessPool as error:
            if "code 1" not in self._how_it_ended():
                raise
            raise InputError(
                "No worker process can be started. If the batch is started by a Python script, the call must stand "
                "below \"if __name__ == '__main__':\", since every process imports the script."
            ) from error

    def _how_it_ended(self) -> str:
        if self._process is not None:
            self._process.join(_SECONDS_TO_END)
        code = self._process.exitcode if self._process is not None else None
        if code is None or code >= 0:
            return f"ended with code {code}"
        name = signal.Signals(-code).name if -code in list(signal.Signals) else f"signal {-code}"
        return f"was killed by {name}" + (" (out of memory?)" if name == "SIGKILL" else "")


def cores() -> int:
    """Number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def _environment_of_worker(threads: int) -> Iterator[None]:
    """Have a process that is started here keep to so many threads, and leave Ctrl-C to this one."""
    wanted = {**dict.fromkeys(_THREAD_VARIABLES, str(threads)), "OMP_WAIT_POLICY": "passive"}
    before = {name: os.environ.get(name) for name in wanted}
    os.environ.update(wanted)
    masked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if sys.platform != "win32" else None
    try:
        yield
    finally:
        if masked is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, masked)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


# What the process does

_trimmer: SceneTrimmer | None = None


def _prepare(settings: WorkerSettings) -> None:
    global _trimmer
    import cv2

    cv2.setNumThreads(settings.threads)
    warnings.simplefilter("ignore")
    if settings.memory_limit is not None and sys.platform.startswith("linux"):
        import resource

        _, most = resource.getrlimit(resource.RLIMIT_DATA)
        limit = settings.memory_limit if most == resource.RLIM_INFINITY else min(most, settings.memory_limit)
        resource.setrlimit(resource.RLIMIT_DATA, (limit, most))
    _trimmer = SceneTrimmer(open_store(settings.output), retry_failed=settings.retry_failed)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Stop what is being done when whoever started this process has died."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_SECONDS_TO_END)
    os._exit(1)


def _check(item: Item) -> Outcome | str:
    assert _trimmer is not None
    return _trimmer.check(item)


def _trim(item: Item, fingerprint: str) -> Outcome:
    assert _trimmer is not None
    try:
        with stop_signals_raised():
            return _trimmer.trim(item, fingerprint)
    except Stopped:
        os._exit(1)  # What was being written has been removed.


def _release() -> None:
    assert _trimmer is not None
    _trimmer.close()
