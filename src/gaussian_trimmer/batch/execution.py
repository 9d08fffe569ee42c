"""Runs a batch: shares its parts out to processes, here or on a cluster, and collects what became of every item."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from gaussian_trimmer.batch.items import Item, check_items
from gaussian_trimmer.batch.local import LocalProcesses, cores
from gaussian_trimmer.batch.outcomes import Outcome, Status
from gaussian_trimmer.batch.ray_cluster import RayTasks
from gaussian_trimmer.batch.scenes import PROCESS_BYTES, Part, by_scene, shard_of
from gaussian_trimmer.batch.storage import Store
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.memory import free_bytes
from gaussian_trimmer.options import arg
from gaussian_trimmer.settings import Range, check_settings

_SHARE_OF_FREE = 0.8
"""Of the memory that is free when a batch begins, what it may take by default."""
_PARTS_OF_WORKER = 4
"""Into how many parts a worker's share of the items is divided, so that all workers end at about the same time."""
_MOST_ITEMS = 16
"""In one part, so that progress is seen."""
_MOST_WRITE_FAILURES = 3
"""In a row, after which it makes no sense to go on."""
_POLL_SECONDS = 0.5
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
    """How often an item whose worker died is tried again, alone."""
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
    scenes = by_scene(checked)
    if chosen.shard is not None:
        scenes = shard_of(scenes, *chosen.shard)
    names = {item.name for scene in scenes for item in scene.items}
    batch = _Batch(
        Path(output).absolute(), [item for item in checked if item.name in names], chosen, on_result, on_status
    )
    return batch.run(scenes)


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
        self._running: dict[Future[list[Outcome]], Part] = {}
        self._write_failures = 0

    def run(self, scenes: list[Part]) -> list[Outcome]:
        """Trim all items of scenes."""
        if scenes:
            engine, memory = self._engine(scenes)
            with self._cleaned_up(), closing(engine):
                size = -(-len(self._items) // (_PARTS_OF_WORKER * engine.workers))
                parts = deque(part for scene in scenes for part in scene.split(min(size, _MOST_ITEMS)))
                stopped = self._share_out(parts, engine, memory)
            for item in self._items:
                if item.name not in self._outcomes:
                    self._settle(Outcome(item, "left", stopped))
            self._tell_status()
            if stopped:
                raise InputError(stopped)
        return [self._outcomes[item.name] for item in self._items]

    def _share_out(self, waiting: deque[Part], engine: LocalProcesses | RayTasks, memory: float) -> str:
        """Have all parts trimmed; returns why the batch stopped early, if it did."""
        running = self._running
        while waiting or running:
            while len(running) < engine.workers and (part := _take(waiting, running.values(), memory)):
                running[engine.submit(part)] = part
            for future in wait(running, _POLL_SECONDS, FIRST_COMPLETED).done:
                part, outcomes = running.pop(future), engine.result(future)
                if outcomes is None:
                    waiting.extend(self._lost(part))
                for outcome in outcomes or ():
                    self._settle(outcome)
                    if self._write_failures >= _MOST_WRITE_FAILURES:
                        return (
                            f"{self._write_failures} items in a row could not be written, the last one because: "
                            f"{outcome.message} The batch has stopped; run it again when the cause is gone."
                        )
            self._tell_status()
        return ""

    @contextmanager
    def _cleaned_up(self) -> Iterator[None]:
        """Remove what processes leave that are stopped amid their work."""
        try:
            yield
        finally:
            for part in self._running.values():
                for item in part.items:
                    self._store.clean(item.name)

    def _lost(self, part: Part) -> Iterator[Part]:
        """The items of a part whose process died, one by one, to be tried again; or they have failed."""
        if len(part.items) > 1 or part.losses < self._options.retries:
            yield from replace(part, losses=part.losses + 1).split(1)
            return
        (item,) = part.items
        message = "The process that trimmed it died; the machine may have run out of memory."
        self._store.clean(item.name)
        self._store.record_failure(item.name, message, "")
        self._settle(Outcome(item, "failed", message))

    def _engine(self, scenes: list[Part]) -> tuple[LocalProcesses | RayTasks, float]:
        """What trims, and the memory that scenes may take at a time."""
        options, largest = self._options, max(scenes, key=lambda scene: scene.need)
        work = {"output": self._output, "retry_failed": options.retry_failed, "time_limit": options.time_limit}
        if options.engine == "ray":
            cluster = RayTasks(options.address, options.workers, options.gpus, options.retries, work)
            try:
                _check_memory(largest, cluster.most_memory, "no node of the cluster has more for tasks than")
            except InputError:
                cluster.close()
                raise
            return cluster, float("inf")
        memory = _SHARE_OF_FREE * free_bytes() if options.memory is None else 1e9 * options.memory
        _check_memory(largest, memory, "the batch may take, by --memory or by what is free,")
        fitting = min(len(self._items), (memory - largest.need) // PROCESS_BYTES)
        workers = max(1, int(min(options.workers or cores(), fitting)))
        return LocalProcesses(workers, work), memory - workers * PROCESS_BYTES

    def _settle(self, outcome: Outcome) -> None:
        if outcome.unwritten:
            self._write_failures += 1
        elif outcome.fresh and outcome.state == "done":
            self._write_failures = 0
        self._outcomes[outcome.item.name] = outcome
        self._counts.update([outcome.state] if outcome.fresh else [outcome.state, "found"])
        self._on_result(outcome)

    def _tell_status(self) -> None:
        counts = self._counts
        self._on_status(Status(len(self._items), counts["done"], counts["failed"], counts["found"]))


def _take(waiting: deque[Part], running: Collection[Part], memory: float) -> Part | None:
    """The next part that fits into memory beside those that are running; one that was lost before runs alone."""
    free = memory - sum(part.need for part in running)
    for part in waiting:
        if not running or not (part.losses or any(other.losses for other in running) or part.need > free):
            waiting.remove(part)
            return part
    return None


def _check_memory(largest: Part, memory: float, whose: str) -> None:
    if (need := PROCESS_BYTES + largest.need) > memory:
        raise InputError(
            f"Trimming '{largest.items[0].scene}' may take {need / 1e9:.1f} GB of memory, and {whose} "
            f"{memory / 1e9:.1f} GB; take a larger machine, or leave this scene out."
        )
