"""Runs a batch: hands items to workers, minds their deadlines and deaths, and tells what became of every item."""

from __future__ import annotations

import json
import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol

from gaussian_trimmer.batch.items import Item, check_items, item_as_json
from gaussian_trimmer.batch.memory import PROCESS_BYTES, SHARE_OF_FREE, free_bytes, scene_need
from gaussian_trimmer.batch.schedule import SceneItems, Schedule, shard_of
from gaussian_trimmer.batch.storage import Store, is_address, open_store
from gaussian_trimmer.errors import InputError

Json = dict[str, Any]
_POLL = 0.5
_BUSY_PAUSE = 1.0
_START_SECONDS = 300.0
"""What a new worker is granted beyond the time limit: it loads libraries, and may have to compile kernels."""
_STILL_SECONDS = 2.0
"""A driver that looks later than this has stood still, and its workers with it: a machine that was paused or choked."""
_ROOM_SECONDS = 10.0
"""For how long a worker may wait for room beside workers that have nothing to do, before these are ended."""
_WRITE_FAILURES, _START_FAILURES = 3, 5
"""In a row, after which it makes no sense to go on."""


class Engine(Protocol):
    """Workers, wherever they are. They are numbered by the driver."""

    def room(self, need: float) -> int:
        """How many workers there can be that take so many bytes each."""
        ...

    def prepare(self, workers: int, need: float) -> None:
        """Say how many workers there will be, and how many bytes each takes."""
        ...

    def start(self, worker: int) -> None:
        """Start a worker."""
        ...

    def send(self, worker: int, request: Json) -> None:
        """Send a request to a worker that has answered the one before."""
        ...

    def wait(self, seconds: float) -> list[tuple[int, Json]]:
        """Replies that have come, waiting for the first no longer than this; {"death": words} where a worker died."""
        ...

    def without_room(self) -> set[int]:
        """Workers that were started and wait for room."""
        ...

    def kill(self, worker: int) -> None:
        """End a worker, whatever it is doing."""
        ...

    def close(self) -> None:
        """End all workers."""
        ...


@dataclass(frozen=True)
class Outcome:
    """What became of an item."""

    item: Item
    state: Literal["done", "failed", "left"]
    """`left`: it was not tried, since the batch stopped early."""
    message: str = ""
    """Why it failed, in one sentence."""
    fresh: bool = True
    """Whether this run did it; otherwise it was found finished, or failed, from an earlier one."""
    counts: dict[str, int] = field(default_factory=dict)
    """Numbers of Gaussians; see `TrimResult.report`."""
    views: tuple[int, int] = (0, 0)
    """How many views were accepted, of how many."""
    refused: str = ""
    """Why the coarse selection was returned unchanged; empty if it was trimmed."""
    up_confidence: float = 0.0
    seconds: float = 0.0
    """Time that a worker took for it, without reading the scene; 0 if another run did it."""
    fingerprint: str = ""
    """What tells its inputs and settings from others."""


@dataclass(frozen=True)
class Status:
    """How far a batch is."""

    total: int
    done: int
    found: int
    """Those of `done` that were finished before this run."""
    failed: int
    running: dict[int, tuple[str, float]]
    """What each worker is at: a name, and for how many seconds."""
    scenes_read: int


@dataclass
class _Slot:
    """A worker as the driver sees it."""

    number: int
    alive: bool = False
    fresh: bool = True
    doing: str = ""
    """The request under way: check, read, trim or release; empty if there is none."""
    scene: str = ""
    item: int | None = None
    is_read: bool = False
    started: float = 0.0
    since: float = 0.0
    deadline: float = float("inf")


def run(
    items: Iterable[Item],
    output: str | Path,
    *,
    workers: int | None = None,
    engine: str = "local",
    address: str | None = None,
    gpus: float = 0.0,
    shard: tuple[int, int] | None = None,
    time_limit: float | None = None,
    retries: int = 2,
    retry_failed: bool = False,
    memory: float | None = None,
    on_result: Callable[[Outcome], None] = lambda outcome: None,
    on_status: Callable[[Status], None] = lambda status: None,
) -> list[Outcome]:
    """Trim many objects of many scenes; returns an outcome for every item, in their order.

    The results of an item are a folder `items/NAME` in the output, whole or absent. An item whose inputs and settings
    are the same as in an earlier run is not trimmed again; one that failed then is tried again with `retry_failed`
    alone, unless a full disk or the like was to blame. Several runs may share one output.

    Args:
        items: what to trim; `read_manifest` gives those of a file.
        output: folder, or address of a store that fsspec opens.
        workers: number of processes; by default one for each processor, or, on a cluster, as many as it has room for.
        engine: "local", or "ray" for a Ray cluster.
        address: that of the cluster, "auto" for the one this machine is part of; by default one is started here.
        gpus: what each worker takes of the GPUs of a cluster.
        shard: (i, n): only those scenes that are the i-th of n machines', from 1.
        time_limit: seconds that one item, or the reading of one scene, may take.
        retries: how many times an item is tried again whose worker has died.
        retry_failed: try those again that failed in an earlier run.
        memory: bytes that all workers may take together; by default most of what is free.
        on_result: called with every outcome as it comes, in this thread.
        on_status: called about twice a second.

    Raises:
        InputError: an item or an argument is not possible, a scene needs more memory than there is, or nothing can be
            written to the output. Whatever a single item comes to is told by its outcome.
    """
    checked = check_items(items)
    _check_arguments(workers, engine, gpus, shard, time_limit, retries, memory)
    store = open_store(output)
    scenes = by_scene(checked)
    if shard is not None:
        scenes = shard_of(scenes, *shard)
    if not scenes:
        return []
    limit = _memory_limit(memory, engine)
    largest = _largest(scenes, limit)
    need = PROCESS_BYTES + largest
    place = str(output) if is_address(str(output)) else str(Path(output).absolute())
    crew = _open_engine(engine, place, address, gpus)
    try:
        n_workers = _number_of_workers(scenes, workers or crew.room(need), limit, largest)
        crew.prepare(n_workers, need)
        budget = limit - n_workers * PROCESS_BYTES
        driver = _Driver(
            checked, store, Schedule(scenes, budget), time_limit, retries, retry_failed, on_result, on_status
        )
        driver.run(crew, n_workers)
    finally:
        crew.close()
    driver.settle_the_rest()
    return [driver.outcomes[number] for number in sorted(driver.outcomes)]


def by_scene(items: Sequence[Item]) -> list[SceneItems]:
    """The numbers of the items by scene, each with the memory it needs."""
    groups: dict[str, list[int]] = {}
    for number, item in enumerate(items):
        groups.setdefault(item.scene, []).append(number)
    return [SceneItems(scene, numbers, _need(scene)) for scene, numbers in groups.items()]


def _need(scene: str) -> float:
    size = 0
    with suppress(OSError, ValueError):
        if is_address(scene):
            from gaussian_trimmer.batch.storage import size_of

            size = size_of(scene)
        else:
            size = os.stat(scene).st_size  # noqa: PTH116
    return scene_need(scene, size)


def _check_arguments(
    workers: int | None, engine: str, gpus: float, shard: tuple[int, int] | None, time_limit: float | None,
    retries: int, memory: float | None,
) -> None:  # fmt: skip
    if engine not in ("local", "ray"):
        raise InputError(f"Unknown engine '{engine}'; available: local, ray.")
    if workers is not None and not 1 <= workers <= 100_000:
        raise InputError(f"The number of workers is {workers}; it must be from 1 to 100000.")
    if not 0 <= gpus <= 1000:
        raise InputError(f"The GPUs of a worker are {gpus}; they must be from 0 to 1000.")
    if gpus and engine != "ray":
        raise InputError("Workers on this machine share its GPUs; leave the number of GPUs out, or use the engine ray.")
    if shard is not None and not 1 <= shard[0] <= shard[1]:
        raise InputError(f"The shard is {shard[0]}/{shard[1]}; give i/n with i from 1 to n.")
    if time_limit is not None and not time_limit > 0:
        raise InputError(f"The time limit is {time_limit} seconds; it must be more than 0.")
    if not 0 <= retries <= 100:
        raise InputError(f"The number of retries is {retries}; it must be from 0 to 100.")
    if memory is not None and not memory > 0:
        raise InputError(f"The memory is {memory} bytes; it must be more than 0.")


def _memory_limit(memory: float | None, engine: str) -> float:
    if memory is not None:
        return memory
    return float("inf") if engine == "ray" else SHARE_OF_FREE * free_bytes()


def _largest(scenes: Sequence[SceneItems], limit: float) -> float:
    """Bytes of memory that the largest scene needs.

    Raises:
        InputError: that is more than there is.
    """
    largest = max(scenes, key=lambda entry: entry.need)
    if largest.need + PROCESS_BYTES > limit:
        raise InputError(
            f"Trimming '{largest.scene}' may take {(largest.need + PROCESS_BYTES) / 1e9:.1f} GB of memory, and the "
            f"batch may take {limit / 1e9:.1f} GB; free some, take a larger machine, or allow more with --memory."
        )
    return largest.need


def _number_of_workers(scenes: Sequence[SceneItems], wished: int, limit: float, largest: float) -> int:
    """As many workers as wished, but no more than there are items, or than leave memory for the largest scene."""
    fitting = wished if limit == float("inf") else int((limit - largest) // PROCESS_BYTES)
    return max(1, min(wished, fitting, sum(len(entry.items) for entry in scenes)))


def _open_engine(engine: str, output: str, address: str | None, gpus: float) -> Engine:
    if engine == "ray":
        from gaussian_trimmer.batch.ray_cluster import RayEngine

        return RayEngine(output, address, gpus=gpus)
    from gaussian_trimmer.batch.local import LocalEngine

    return LocalEngine(output)


class _Driver:
    """The state of one run."""

    def __init__(
        self, items: Sequence[Item], store: Store, schedule: Schedule, time_limit: float | None, retries: int,
        retry_failed: bool, on_result: Callable[[Outcome], None], on_status: Callable[[Status], None],
    ) -> None:  # fmt: skip
        self._items, self._store, self._schedule = items, store, schedule
        self._limit = float("inf") if time_limit is None else time_limit
        self._retries, self._retry_failed = retries, retry_failed
        self._on_result, self._on_status = on_result, on_status
        self.outcomes: dict[int, Outcome] = {}
        self._mine = sorted(schedule.all_waiting())
        self._total = len(self._mine)
        self._json: dict[int, tuple[Any, Any]] = {}
        self._deaths: dict[int | str, int] = {}
        self._marks: dict[int, str] = {}
        self._later: deque[tuple[float, str, int]] = deque()
        self._numbers = {item.name: number for number, item in enumerate(items)}
        self._write_failures = self._start_failures = 0
        self._stopped = ""
        self._slots: dict[int, _Slot] = {}
        self._tried_at = -1
        """Changes of the schedule when every worker without work was last given some."""
        self._done = self._found = self._failed = 0
        self._last_look = 0.0
        self._last_turn = float("inf")
        self._crowded = False
        """Whether workers wait for room: then no more are started."""

    def run(self, engine: Engine, workers: int) -> None:
        """Do everything, unless nothing can be written or no worker be started."""
        self._engine = engine
        self._slots = {number: _Slot(number) for number in range(workers)}
        while len(self.outcomes) < self._total:
            self._bring_back()
            if not self._stopped and self._schedule.changes != self._tried_at:
                self._tried_at = self._schedule.changes
                for slot in [slot for slot in self._slots.values() if not slot.doing]:
                    if self._crowded and not slot.alive:
                        continue
                    self._give(slot)
                    if self._schedule.barren:
                        break
            if self._stopped and not any(slot.doing for slot in self._slots.values()):
                break
            for number, reply in engine.wait(self._patience()):
                self._take(self._slots[number], reply)
                if not self._slots[number].doing and not self._stopped:
                    self._give(self._slots[number])
            self._look_around()

    def settle_the_rest(self) -> None:
        """Tell of what was not tried.

        Raises:
            InputError: the batch had to stop.
        """
        for number in self._mine:
            if number not in self.outcomes:
                self._settle(number, Outcome(self._items[number], "left", self._stopped))
        self._tell_status(time.monotonic())
        if self._stopped:
            raise InputError(self._stopped)

    # Handing out

    def _give(self, slot: _Slot) -> None:
        """Give a worker that does nothing its next request, if there is one."""
        item = self._schedule.next_item(slot.number) if slot.scene else None
        if item is not None:
            slot.item = item
            if slot.is_read:
                self._send_trim(slot)
            else:
                self._send(slot, "read", {})
            return
        entry = self._schedule.take(slot.number)
        if entry is not None:
            slot.scene, slot.is_read, slot.item = entry.scene, False, None
            items = [item_as_json(self._items[i], self._json) for i in entry.items]
            request = {"scene": entry.scene, "items": items, "retry_failed": self._retry_failed}
            self._send(slot, "check", request)
        elif slot.alive and self._schedule.holds_scene(slot.number) and self._schedule.waiting:
            slot.scene = ""
            self._send(slot, "release", {})

    def _send_trim(self, slot: _Slot) -> None:
        assert slot.item is not None
        self._send(slot, "trim", {"name": self._items[slot.item].name})

    def _send(self, slot: _Slot, what: str, request: Json) -> None:
        if not slot.alive:
            self._engine.start(slot.number)
            slot.alive, slot.fresh, slot.started = True, True, time.monotonic()
        slot.doing = what
        self._set_clock(slot, time.monotonic())
        self._engine.send(slot.number, {"do": what, **request})

    def _set_clock(self, slot: _Slot, now: float) -> None:
        slot.since = now
        slot.deadline = now + self._limit + (_START_SECONDS if slot.fresh else 0)

    def _bring_back(self) -> None:
        """Have items tried again that another run was writing."""
        now = time.monotonic()
        while self._later and self._later[0][0] <= now:
            _, scene, number = self._later.popleft()
            self._schedule.put_back(scene, [number])

    # Taking in

    def _take(self, slot: _Slot, reply: Json) -> None:
        """See to a reply, or to the death of a worker."""
        if "death" in reply:
            self._take_death(slot, str(reply["death"]))
            return
        self._start_failures = 0
        what, slot.doing, slot.deadline = slot.doing, "", float("inf")
        if what == "check":
            self._take_check(slot, reply)
        elif what == "read":
            if "error" in reply:
                self._fail_scene(slot, reply)
            else:
                slot.is_read = True
                self._send_trim(slot)
        elif what == "trim":
            slot.fresh = False
            self._take_trim(slot, reply)
        else:
            self._schedule.release(slot.number)

    def _take_check(self, slot: _Slot, reply: Json) -> None:
        if "error" in reply:
            self._fail_scene(slot, reply)
            return
        settled = set()
        for name, mark in reply["fingerprints"].items():
            self._marks[self._numbers[name]] = mark
        for name, told in reply["finished"].items():
            settled.add(self._numbers[name])
            self._finish(self._numbers[name], told, 0.0, fresh=False)
        for name, record in reply["failed"].items():
            number = self._numbers[name]
            settled.add(number)
            message, mark = str(record.get("message", "")), self._marks[number]
            self._settle(number, Outcome(self._items[number], "failed", message, fresh=False, fingerprint=mark))
        for name, broken in reply["broken"].items():
            settled.add(self._numbers[name])
            self._fail(self._numbers[name], broken)
        self._schedule.drop(slot.number, settled)

    def _take_trim(self, slot: _Slot, reply: Json) -> None:
        number, slot.item = slot.item, None
        assert number is not None
        if reply.get("busy"):
            self._later.append((time.monotonic() + _BUSY_PAUSE, slot.scene, number))
            return
        # The worker has its next item before anything else is done with this one.
        if "error" in reply and reply.get("write"):
            self._write_failures += 1
            if self._write_failures >= _WRITE_FAILURES:
                self._stopped = (
                    f"{self._write_failures} items in a row could not be written, the last one because: "
                    f"{reply['error']} The batch has stopped; run it again when the cause is gone."
                )
        if not self._stopped:
            self._give(slot)
        if "error" in reply:
            self._fail(number, reply)
        else:
            self._write_failures = 0
            self._finish(number, reply["finished"], reply["wall"], fresh="seconds" in reply)

    def _take_death(self, slot: _Slot, words: str) -> None:
        what, scene, item = slot.doing, slot.scene, slot.item
        self._bury(slot)
        self._start_failures += 1
        if self._start_failures >= _START_FAILURES * len(self._slots):
            self._stopped = f"Workers die before they do anything: the last one {words}."
            if item is not None:
                self._schedule.put_back(scene, [item])
            return
        key = item if item is not None and what == "trim" else scene
        if not what or not scene:
            return
        self._deaths[key] = self._deaths.get(key, 0) + 1
        who = "Its worker" if what == "trim" else f"The worker that was to {what} '{scene}'"
        sentence = f"{who} {words}; that happened {self._deaths[key]} times."
        tried_enough = self._deaths[key] > self._retries
        if what == "trim" and item is not None:
            if tried_enough:
                self._fail(item, {"error": sentence})
            else:
                self._schedule.put_back(scene, [item])
        elif tried_enough:
            rest = self._schedule.take_away(scene)
            for number in ([item] if item is not None else []) + rest:
                self._fail(number, {"error": sentence})
        elif item is not None:
            self._schedule.put_back(scene, [item])

    def _bury(self, slot: _Slot) -> None:
        slot.alive, slot.doing, slot.scene, slot.item = False, "", "", None
        slot.is_read, slot.deadline = False, float("inf")
        self._schedule.release(slot.number)

    def _look_around(self) -> None:
        """Now and then, look for deadlines that have passed, and tell how far the batch is."""
        now = time.monotonic()
        self._excuse_standstill(now)
        if now - self._last_look < _POLL:
            return
        self._last_look = now
        self._make_room(now)
        self._mind_deadlines(now)
        self._tell_status(now)

    def _excuse_standstill(self, now: float) -> None:
        """Count no time in which the driver could not look: what stopped it has most likely stopped its workers too."""
        still, self._last_turn = now - self._last_turn, now
        if still > _STILL_SECONDS:
            for slot in self._slots.values():
                slot.deadline += still

    def _make_room(self, now: float) -> None:
        """End workers that have nothing to do where others wait for their place, and let no clock run for these."""
        waiting = [self._slots[number] for number in self._engine.without_room()]
        for slot in waiting:
            self._set_clock(slot, now)
        if self._crowded and not waiting:
            self._tried_at = -1
        self._crowded = bool(waiting)
        if any(now - slot.started > _ROOM_SECONDS for slot in waiting):
            for slot in self._slots.values():
                if slot.alive and not slot.doing:
                    self._engine.kill(slot.number)
                    self._bury(slot)

    def _mind_deadlines(self, now: float) -> None:
        for slot in self._slots.values():
            if not slot.doing or now < slot.deadline:
                continue
            what, scene, item = slot.doing, slot.scene, slot.item
            self._engine.kill(slot.number)
            if what == "trim" and item is not None:
                self._bury(slot)
                self._fail(item, {"error": f"It took longer than the time limit of {self._limit:g} seconds."})
            else:
                rest = ([item] if item is not None else []) + self._schedule.items_of(slot.number)
                self._schedule.drop(slot.number, set(rest))
                self._bury(slot)
                for number in rest:
                    words = f"To {what} '{scene}' took longer than the time limit of {self._limit:g} seconds."
                    self._fail(number, {"error": words})

    # Outcomes

    def _fail_scene(self, slot: _Slot, reply: Json) -> None:
        """All items of a scene that cannot be read have failed."""
        rest = ([slot.item] if slot.item is not None else []) + self._schedule.items_of(slot.number)
        self._schedule.drop(slot.number, set(rest))
        slot.item = None
        for number in rest:
            self._fail(number, reply)

    def _fail(self, number: int, reply: Json) -> None:
        item, message = self._items[number], str(reply["error"])
        mark = "" if reply.get("surroundings") else self._marks.get(number, "")
        record = {"name": item.name, "state": "failed", "message": message, "fingerprint": mark}
        if "traceback" in reply:
            record["traceback"] = reply["traceback"]
        with suppress(InputError, OSError):  # Where nothing can be written, the next run tries it again.
            self._store.clean(item.name)
            self._store.write(f"records/{item.name}.json", json.dumps(record, indent=1) + "\n")
        self._settle(number, Outcome(item, "failed", message, fingerprint=self._marks.get(number, "")))

    def _finish(self, number: int, told: Json, seconds: float, *, fresh: bool) -> None:
        self._settle(number, outcome_of(self._items[number], told, seconds if fresh else 0.0, fresh=fresh))

    def _settle(self, number: int, outcome: Outcome) -> None:
        self.outcomes[number] = outcome
        self._done += outcome.state == "done"
        self._found += outcome.state == "done" and not outcome.fresh
        self._failed += outcome.state == "failed"
        self._on_result(outcome)

    # Time

    def _patience(self) -> float:
        """For how long replies may be waited for, in seconds."""
        return max(0.0, min(_POLL, self._later[0][0] - time.monotonic())) if self._later else _POLL

    def _tell_status(self, now: float) -> None:
        running = {slot.number: (self._label(slot), now - slot.since) for slot in self._slots.values() if slot.doing}
        taken = self._schedule.scenes_taken
        self._on_status(Status(self._total, self._done, self._found, self._failed, running, taken))

    def _label(self, slot: _Slot) -> str:
        if slot.doing == "trim" and slot.item is not None:
            return self._items[slot.item].name
        return f"{slot.doing} {slot.scene}"


def outcome_of(item: Item, told: Json, seconds: float = 0.0, *, fresh: bool = False) -> Outcome:
    """The outcome of an item that is finished, from what its `item.json` says."""
    views = told.get("views") or (0, 0)
    return Outcome(
        item, "done", "", fresh, dict(told.get("counts") or {}), (int(views[0]), int(views[1])),
        str(told.get("refused") or ""), float(told.get("up_confidence") or 0.0), seconds,
        str(told.get("fingerprint") or ""),
    )  # fmt: skip
