"""Where the items of a batch are worked on: a pool of processes on this machine, or tasks of a Ray cluster.

Both yield the number of each task as it ends, and what its function returned; both end what is still at work when
they are closed.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import re
import signal
import socket
import sys
import threading
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from typing import Any

from gaussian_trimmer.errors import InputError, printable

_SECONDS_TO_ANSWER = 10.0
Task = tuple[Any, ...]
"""The arguments of the function, which can be pickled, as it can itself."""


def on_processes(
    function: Callable[..., str], tasks: Sequence[Task], workers: int | None = None
) -> Generator[tuple[int, str]]:
    """Call a function for every task on processes of this machine, by default one a processor.

    Raises:
        InputError: a process died.
    """
    if not tasks:
        return
    workers = min(workers or cores(), len(tasks))
    before = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, context, initializer=_prepare, initargs=(max(1, cores() // workers),))
    done = False
    try:
        with _interrupts_held_back():
            futures = {pool.submit(function, *task): number for number, task in enumerate(tasks)}
        for future in as_completed(futures):
            yield futures[future], future.result()
        done = True
    except BrokenProcessPool as error:
        raise InputError(
            "A worker process died; the machine may have run out of memory. What is finished stays; start the batch "
            "again with fewer --workers."
        ) from error
    finally:
        if not done:
            for process in set(multiprocessing.active_children()) - before:
                process.kill()
        pool.shutdown(cancel_futures=True)


def on_ray(
    function: Callable[..., str], tasks: Sequence[Task], workers: int | None = None, address: str | None = None
) -> Generator[tuple[int, str]]:
    """Call a function for every task on a Ray cluster, a processor each.

    Args:
        function: what to call.
        tasks: its arguments.
        workers: number of processors of a cluster that is started here; by default all.
        address: that of a cluster, "auto" for the one this machine is part of; None: one is started here.

    Raises:
        InputError: Ray is not installed, or there is no such cluster.
    """
    if not tasks:
        return

    def call(*task: Any) -> str:
        _use_threads(1)
        return function(*task)

    with _cluster(address, workers) as ray:
        remote = ray.remote(num_cpus=1, max_retries=0)(call)
        references = [remote.remote(*task) for task in tasks]
        futures: dict[Future[str], int] = {one.future(): number for number, one in enumerate(references)}
        try:
            for future in as_completed(futures):
                lost = future.exception()
                said = printable(f"Its process was lost: {' '.join(str(lost).split())}", 300)
                yield futures[future], said if lost else future.result()
        finally:
            for reference in references:
                with suppress(ray.exceptions.RayError):
                    ray.cancel(reference, force=True)
            wait(futures, _SECONDS_TO_ANSWER)  # Ray may crash if it is shut down before they have ended


def cores() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Leave Ctrl-C to this process: those that are started here do not get it."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _prepare(threads: int) -> None:
    """Make a process ready, which ends when the one that has started it does."""

    def end_with_parent() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    warnings.simplefilter("ignore")
    _use_threads(threads)


def _use_threads(threads: int) -> None:
    import cv2
    import numba

    cv2.setNumThreads(threads)
    numba.set_num_threads(min(threads, numba.get_num_threads()))  # the user may allow fewer


@contextmanager
def _cluster(address: str | None, workers: int | None) -> Iterator[Any]:
    """Give Ray, connected to a cluster, or to one that is started here and ends here."""
    # Without this, SIGTERM prints a trace and aborts the process three seconds later. Ray reads it when it is imported.
    os.environ.setdefault("RAY_DISABLE_FAILURE_SIGNAL_HANDLER", "1")
    try:
        import ray
    except ImportError as error:
        raise InputError(
            "The engine 'ray' needs Ray, which is not installed; in the program's clone: pip install '.[ray]'."
        ) from error
    if address is not None and (found := re.fullmatch(r"(?:ray://)?\[?([^\]/]+)\]?:(\d+)", address)):
        try:
            socket.create_connection((found[1], int(found[2])), _SECONDS_TO_ANSWER).close()
        except (OSError, OverflowError) as error:  # for which Ray would wait a quarter of an hour
            raise InputError(f"There is no Ray cluster at '{address}' ({error}).") from error
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    logging.getLogger("ray").setLevel(logging.ERROR)  # `init` sets it too late, after messages about tokens.
    # Without an address, `init` would join the cluster that was started last on this machine.
    own = {"address": "local", "include_dashboard": False, "num_cpus": workers}
    # Signals interrupt the main thread only, and Ray crashes if it is interrupted while it starts. In the main thread
    # it would also replace the handler of SIGTERM. When a thread ends, Linux ends the processes it has started.
    with ThreadPoolExecutor(1) as thread:
        options = own if address is None else {"address": address}
        starting = thread.submit(ray.init, log_to_driver=False, logging_level=logging.ERROR, **options)
        try:
            starting.result()
            yield ray
        except Exception as error:
            if starting.exception() is not error:
                raise
            place, cure = f"is at '{address}'", "One that asks for a token needs RAY_AUTH_MODE=token."
            if address is None:
                place, cure = "could be started here", "If the machine is busy, start the batch again."
            raise InputError(f"No Ray cluster {place} ({' '.join(str(error).split())[:300]}). {cure}") from error
        finally:
            wait([starting])  # a signal may have come while it started
            thread.submit(ray.shutdown).result()  # interrupted half-way, Ray would end the process with code 1
