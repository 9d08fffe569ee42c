"""A batch on the processors of this machine: a thread for each worker, which hands it one item after another."""

from __future__ import annotations

import queue
import threading
import time
from collections import deque
from collections.abc import Generator, Sequence

from gaussian_trimmer.batch.items import Item
from gaussian_trimmer.batch.outcomes import Outcome
from gaussian_trimmer.batch.scenes import SceneItems
from gaussian_trimmer.batch.worker import Worker, WorkerSettings

POLL_SECONDS = 0.5
_SECONDS_TO_END = 5.0


class LocalWorkers:
    """Workers on this machine, which share the items out among themselves.

    A worker does the items of one scene, then takes a scene that no other has, and when there is none, helps with the
    scene of which most items wait. Scenes are in memory at the same time only while they fit.

    Args:
        memory: bytes that the scenes of all workers may take together.
    """

    def __init__(self, scenes: Sequence[SceneItems], settings: WorkerSettings, workers: int, memory: float) -> None:
        self._waiting = {entry.scene: deque(entry.items) for entry in scenes}
        self._needs = {entry.scene: entry.need for entry in scenes}
        self._memory, self._stopped = memory, False
        self._held: dict[int, str] = {}
        """The scene that each worker has in memory."""
        self._lock = threading.Lock()
        self._events: queue.SimpleQueue[Outcome | BaseException | None] = queue.SimpleQueue()
        self._workers = [Worker(settings) for _ in range(workers)]
        self.running: dict[int, tuple[str, float]] = {}
        """What each worker is at, and since when."""

    def outcomes(self) -> Generator[Outcome | None, None, None]:
        """Trim everything, and give outcomes as they come; None about twice a second where none comes."""
        threads = [threading.Thread(target=self._serve, args=(i,), daemon=True) for i in range(len(self._workers))]
        for thread in threads:
            thread.start()
        try:
            serving = len(threads)
            while serving:
                try:
                    event = self._events.get(timeout=POLL_SECONDS)
                except queue.Empty:
                    yield None
                    continue
                if isinstance(event, BaseException):
                    raise event
                if event is None:
                    serving -= 1
                else:
                    yield event
        finally:
            self._end(threads)

    def _end(self, threads: Sequence[threading.Thread]) -> None:
        self._stopped = True
        for worker in self._workers:
            worker.stop()
        end = time.monotonic() + _SECONDS_TO_END
        for thread, worker in zip(threads, self._workers, strict=True):
            thread.join(max(0.0, end - time.monotonic()))
            if thread.is_alive():
                worker.kill()
                thread.join(_SECONDS_TO_END)

    def _serve(self, number: int) -> None:
        """Have one worker do items until there are no more."""
        try:
            with self._workers[number] as worker:
                while any(self._waiting.values()) and not self._stopped:
                    item = self._take(number)
                    if item is None:  # What waits does not fit into memory beside what others have.
                        worker.close()
                        time.sleep(POLL_SECONDS)
                        continue
                    self.running[number] = item.name, time.monotonic()
                    self._events.put(worker.trim(item))
                    del self.running[number]
        except BaseException as error:
            self._events.put(error)
        finally:
            self._held.pop(number, None)
            self._events.put(None)

    def _take(self, number: int) -> Item | None:
        """The next item of a worker, or None if it must wait until others have less in memory."""
        with self._lock:
            held = self._held.pop(number, None)
            if held is None or not self._waiting[held]:
                held = self._choose_scene()
            if held is None:
                return None
            self._held[number] = held
            return self._waiting[held].popleft()

    def _choose_scene(self) -> str | None:
        others = list(self._held.values())
        free = self._memory - sum(self._needs[scene] for scene in others)
        fitting = [scene for scene, items in self._waiting.items() if items and self._needs[scene] <= free]
        unread = (scene for scene in fitting if scene not in others)
        return next(unread, max(fitting, key=lambda scene: len(self._waiting[scene]), default=None))
