"""Workers on this machine: processes that are started anew, one JSON message a line each way.

A worker that loses its driver stops at once and removes what it was writing; one that is killed leaves a part that the
next run removes. Both the driver and Python are strangers to whatever `__main__` started the batch.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from gaussian_trimmer.errors import printable

Json = dict[str, Any]
_SECONDS_TO_END = 5.0
_LONGEST_WORDS = 300


class LocalEngine:
    """Workers as processes of this machine; the threads that kernels use are shared out among them."""

    def __init__(self, output: str) -> None:
        self._output, self._threads = output, 1
        self._processes: dict[int, subprocess.Popen[bytes]] = {}
        self._errors: dict[int, IO[bytes]] = {}
        self._replies: queue.SimpleQueue[tuple[int, int, Json | None]] = queue.SimpleQueue()

    def room(self, need: float) -> int:
        """One worker for each processor."""
        return cores()

    def prepare(self, workers: int, need: float) -> None:
        """Say how many workers there will be."""
        self._threads = max(1, cores() // max(workers, 1))

    def start(self, worker: int) -> None:
        """Start a worker."""
        errors = tempfile.TemporaryFile()  # noqa: SIM115
        process = subprocess.Popen(
            [sys.executable, "-m", "gaussian_trimmer.batch.worker_process", self._output],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, env=_environment(self._threads),
            start_new_session=True,  # Ctrl-C is the driver's business.
        )  # fmt: skip
        self._processes[worker], self._errors[worker] = process, errors
        threading.Thread(target=self._listen, args=(worker, process), daemon=True).start()

    def send(self, worker: int, request: Json) -> None:
        """Send a request; that the worker has died is told by `wait`."""
        stream = self._processes[worker].stdin
        assert stream is not None
        with suppress(OSError):
            stream.write(json.dumps(request).encode() + b"\n")
            stream.flush()

    def wait(self, seconds: float) -> list[tuple[int, Json]]:
        """Replies that have come, waiting for the first no longer than this; {"death": words} where a worker died."""
        found: list[tuple[int, Json]] = []
        while True:
            try:
                worker, process, reply = (
                    self._replies.get(timeout=max(seconds, 0.0)) if not found else (self._replies.get_nowait())
                )
            except queue.Empty:
                return found
            current = self._processes.get(worker)
            if current is None or current.pid != process:
                continue  # the last words of one that was killed
            if reply is None:
                found.append((worker, {"death": self._bury(worker)}))
            else:
                found.append((worker, reply))

    def without_room(self) -> set[int]:
        """None: processes begin at once."""
        return set()

    def kill(self, worker: int) -> None:
        """End a worker, whatever it is doing."""
        process = self._processes.get(worker)
        if process is not None:
            process.kill()
            self._bury(worker)

    def close(self) -> None:
        """End all workers; what they were writing is removed."""
        for process in self._processes.values():
            process.terminate()
        for worker, process in list(self._processes.items()):
            try:
                process.wait(_SECONDS_TO_END)
            except subprocess.TimeoutExpired:
                process.kill()
            self._bury(worker)

    def _listen(self, worker: int, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            try:
                reply = json.loads(line)
            except ValueError:
                break
            self._replies.put((worker, process.pid, reply))
        self._replies.put((worker, process.pid, None))

    def _bury(self, worker: int) -> str:
        """Let a worker that has ended go; returns how it ended."""
        process, errors = self._processes.pop(worker), self._errors.pop(worker)
        assert process.stdin is not None
        with suppress(OSError):
            process.stdin.close()
        try:
            code = process.wait(_SECONDS_TO_END)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
        with errors:
            size = errors.seek(0, os.SEEK_END)
            errors.seek(max(0, size - 4096))
            words = errors.read().decode("utf-8", "replace").strip().rpartition("\n")[2]
        how = f"was killed by {_signal_name(-code)}" if code < 0 else f"ended with code {code}"
        return how + (f" ({printable(words, _LONGEST_WORDS)})" if words else "")


def cores() -> int:
    """Number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def thread_variables(threads: int) -> dict[str, str]:
    """Environment variables that keep a worker to so many threads."""
    names = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    return {**dict.fromkeys(names, str(threads)), "OMP_WAIT_POLICY": "passive"}


def _environment(threads: int) -> dict[str, str]:
    import gaussian_trimmer

    here = str(Path(gaussian_trimmer.__file__).parents[1])  # The same package, from wherever it was imported.
    paths: Sequence[str] = (here, os.environ.get("PYTHONPATH", ""))
    return {**os.environ, **thread_variables(threads), "PYTHONPATH": os.pathsep.join(path for path in paths if path)}


def _signal_name(number: int) -> str:
    try:
        name = signal.Signals(number).name
    except ValueError:
        name = f"signal {number}"
    return f"{name} (perhaps for want of memory)" if name == "SIGKILL" else name
