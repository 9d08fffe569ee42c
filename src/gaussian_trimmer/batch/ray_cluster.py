"""Workers on a Ray cluster: actors, each with a scene, placed by Ray where there are processors, memory and GPUs.

An actor reads its scenes itself, on its own node; the scheduler sends it the items of a scene one after another. The
driver sees it die as it sees a process die, and starts another in its place, wherever there is room.
"""

from __future__ import annotations

import logging
import os
import re
import socket
from pathlib import Path
from typing import Any

from gaussian_trimmer.batch.local import thread_variables
from gaussian_trimmer.errors import InputError

Json = dict[str, Any]
_MOST_AT_ONCE = 64
_SECONDS_TO_ANSWER = 10.0
_LONGEST_REASON = 400
_THREADS = 1
"""Processors, and so threads, of a worker: objects are many, and each thread more saves less."""


class RayEngine:
    """Workers as actors of a Ray cluster.

    Args:
        output: folder that every node sees, or address of a store.
        address: that of the cluster, "auto" for the one this machine is part of; None: one is started here, and ended
            by `close`.
        gpus: what a worker takes of a GPU; results of the CPU's renderer need none.

    Raises:
        InputError: Ray is not installed, or there is no such cluster.
    """

    def __init__(self, output: str, address: str | None = None, *, gpus: float = 0.0) -> None:
        self._ray, self._own = _connect(address)
        self._output = output
        self._resources = {"num_cpus": _THREADS, "num_gpus": gpus}
        self._workers: dict[int, Any] = {}
        self._waiting: dict[Any, int] = {}
        self._placing: dict[int, Any] = {}

    def room(self, need: float) -> int:
        """How many workers the cluster has room for that take so many bytes each, at least one."""
        nodes = [node["Resources"] for node in self._ray.nodes() if node["Alive"]]
        return max(1, sum(int(min(n.get("CPU", 0) // _THREADS, n.get("memory", 0) // need)) for n in nodes))

    def prepare(self, workers: int, need: float) -> None:
        """Say how many workers there will be, and how many bytes each takes.

        Raises:
            InputError: no node has so much memory.
        """
        most = max((node["Resources"].get("memory", 0) for node in self._ray.nodes() if node["Alive"]), default=0)
        if need > most:
            raise InputError(
                f"A worker may take {need / 1e9:.1f} GB of memory, and no node of the cluster has more than "
                f"{most / 1e9:.1f} GB for tasks; add larger nodes, or leave the largest scenes out."
            )
        self._resources["memory"] = int(need)

    def start(self, worker: int) -> None:
        """Ask the cluster for a worker; requests to it wait until there is room."""
        variables = {**thread_variables(_THREADS), "PYTHONPATH": _source_path()}
        kind = self._ray.remote(
            max_restarts=0, max_task_retries=0, runtime_env={"env_vars": variables}, **self._resources
        )(GaussianTrimmerWorker)
        self._workers[worker] = kind.remote(self._output)
        self._placing[worker] = self._workers[worker].is_here.remote()

    def send(self, worker: int, request: Json) -> None:
        """Send a request."""
        self._waiting[self._workers[worker].serve.remote(request)] = worker

    def wait(self, seconds: float) -> list[tuple[int, Json]]:
        """Replies that have come, waiting for the first no longer than this; {"death": words} where a worker died."""
        if not self._waiting:
            return []
        waiting = list(self._waiting)
        found, _ = self._ray.wait(waiting, num_returns=1, timeout=seconds)
        if found:  # Others that have come by now are taken along.
            found, _ = self._ray.wait(waiting, num_returns=min(len(waiting), _MOST_AT_ONCE), timeout=0)
        return [(self._waiting[reference], self._reply(reference)) for reference in found]

    def without_room(self) -> set[int]:
        """Workers that the cluster has no processor or memory for yet."""
        references = list(self._placing.values())
        if references:
            placed, _ = self._ray.wait(references, num_returns=len(references), timeout=0)
            here = set(placed)
            self._placing = {worker: asked for worker, asked in self._placing.items() if asked not in here}
        return set(self._placing)

    def kill(self, worker: int) -> None:
        """End a worker, whatever it is doing."""
        actor = self._workers.pop(worker, None)
        self._placing.pop(worker, None)
        self._waiting = {reference: number for reference, number in self._waiting.items() if number != worker}
        if actor is not None:
            self._ray.kill(actor, no_restart=True)

    def close(self) -> None:
        """End all workers, and the cluster if it was started here."""
        for worker in list(self._workers):
            self.kill(worker)
        if self._own:
            self._ray.shutdown()

    def _reply(self, reference: Any) -> Json:
        worker = self._waiting.pop(reference)
        try:
            reply: Json = self._ray.get(reference)
        except (self._ray.exceptions.RayActorError, self._ray.exceptions.RayTaskError) as error:
            self.kill(worker)
            return {"death": f"was lost ({_reason(error)})"}
        return reply


class GaussianTrimmerWorker:
    """The actor: a `SceneWorker` that is started where Ray puts it."""

    def __init__(self, output: str) -> None:
        import cv2

        from gaussian_trimmer.batch.storage import open_store
        from gaussian_trimmer.batch.worker import SceneWorker

        cv2.setNumThreads(_THREADS)
        self._worker = SceneWorker(open_store(output))

    def is_here(self) -> bool:
        """An answer to this tells that the cluster had room."""
        return True

    def serve(self, request: Json) -> Json:
        """The reply to a request."""
        return self._worker.serve(request)


def _connect(address: str | None) -> tuple[Any, bool]:
    """Ray, connected to a cluster, and whether the cluster was started for this.

    Raises:
        InputError: Ray is not installed, or there is no such cluster.
    """
    try:
        import ray
    except ImportError as error:
        raise InputError(
            "The engine 'ray' needs Ray, which is not installed; pip install 'gaussian-trimmer[ray]'."
        ) from error
    if ray.is_initialized():
        return ray, False
    if address is not None:
        _check_address(address)
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    logging.getLogger("ray").setLevel(logging.ERROR)  # Before `init` sets it, it has told of tokens already.
    # Without an address, `init` would join whatever cluster was started on this machine last.
    options: dict[str, Any] = (
        {"address": "local", "include_dashboard": False} if address is None else {"address": address}
    )
    try:
        ray.init(log_to_driver=False, logging_level=logging.ERROR, **options)
    except (ConnectionError, RuntimeError, ValueError, TimeoutError) as error:
        reason = " ".join(str(error).split())[:300]
        if address is None:
            raise InputError(f"No Ray cluster could be started here ({reason}).") from error
        raise InputError(
            f"There is no Ray cluster at '{address}' ({reason}). If it is there and asks for a token, "
            "set RAY_AUTH_MODE=token."
        ) from error
    return ray, address is None


def _reason(error: Exception) -> str:
    """The last sentences of what Ray says of a death, without the lines that name actors and addresses."""
    lines = [line.strip() for line in str(error).splitlines() if not line.startswith("\t")]
    return " ".join(filter(None, lines))[-_LONGEST_REASON:] or type(error).__name__


def _check_address(address: str) -> None:
    """Refuse an address where nobody answers: Ray would try it for minutes.

    Raises:
        InputError: nobody answers, or it is no address.
    """
    found = re.fullmatch(r"(?:ray://)?\[?([^\]/]+?)\]?:(\d{1,5})", address)
    if address in ("auto", "local"):
        return
    if not found:
        raise InputError(f"'{address}' is no address of a Ray cluster; give host:port, or auto.")
    try:
        socket.create_connection((found[1], int(found[2])), _SECONDS_TO_ANSWER).close()
    except (OSError, OverflowError) as error:
        raise InputError(f"There is no Ray cluster at '{address}' ({error}).") from error


def _source_path() -> str:
    """The folders from which this process imports, so that workers on this machine import the same."""
    import gaussian_trimmer

    here = str(Path(gaussian_trimmer.__file__).parents[1])
    return os.pathsep.join(dict.fromkeys([here, *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]))
