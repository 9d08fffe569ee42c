"""Tasks on a Ray cluster, which Ray places, and repeats if they are lost."""

from __future__ import annotations

import logging
import os
import re
import socket
from concurrent.futures import Future
from typing import Any

from gaussian_trimmer.batch.outcomes import Outcome
from gaussian_trimmer.batch.scenes import PROCESS_BYTES, Part
from gaussian_trimmer.batch.trimming import trim_items
from gaussian_trimmer.errors import InputError

_SECONDS_TO_ANSWER = 10.0


class RayTasks:
    """Tasks that trim parts of batches.

    Args:
        address: that of the cluster, "auto" for the one this machine is part of; None: one is started here.
        workers: number of tasks at a time; None: as many as the cluster has processors.
        gpus: what a task takes of a GPU.
        retries: how many times Ray repeats a task that is lost.
        options: arguments of `trim_items`.

    Raises:
        InputError: Ray is not installed, or there is no such cluster.
    """

    def __init__(
        self, address: str | None, workers: int | None, gpus: float, retries: int, options: dict[str, Any]
    ) -> None:
        self._ray, self._is_own = _connect(address)
        self._options = options
        nodes = [node["Resources"] for node in self._ray.nodes() if node["Alive"]]
        self.workers = workers or max(1, int(sum(node.get("CPU", 0) for node in nodes)))
        self.most_memory = max((node.get("memory", 0.0) for node in nodes), default=0.0)
        """Bytes that the node with most memory has for tasks."""
        self._task = self._ray.remote(num_cpus=1, num_gpus=gpus, max_retries=retries)(_trim_items)
        self._references: dict[Future[list[Outcome]], Any] = {}

    def submit(self, part: Part) -> Future[list[Outcome]]:
        """Have a task trim a part."""
        task = self._task.options(memory=int(PROCESS_BYTES + part.need))
        reference = task.remote(part.items, **self._options)
        future: Future[list[Outcome]] = reference.future()
        self._references[future] = reference
        return future

    def result(self, future: Future[list[Outcome]]) -> list[Outcome] | None:
        """What became of the items of a part; None if its task was lost."""
        del self._references[future]
        try:
            return future.result()
        except self._ray.exceptions.RayError:
            return None

    def close(self) -> None:
        """End all tasks, and the cluster if it was started for this."""
        for reference in self._references.values():
            self._ray.cancel(reference, force=True)
        if self._is_own:
            self._ray.shutdown()


def _trim_items(*arguments: Any, **options: Any) -> list[Outcome]:
    """`trim_items` on one processor."""
    import cv2
    import numba

    cv2.setNumThreads(1)
    numba.set_num_threads(1)
    return trim_items(*arguments, **options)


def _connect(address: str | None) -> tuple[Any, bool]:
    """Ray, connected to a cluster, and whether the cluster was started for this."""
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
    try:
        ray.init(log_to_driver=False, logging_level=logging.ERROR, **options)
    except (ConnectionError, RuntimeError, ValueError, TimeoutError) as error:
        place = "could be started here" if address is None else f"is at '{address}'"
        raise InputError(
            f"No Ray cluster {place} ({' '.join(str(error).split())[:300]}). One that asks for a token needs "
            "RAY_AUTH_MODE=token."
        ) from error
    return ray, address is None
