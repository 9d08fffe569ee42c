"""A batch of any size in simulated time: the program's own scheduler, with workers that are slow or die.

The driver is one server that spends some time on every request and every reply; storage is one pipe of some bandwidth
that all machines share. Both are what limits a batch beyond its workers.
"""

from __future__ import annotations

import heapq
import random
from dataclasses import dataclass
from typing import Annotated, Any

from gaussian_trimmer.batch.schedule import SceneItems, Schedule
from gaussian_trimmer.settings import Range

_HOUR = 3600.0
_BEYOND = 1e12
Number = Annotated[float, Range(0, _BEYOND)]


@dataclass(frozen=True)
class Plant:
    """What a simulated batch consists of; seconds and bytes are those that docs/scale.md states."""

    scenes: int = 10_000
    objects_per_scene: int = 100
    machines: int = 64
    cores: int = 16
    """Workers of a machine."""
    item_seconds: Number = 1.5
    """Median time of an item on one core."""
    item_spread: Number = 0.3
    """Standard deviation of its logarithm."""
    scene_bytes: Number = 250e6
    """Median size of a scene's file."""
    scene_spread: Number = 0.7
    read_seconds_per_byte: Number = 3.4e-9
    """Time of a core to hash and read a scene, beside the transfer."""
    output_bytes: Number = 0.0
    """What an item writes; 0: a background as large as the scene."""
    bandwidth: Number = 0.0
    """Bytes a second of the storage that all machines share; 0: no limit."""
    driver_seconds: Number = 0.0005
    """Time of the driver for each request with its reply."""
    failures_per_hour: Number = 0.01
    """Workers that die, per worker and hour; 0.01 is a spot machine that is taken away every four days."""
    start_seconds: Number = 5.0
    """Until a new worker can begin."""
    stragglers: Number = 0.01
    """Share of items that take `straggling` times as long."""
    straggling: Number = 20.0
    shards: int = 1
    """Drivers, each with its share of scenes and machines; the slowest one counts."""
    seed: int = 0


def simulate(plant: Plant) -> dict[str, Any]:
    """Hours, and where they went."""
    runs = [_Shard(plant, number).run() for number in range(plant.shards)]
    workers = plant.machines * plant.cores
    hours = max(run["seconds"] for run in runs) / _HOUR
    busy = sum(run["busy"] for run in runs) / _HOUR
    return {
        "items": plant.scenes * plant.objects_per_scene,
        "hours": round(hours, 3),
        "core_hours": round(hours * workers, 1),
        "core_hours_of_work": round(busy, 1),
        "efficiency": round(busy / (hours * workers), 4),
        "driver_busy": round(max(run["driver"] / run["seconds"] for run in runs), 4),
        "storage_busy": round(max(run["storage"] / run["seconds"] for run in runs), 4),
        "scenes_read": sum(run["reads"] for run in runs),
        "read_terabytes": round(sum(run["read"] for run in runs) / 1e12, 2),
        "written_terabytes": round(sum(run["written"] for run in runs) / 1e12, 2),
        "items_lost_to_failures": sum(run["lost"] for run in runs),
    }


class _Shard:
    """One driver and its workers."""

    def __init__(self, plant: Plant, number: int) -> None:
        self._plant, self._rng = plant, random.Random(1000 * plant.seed + number)
        n_scenes = plant.scenes // plant.shards + (number < plant.scenes % plant.shards)
        rng = self._rng
        self._sizes = [plant.scene_bytes * rng.lognormvariate(0, plant.scene_spread) for _ in range(n_scenes)]
        per = plant.objects_per_scene
        self._schedule = Schedule([SceneItems(str(s), list(range(s * per, s * per + per))) for s in range(n_scenes)])
        self._left = n_scenes * per
        self._workers = max(1, plant.machines * plant.cores // plant.shards)
        self._bandwidth = plant.bandwidth / plant.shards
        self._driver = self._storage = 0.0  # when each is free again
        self._told = dict.fromkeys(("driver", "storage", "busy", "read", "written"), 0.0)
        self._counts = {"reads": 0, "lost": 0}

    def run(self) -> dict[str, float]:
        """Do everything; returns seconds, bytes and counts."""
        self._events: list[tuple[float, int, str]] = [(0.0, worker, "free") for worker in range(self._workers)]
        heapq.heapify(self._events)
        self._scene: dict[int, int] = {}
        self._item: dict[int, int] = {}
        parked: list[int] = []
        tried, now = -1, 0.0
        while self._left:
            now, worker, what = heapq.heappop(self._events)
            if what == "checked":  # The driver asks it to read the scene.
                size = self._sizes[self._scene[worker]]
                ready = self._use_storage(self._use_driver(now), size) + size * self._plant.read_seconds_per_byte
                self._later(ready, worker, "read")
            elif what == "computed":
                self._later(self._use_storage(now, self._written(worker)), worker, "done")
            elif what == "lost":
                self._schedule.put_back(str(self._scene.pop(worker)), [self._item.pop(worker)])
                self._schedule.release(worker)
                self._counts["lost"] += 1
                self._later(now + self._plant.start_seconds, worker, "free")
            else:
                self._left -= what == "done"
                if not self._give(now, worker):
                    parked.append(worker)
            if parked and self._schedule.changes != tried:
                tried = self._schedule.changes
                while parked and self._give(now, parked[-1]):
                    parked.pop()
        return {"seconds": now, **self._told, **self._counts}

    def _give(self, now: float, worker: int) -> bool:
        """Give a worker its next item, or a scene; False if there is none."""
        item = self._schedule.next_item(worker) if worker in self._scene else None
        if item is not None:
            self._trim(self._use_driver(now), worker, item)
            return True
        entry = self._schedule.take(worker)
        if entry is None:
            return False
        self._schedule.drop(worker, set())
        self._scene[worker] = int(entry.scene)
        self._counts["reads"] += 1
        self._told["read"] += self._sizes[self._scene[worker]]
        self._later(self._use_driver(now), worker, "checked")
        return True

    def _trim(self, now: float, worker: int, item: int) -> None:
        plant, rng = self._plant, self._rng
        self._item[worker] = item
        seconds = plant.item_seconds * rng.lognormvariate(0, plant.item_spread)
        if rng.random() < plant.stragglers:
            seconds *= plant.straggling
        if rng.random() < seconds * plant.failures_per_hour / _HOUR:
            self._later(now + seconds * rng.random(), worker, "lost")
            return
        self._told["busy"] += seconds
        self._told["written"] += self._written(worker)
        self._later(now + seconds, worker, "computed")

    def _written(self, worker: int) -> float:
        return self._plant.output_bytes or self._sizes[self._scene[worker]]

    def _later(self, when: float, worker: int, what: str) -> None:
        heapq.heappush(self._events, (when, worker, what))

    def _use_driver(self, now: float) -> float:
        self._driver = max(self._driver, now) + self._plant.driver_seconds
        self._told["driver"] += self._plant.driver_seconds
        return self._driver

    def _use_storage(self, now: float, size: float) -> float:
        if not self._bandwidth:
            return now
        seconds = size / self._bandwidth
        self._storage = max(self._storage, now) + seconds
        self._told["storage"] += seconds
        return self._storage
