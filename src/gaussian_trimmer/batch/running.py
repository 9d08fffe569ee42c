"""Runs a batch: shares its items out to processes, here or on a cluster, and collects what became of every item."""

from __future__ import annotations

import heapq
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from gaussian_trimmer.batch.items import Item, check_items
from gaussian_trimmer.batch.memory import PROCESS_BYTES, scene_need
from gaussian_trimmer.batch.processes import LocalProcess, LocalProcesses, cores
from gaussian_trimmer.batch.ray_cluster import RayActor, RayCluster
from gaussian_trimmer.batch.store import Outcome, Store
from gaussian_trimmer.batch.trimming import SECONDS_TO_COMPILE, Scene
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.memory import free_bytes
from gaussian_trimmer.options import arg
from gaussian_trimmer.settings import Range, check_settings

_SHARE_OF_FREE = 0.8
"""Of the memory that is free when a batch begins, what it may take by default."""
_MOST_WRITE_FAILURES = 3
"""In a row, after which it makes no sense to go on."""
_POLL_SECONDS = 0.5
SceneKey = tuple[str, int | None]
"""Path and level of detail."""
_ShardNumber = Annotated[int, Range(1, 1_000_000)]


@dataclass(frozen=True)
class BatchOptions:
    """How a batch is run."""

    workers: Annotated[int, Range(1, 100_000)] | None = None
    """Number of worker processes. By default one for each processor of this machine or cluster."""
    engine: Literal["local", "ray"] = "local"
    """Where the workers run: on this machine, or on a Ray cluster (needs gaussian-trimmer[ray])."""
    address: Annotated[str | None, arg(metavar="ADDRESS")] = None
    """Address of the Ray cluster, or auto for the one that this machine is part of. By default one is started here."""
    gpus: Annotated[float, Range(0, 1000)] = 0.0
    """GPUs for each worker of a cluster; may be a fraction."""
    shard: Annotated[tuple[_ShardNumber, _ShardNumber] | None, arg(metavar="I/N")] = None
    """Only this machine's share of the scenes: number I, from 1, of N machines."""
    time_limit: Annotated[float, Range(1e-3, 1e9)] | None = None
    """Seconds that one item may take, reading its scene included."""
    retries: Annotated[int, Range(0, 100)] = 1
    """How often an item whose worker died is tried again, after all others and alone."""
    retry_failed: bool = False
    """Try again what failed in an earlier run."""
    memory: Annotated[float, Range(1e-3, 1e9)] | None = None
    """Gigabytes that all workers on this machine may take together. By default 80 % of what is free."""

    def check(self) -> None:
        """Refuse what is not possible.

        Raises:
            InputError: an option is out of its range, or means nothing beside another.
        """
        check_settings(self)
        if self.engine == "local" and (self.gpus or self.address is not None):
            raise InputError("An address and GPUs are those of a cluster; leave them out, or use the engine ray.")
        if self.engine == "ray" and self.memory is not None:
            raise InputError("Ray shares out the memory of a cluster itself; leave the memory out.")
        if self.shard is not None and self.shard[0] > self.shard[1]:
            raise InputError(f"The shard is {self.shard[0]}/{self.shard[1]}; give i/n with i from 1 to n.")


def run(
    items: Iterable[Item],
    output: str | Path,
    *,
    on_result: Callable[[Outcome], None] = lambda outcome: None,
    on_status: Callable[[Status], None] = lambda status: None,
    **options: Any,
) -> list[Outcome]:
    """Trim many objects of many scenes; returns an outcome for every item, in their order.

    The results of an item are a folder `items/NAME` in the output, whole or absent. An item whose inputs and settings
    are the same as in an earlier run is not trimmed again; one that failed then is tried again only with
    `retry_failed`, unless a full disk or the like was to blame. Several runs may share one output.

    Args:
        items: what to trim; `read_manifest` gives those of a file.
        output: the folder.
        on_result: called with every outcome as it comes, in this thread.
        on_status: called about twice a second.
        options: fields of `BatchOptions`, such as `workers=4`.

    Raises:
        InputError: an item or an option is not possible, a scene needs more memory than there is, or nothing can be
            written to the output. Whatever happens to a single item is in its outcome.
    """
    chosen, checked = BatchOptions(**options), check_items(items)
    chosen.check()
    scenes: dict[SceneKey, list[Item]] = {}
    for item in checked:
        scenes.setdefault((item.scene, item.level), []).append(item)
    if chosen.shard is not None:
        scenes = shard_of(scenes, *chosen.shard)
        checked = [item for item in checked if (item.scene, item.level) in scenes]
    return _Batch(Path(output).absolute(), checked, chosen, on_result, on_status).run(scenes)


def shard_of(scenes: dict[SceneKey, list[Item]], number: int, of: int) -> dict[SceneKey, list[Item]]:
    """Return the scenes of one of several machines, numbered from 1; each has about as many items.

    >>> a, b = Item("a.ply", name="x"), Item("b.ply", name="y")
    >>> list(shard_of({("a", None): [a, a, a], ("b", None): [b], ("c", None): [b, b]}, 2, 2))
    [('b', None), ('c', None)]
    """
    loads = [(0, shard) for shard in range(of)]  # a heap
    mine = set()
    for scene in sorted(scenes, key=lambda scene: -len(scenes[scene])):
        load, shard = loads[0]
        heapq.heapreplace(loads, (load + len(scenes[scene]), shard))
        if shard == number - 1:
            mine.add(scene)
    return {scene: items for scene, items in scenes.items() if scene in mine}


@dataclass(frozen=True)
class Status:
    """How far a batch is."""

    total: int
    done: int
    failed: int
    found: int
    """Those of `done` and `failed` that are from an earlier run."""


@dataclass
class _Worker:
    """A process, and what it has to do."""

    process: LocalProcess | RayActor
    scene: SceneKey
    item: Item
    since: float = field(default_factory=time.monotonic)
    granted: float = SECONDS_TO_COMPILE
    """Seconds beyond the time limit."""


class _Batch:
    """The state of one run."""

    def __init__(
        self,
        output: Path,
        items: list[Item],
        options: BatchOptions,
        on_result: Callable[[Outcome], None],
        on_status: Callable[[Status], None],
    ) -> None:
        self._output, self._items, self._options = output, items, options
        self._on_result, self._on_status = on_result, on_status
        self._store = Store(output)
        self._outcomes: dict[str, Outcome] = {}
        self._counts = Counter[str]()
        self._needs: dict[SceneKey, float] = {}
        self._waiting: dict[SceneKey, deque[Item]] = {}
        self._running: dict[Future[Outcome | None], _Worker] = {}
        self._lost: deque[Item] = deque()
        self._losses = Counter[str]()
        self._write_failures = 0

    def run(self, scenes: dict[SceneKey, list[Item]]) -> list[Outcome]:
        """Trim all items of scenes."""
        if not scenes:
            return []
        self._needs = {scene: scene_need(*scene) for scene in scenes}
        self._engine, self._memory = self._start_engine()
        stopped = None
        try:
            with closing(self._engine):
                self._share_out(scenes, self._engine.workers)
                while self._lost:
                    item = self._lost.popleft()
                    self._share_out({(item.scene, item.level): [item]}, 1)
        except _StoppedEarly as stop:
            stopped = stop
        finally:
            for worker in self._running.values():
                self._store.clean(worker.item.name)
        if stopped is not None:
            for worker in self._running.values():
                self._settle_if_done(worker.item)
            for item in self._items:
                if item.name not in self._outcomes:
                    self._settle(Outcome(item, "left", str(stopped)))
        self._tell_status()
        if stopped is not None:
            raise InputError(str(stopped)) from stopped
        return [self._outcomes[item.name] for item in self._items]

    def _share_out(self, scenes: dict[SceneKey, list[Item]], workers: int) -> None:
        """Have all items of scenes trimmed by so many workers; those that were lost are left to be tried again."""
        self._waiting = {scene: deque(items) for scene, items in scenes.items()}
        running = self._running
        while self._waiting or running:
            while len(running) < workers and (scene := self._next_scene()) is not None:
                self._give(_Worker(self._engine.start(self._needs[scene]), scene, self._items[0]))
            for future in wait(running, _POLL_SECONDS, FIRST_COMPLETED).done:
                worker = running[future]
                try:
                    outcome = future.result()
                except self._engine.lost as error:
                    self._lose(worker, error)
                    del running[future]
                    continue
                del running[future]
                if outcome is None:  # Another run is writing it.
                    self._waiting.setdefault(worker.scene, deque()).append(worker.item)
                else:
                    self._settle(outcome)
                worker.granted = 0.0
                self._give(worker)
            self._tell_status()

    def _next_scene(self) -> SceneKey | None:
        """Return a scene that fits into memory beside those at work: one that nobody has, or the one with most left."""
        free = self._memory - sum(self._needs[worker.scene] for worker in self._running.values())
        fitting = (scene for scene in self._waiting if self._needs[scene] <= free or not self._running)
        at_work = Counter(worker.scene for worker in self._running.values())
        best = None
        for scene in fitting:
            if not at_work[scene]:
                return scene
            if best is None or len(self._waiting[scene]) > len(self._waiting[best]):
                best = scene
        return best

    def _give(self, worker: _Worker) -> None:
        """Give a worker its next item, of the scene that it has if possible, or end it."""
        scene = worker.scene if worker.scene in self._waiting else self._next_scene()
        if scene is None:
            worker.process.end()
            return
        if not worker.process.fits(self._needs[scene]):
            worker.process.end()
            worker.process, worker.granted = self._engine.start(self._needs[scene]), SECONDS_TO_COMPILE
        items = self._waiting[scene]
        worker.scene, worker.item, worker.since = scene, items.popleft(), time.monotonic()
        if not items:
            del self._waiting[scene]
        self._running[worker.process.submit(worker.item)] = worker

    def _lose(self, worker: _Worker, error: Exception) -> None:
        """Try the item of a worker that died again later, or say that it has failed."""
        worker.process.end()
        try:
            self._engine.check()
        except InputError as gone:
            raise _StoppedEarly(str(gone)) from error
        item, limit = worker.item, self._options.time_limit
        self._store.clean(item.name)
        self._losses[item.name] += 1
        if limit is not None and time.monotonic() - worker.since >= limit + worker.granted:
            message = f"It took longer than the time limit of {limit:g} seconds."
            failed = Outcome(item, "failed", message, fingerprint=_fingerprint(item))
        elif self._losses[item.name] <= self._options.retries:
            self._lost.append(item)
            return
        else:
            message = "The process that trimmed it died; the machine may have run out of memory."
            failed = Outcome(item, "failed", message)
        self._store.record(failed)
        self._settle(failed)

    def _settle_if_done(self, item: Item) -> None:
        """Count an item as done that was finished while its worker was lost."""
        found = self._store.earlier(item, _fingerprint(item))
        if found is not None and found.state == "done":
            self._settle(found)

    def _start_engine(self) -> tuple[LocalProcesses | RayCluster, float]:
        """Return what starts workers, and the memory that scenes may take at a time."""
        options, largest = self._options, max(self._needs, key=lambda scene: self._needs[scene])
        work = {"output": self._output, "retry_failed": options.retry_failed, "time_limit": options.time_limit}
        if options.engine == "ray":
            cluster = RayCluster(options.address, options.workers, options.gpus, work)
            try:
                self._check_memory(largest, cluster.most_memory, "no node of the cluster has more for tasks than")
            except InputError:
                cluster.close()
                raise
            return cluster, float("inf")
        memory = _SHARE_OF_FREE * free_bytes() if options.memory is None else 1e9 * options.memory
        self._check_memory(largest, memory, "the batch may take, by --memory or by what is free,")
        fitting = min(len(self._items), (memory - self._needs[largest]) // PROCESS_BYTES)
        workers = max(1, int(min(options.workers or cores(), fitting)))
        return LocalProcesses(workers, work), memory - workers * PROCESS_BYTES

    def _check_memory(self, largest: SceneKey, memory: float, whose: str) -> None:
        if (need := PROCESS_BYTES + self._needs[largest]) > memory:
            raise InputError(
                f"Trimming '{largest[0]}' may take {need / 1e9:.1f} GB of memory, and {whose} "
                f"{memory / 1e9:.1f} GB; take a larger machine, or leave this scene out."
            )

    def _settle(self, outcome: Outcome) -> None:
        """Take note of what became of an item, and stop where nothing can be written."""
        if outcome.unwritten:
            self._write_failures += 1
        elif outcome.fresh and outcome.state == "done":
            self._write_failures = 0
        self._outcomes[outcome.item.name] = outcome
        self._counts.update([outcome.state] if outcome.fresh else [outcome.state, "found"])
        self._on_result(outcome)
        if outcome.unwritten and self._write_failures >= _MOST_WRITE_FAILURES:
            raise _StoppedEarly(
                f"{self._write_failures} items in a row could not be written, the last one because: {outcome.message} "
                "The batch has stopped; run it again when the cause is gone."
            )

    def _tell_status(self) -> None:
        counts = self._counts
        self._on_status(Status(len(self._items), counts["done"], counts["failed"], counts["found"]))


def _fingerprint(item: Item) -> str:
    """Return the digest of an item; nothing if an input cannot be read, so that the next run tries again."""
    with suppress(InputError, OSError):
        return Scene(item).fingerprint(item)
    return ""


class _StoppedEarly(Exception):  # noqa: N818
    """The batch cannot go on."""
