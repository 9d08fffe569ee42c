"""A batch on a Ray cluster: tasks, each for a part of a scene's items, which Ray places, and repeats if they are lost.

A task has a worker of its own on its node, as a batch on one machine has: an item that kills it, or takes too long,
costs the task nothing else.
"""

from __future__ import annotations

import logging
import os
import re
import socket
from collections.abc import Generator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from pathlib import Path
from typing import Any

from gaussian_trimmer.batch.items import Item
from gaussian_trimmer.batch.local import POLL_SECONDS
from gaussian_trimmer.batch.outcomes import Outcome
from gaussian_trimmer.batch.scenes import PROCESS_BYTES, SceneItems
from gaussian_trimmer.batch.worker import Worker, WorkerSettings
from gaussian_trimmer.errors import InputError

_SECONDS_TO_ANSWER = 10.0
_LONGEST_REASON = 400
_PARTS_OF_WORKER = 4
"""Into how many tasks a worker's share of the items is divided, so that all workers end at about the same time."""


class RayTasks:
    """Tasks on a Ray cluster.

    Args:
        address: that of the cluster, "auto" for the one this machine is part of; None: one is started here.
        workers: number of tasks at a time; None: as many as the cluster has processors.
        gpus: what a task takes of a GPU.
        retries: how many times Ray repeats a task that is lost with its node.

    Raises:
        InputError: Ray is not installed, there is no such cluster, or no node has enough memory for a scene.
    """

    def __init__(
        self,
        scenes: Sequence[SceneItems],
        settings: WorkerSettings,
        address: str | None,
        workers: int | None,
        gpus: float,
        retries: int,
    ) -> None:
        self._ray, self._own = _connect(address)
        self._settings, self._options = settings, {"num_cpus": 1, "num_gpus": gpus, "max_retries": retries}
        nodes = [node["Resources"] for node in self._ray.nodes() if node["Alive"]]
        self._at_once = workers or max(1, int(sum(node.get("CPU", 0) for node in nodes)))
        try:
            _check_memory(scenes, max((node.get("memory", 0) for node in nodes), default=0))
        except InputError:
            self._disconnect()
            raise
        total = sum(len(entry.items) for entry in scenes)
        self._parts = [part for e in scenes for part in e.parts(-(-total // (_PARTS_OF_WORKER * self._at_once)))]
        self.running: dict[int, tuple[str, float]] = {}

    def outcomes(self) -> Generator[Outcome | None, None, None]:
        """Trim everything, and give outcomes as they come; None about twice a second where none comes."""
        waiting, running = list(reversed(self._parts)), dict[Any, SceneItems]()
        try:
            while waiting or running:
                while waiting and len(running) < self._at_once:
                    part = waiting.pop()
                    running[self._submit(part)] = part
                finished, _ = self._ray.wait(list(running), num_returns=1, timeout=POLL_SECONDS)
                for reference in finished:
                    yield from self._result(reference, running.pop(reference))
                if not finished:
                    yield None
        finally:
            for reference in running:
                self._ray.cancel(reference, force=True)
            self._disconnect()

    def _submit(self, part: SceneItems) -> Any:
        need = int(PROCESS_BYTES + part.need)
        options = {**self._options, "memory": need, "runtime_env": {"env_vars": {"PYTHONPATH": _source_path()}}}
        return self._ray.remote(trim_part).options(**options).remote(part.items, self._settings)

    def _result(self, reference: Any, part: SceneItems) -> list[Outcome]:
        try:
            found: list[Outcome] = self._ray.get(reference)
        except self._ray.exceptions.RayError as error:
            message = f"Its worker was lost ({_reason(error)})."
            return [Outcome(item, "failed", message, cause="worker") for item in part.items]
        return found

    def _disconnect(self) -> None:
        if self._own:
            self._ray.shutdown()


_kept: tuple[WorkerSettings, str | None, Worker] | None = None
"""The worker of this process of Ray's, which Ray gives one task after another, with what it was made for."""


def trim_part(items: Sequence[Item], settings: WorkerSettings) -> list[Outcome]:
    """What becomes of items; the task."""
    global _kept
    gpus = os.environ.get("CUDA_VISIBLE_DEVICES")
    if _kept is None or _kept[:2] != (settings, gpus):
        if _kept is not None:
            _kept[2].close()
        _kept = settings, gpus, Worker(settings)
    worker = _kept[2]
    try:
        return [worker.trim(item) for item in items]
    finally:
        with suppress(BrokenProcessPool):
            worker.release_scene()


def _check_memory(scenes: Sequence[SceneItems], most: float) -> None:
    largest = PROCESS_BYTES + max(entry.need for entry in scenes)
    if largest > most:
        raise InputError(
            f"A worker may take {largest / 1e9:.1f} GB of memory, and no node of the cluster has more than "
            f"{most / 1e9:.1f} GB for tasks; add larger nodes, or leave the largest scenes out."
        )


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
    if address is not None:
        _check_address(address)
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    logging.getLogger("ray").setLevel(logging.ERROR)  # `init` sets it too late, after messages about tokens.
    # Without an address, `init` would join the cluster that was started last on this machine.
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


def _check_address(address: str) -> None:
    """Refuse an address where nobody answers: Ray would try it for minutes."""
    if address in ("auto", "local"):
        return
    found = re.fullmatch(r"(?:ray://)?\[?([^\]/]+?)\]?:(\d{1,5})", address)
    if not found:
        raise InputError(f"'{address}' is not the address of a Ray cluster; give host:port, or auto.")
    try:
        socket.create_connection((found[1], int(found[2])), _SECONDS_TO_ANSWER).close()
    except (OSError, OverflowError) as error:
        raise InputError(f"There is no Ray cluster at '{address}' ({error}).") from error


def _reason(error: Exception) -> str:
    """The last sentences of what Ray says, without the lines that name actors and addresses."""
    lines = [line.strip() for line in str(error).splitlines() if not line.startswith("\t")]
    return " ".join(filter(None, lines))[-_LONGEST_REASON:] or type(error).__name__


def _source_path() -> str:
    """The folders from which this process imports, so that workers on this machine import the same."""
    here = str(Path(__file__).parents[2])
    return os.pathsep.join(dict.fromkeys([here, *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]))
