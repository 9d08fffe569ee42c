"""Runs a batch: shares scenes out to workers, here or on a cluster, and collects what became of every item."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from gaussian_trimmer.batch.items import Item, check_items, is_address
from gaussian_trimmer.batch.local import POLL_SECONDS, LocalWorkers
from gaussian_trimmer.batch.outcomes import Outcome, Status
from gaussian_trimmer.batch.ray_cluster import RayTasks
from gaussian_trimmer.batch.scenes import PROCESS_BYTES, SceneItems, by_scene, free_bytes, shard_of
from gaussian_trimmer.batch.storage import open_store
from gaussian_trimmer.batch.worker import WorkerSettings, cores
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.settings import Range, check_settings

_SHARE_OF_FREE = 0.8
"""Of the memory that is free when a batch begins, what it may take by default."""
_COMPILING_BYTES = 512 << 20
"""What a worker may take beyond its share while it compiles kernels."""
_MOST_WRITE_FAILURES = 3
"""In a row, after which it makes no sense to go on."""


_ShardNumber = Annotated[int, Range(1, 1_000_000)]


@dataclass(frozen=True)
class BatchOptions:
    """How a batch is run."""

    workers: Annotated[int, Range(1, 100_000)] | None = None
    """Number of worker processes; None: one for each processor of this machine or of the cluster."""
    engine: Literal["local", "ray"] = "local"
    """`local`, or `ray` for a Ray cluster."""
    address: str | None = None
    """Address of the cluster, "auto" for the one this machine is part of; None: one is started here."""
    gpus: Annotated[float, Range(0, 1000)] = 0.0
    """What each worker takes of the GPUs of a cluster."""
    shard: tuple[_ShardNumber, _ShardNumber] | None = None
    """(i, n): only the scenes of the i-th of n machines, from 1."""
    time_limit: Annotated[float, Range(1e-3, 1e9)] | None = None
    """Seconds that one item, with the reading of its scene, may take."""
    retries: Annotated[int, Range(0, 100)] = 1
    """How many times an item is tried again, alone, whose worker has died."""
    retry_failed: bool = False
    """Try those items again that failed in an earlier run."""
    memory: Annotated[float, Range(1, 1e18)] | None = None
    """Bytes that all workers on this machine may take together; None: most of what is free."""

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
        output: folder, or address of a store that fsspec opens.
        on_result: called with every outcome as it comes, in this thread.
        on_status: called about twice a second.
        options: fields of `BatchOptions`, such as `workers=4`.

    Raises:
        InputError: an item or an option is not possible, a scene needs more memory than there is, or nothing can be
            written to the output. Whatever happens to a single item is in its outcome.
    """
    chosen, checked = BatchOptions(**options), check_items(items)
    chosen.check()
    return _Batch(checked, output, chosen, on_result, on_status).run()


class _Batch:
    """The state of one run."""

    def __init__(
        self,
        items: Sequence[Item],
        output: str | Path,
        options: BatchOptions,
        on_result: Callable[[Outcome], None],
        on_status: Callable[[Status], None],
    ) -> None:
        scenes = by_scene(items)
        self._scenes = scenes if options.shard is None else shard_of(scenes, *options.shard)
        mine = {item.name for entry in self._scenes for item in entry.items}
        self._items = [item for item in items if item.name in mine]
        self._store = open_store(output)
        self._output = str(output) if is_address(str(output)) else str(Path(output).absolute())
        self._options, self._on_result, self._on_status = options, on_result, on_status
        self._outcomes: dict[str, Outcome] = {}
        self._counts = Counter[str]()
        self._write_failures, self._stopped, self._told_at = 0, "", 0.0

    def run(self) -> list[Outcome]:
        """Try every item, and those whose workers died, or that another run was writing, once more and alone."""
        for attempt in range(self._options.retries + 1):
            left = [entry.without(self._outcomes) for entry in self._scenes]
            left = [entry for entry in left if entry.items]
            if not left or self._stopped:
                break
            engine = self._open_engine(left, alone=attempt > 0)
            with closing(engine.outcomes()) as outcomes:
                for outcome in outcomes:
                    if outcome is not None:
                        self._take(outcome, again=attempt < self._options.retries)
                    self._tell_status(engine)
                    if self._stopped:
                        break
        for item in self._items:
            if item.name not in self._outcomes:
                self._settle(Outcome(item, "left", self._stopped))
        self._tell_status(None)
        if self._stopped:
            raise InputError(self._stopped)
        return [self._outcomes[item.name] for item in self._items]

    def _open_engine(self, scenes: Sequence[SceneItems], *, alone: bool) -> LocalWorkers | RayTasks:
        options = self._options
        settings = WorkerSettings(self._output, options.retry_failed, options.time_limit)
        if options.engine == "ray":
            parts = [part for entry in scenes for part in entry.parts(1)] if alone else scenes
            return RayTasks(parts, settings, options.address, options.workers, options.gpus, options.retries)
        memory = _SHARE_OF_FREE * free_bytes() if options.memory is None else options.memory
        largest = _largest_need(scenes, memory)
        n_items = sum(len(entry.items) for entry in scenes)
        fitting = n_items if memory == float("inf") else int((memory - largest) // PROCESS_BYTES)
        workers = 1 if alone else max(1, min(options.workers or cores(), fitting, n_items))
        share = max(memory / workers, PROCESS_BYTES + largest) + _COMPILING_BYTES
        limit = None if memory == float("inf") else int(share)
        threads = max(1, cores() // workers)
        settings = WorkerSettings(self._output, options.retry_failed, options.time_limit, limit, threads)
        return LocalWorkers(scenes, settings, workers, memory - workers * PROCESS_BYTES)

    def _take(self, outcome: Outcome, *, again: bool) -> None:
        """See to an outcome; one that may be tried again is left out."""
        if outcome.cause in ("worker", "busy"):
            if again:
                return
            if outcome.cause == "worker":
                self._store.record_failure(outcome.item.name, outcome.message, outcome.fingerprint)
        if outcome.cause == "output":
            self._write_failures += 1
        elif outcome.fresh and outcome.state == "done":
            self._write_failures = 0
        self._settle(outcome)
        if self._write_failures >= _MOST_WRITE_FAILURES:
            self._stopped = (
                f"{self._write_failures} items in a row could not be written, the last one because: "
                f"{outcome.message} The batch has stopped; run it again when the cause is gone."
            )

    def _settle(self, outcome: Outcome) -> None:
        self._outcomes[outcome.item.name] = outcome
        self._counts.update([outcome.state] if outcome.fresh else [outcome.state, "found"])
        self._on_result(outcome)

    def _tell_status(self, engine: LocalWorkers | RayTasks | None) -> None:
        now = time.monotonic()
        if engine is not None and now - self._told_at < POLL_SECONDS:
            return
        self._told_at = now
        running = {} if engine is None else dict(engine.running)
        self._on_status(
            Status(
                total=len(self._items),
                done=self._counts["done"],
                failed=self._counts["failed"],
                found=self._counts["found"],
                running={number: (name, now - since) for number, (name, since) in running.items()},
            )
        )


def _largest_need(scenes: Sequence[SceneItems], memory: float) -> float:
    """Bytes of memory that the largest scene needs.

    Raises:
        InputError: that is more than there is.
    """
    largest = max(scenes, key=lambda entry: entry.need)
    if largest.need + PROCESS_BYTES > memory:
        raise InputError(
            f"Trimming '{largest.scene}' may take {(largest.need + PROCESS_BYTES) / 1e9:.1f} GB of memory, and the "
            f"batch may take {memory / 1e9:.1f} GB; free some, take a larger machine, or allow more with --memory."
        )
    return largest.need
