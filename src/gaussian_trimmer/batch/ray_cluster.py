"""Actors on a Ray cluster, which Ray places where there is room for their scenes."""

from __future__ import annotations

import logging
import os
import re
import socket
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import suppress
from typing import Any

from gaussian_trimmer.batch.items import Item
from gaussian_trimmer.batch.memory import PROCESS_BYTES
from gaussian_trimmer.batch.store import Outcome
from gaussian_trimmer.batch.trimming import ItemTrimmer
from gaussian_trimmer.errors import InputError

_SECONDS_TO_ANSWER = 10.0


class RayCluster:
    """Starts actors that trim items.

    Args:
        address: that of the cluster, "auto" for the one this machine is part of; None: one is started here.
        workers: number of actors at a time; None: as many as the cluster has processors.
        gpus: what an actor takes of a GPU.
        options: arguments of `ItemTrimmer`.

    Raises:
        InputError: Ray is not installed, or there is no such cluster.
    """

    def __init__(self, address: str | None, workers: int | None, gpus: float, options: dict[str, Any]) -> None:
        self._thread = ThreadPoolExecutor(1)
        """Starts Ray, and lives as long as the cluster: when a thread ends, Linux ends the processes it started."""
        self._ray, self._is_own = _connect(address, self._thread)
        self.lost = self._ray.exceptions.RayError
        """What the future of an item raises whose process died."""
        self._options, self._gpus = {**options, "threads": 1}, gpus
        nodes = [node["Resources"] for node in self._ray.nodes() if node["Alive"]]
        self.workers = workers or max(1, int(sum(node.get("CPU", 0) for node in nodes)))
        self.most_memory = max((node.get("memory", 0.0) for node in nodes), default=0.0)
        """Bytes that the node with most memory has for actors."""
        self._started: list[RayActor] = []

    def start(self, need: float) -> RayActor:
        """Start an actor for scenes that need up to so many bytes."""
        kind = self._ray.remote(num_cpus=1, num_gpus=self._gpus, memory=int(PROCESS_BYTES + need))(ItemTrimmer)
        self._started.append(RayActor(self._ray, kind.remote(**self._options), need))
        return self._started[-1]

    def check(self) -> None:
        """Refuse to go on without a cluster.

        Raises:
            InputError: no node of it answers.
        """
        answer = self._ray.remote(num_cpus=0)(lambda: None).remote()  # Ray takes a type for an actor
        with suppress(self._ray.exceptions.RayError):
            if self._ray.wait([answer], timeout=_SECONDS_TO_ANSWER)[0]:
                self._ray.get(answer)
                return
        raise InputError(
            "The Ray cluster is gone, or the node that this machine reaches it by; what is finished stays. Start the "
            "batch again when the cluster is back."
        )

    def close(self) -> None:
        """End all actors, and the cluster if it was started for this."""
        for actor in self._started:
            actor.end()
        # What an actor was at ends when it is killed, in a thread of Ray's; Ray may crash if it is shut down before.
        wait([actor.last for actor in self._started if actor.last is not None], _SECONDS_TO_ANSWER)
        if self._is_own:
            self._ray.shutdown()
        self._thread.shutdown()


class RayActor:
    """An actor that trims items."""

    def __init__(self, ray: Any, actor: Any, need: float) -> None:
        self._ray, self._actor, self._need = ray, actor, need
        self.last: Future[Outcome | None] | None = None
        """What it was given last."""

    def submit(self, item: Item) -> Future[Outcome | None]:
        """Have it trim an item."""
        future: Future[Outcome | None] = self._actor.trim.remote(item).future()
        self.last = future
        return future

    def fits(self, need: float) -> bool:
        """Return whether it may trim a scene that needs so many bytes."""
        return need <= self._need

    def end(self) -> None:
        """End it, whatever it does."""
        with suppress(self._ray.exceptions.RayError):
            self._ray.kill(self._actor)


def _connect(address: str | None, thread: ThreadPoolExecutor) -> tuple[Any, bool]:
    """Return Ray, connected to a cluster in a thread, and whether the cluster was started for this."""
    # Without this, SIGTERM prints a trace and aborts the process three seconds later. Ray reads it when it is imported.
    os.environ.setdefault("RAY_DISABLE_FAILURE_SIGNAL_HANDLER", "1")
    try:
        import ray
    except ImportError as error:
        raise InputError(
            "The engine 'ray' needs Ray, which is not installed; pip install 'gaussian-trimmer[ray]'."
        ) from error
    if ray.is_initialized():
        return ray, False
    if address is not None and (found := re.fullmatch(r"(?:ray://)?\[?([^\]/]+)\]?:(\d+)", address)):
        try:
            socket.create_connection((found[1], int(found[2])), _SECONDS_TO_ANSWER).close()
        except (OSError, OverflowError) as error:  # for which Ray would wait a quarter of an hour
            raise InputError(f"There is no Ray cluster at '{address}' ({error}).") from error
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    logging.getLogger("ray").setLevel(logging.ERROR)  # `init` sets it too late, after messages about tokens.
    # Without an address, `init` would join the cluster that was started last on this machine.
    options = {"address": "local", "include_dashboard": False} if address is None else {"address": address}
    # Signals interrupt the main thread only, and Ray crashes if it is interrupted while it starts. In the main thread
    # it would also replace the handler of SIGTERM.
    starting = thread.submit(ray.init, log_to_driver=False, logging_level=logging.ERROR, **options)
    try:
        starting.result()
    except Exception as error:  # Ray raises that itself, as where its processes take too long to start
        place = "could be started here" if address is None else f"is at '{address}'"
        raise InputError(
            f"No Ray cluster {place} ({' '.join(str(error).split())[:300]}). One that asks for a token needs "
            "RAY_AUTH_MODE=token."
        ) from error
    except BaseException:  # a signal, while it started
        wait([starting])
        ray.shutdown()
        raise
    return ray, address is None
