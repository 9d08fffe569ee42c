"""Which worker does what next: items stay with the worker that has read their scene, within a budget of memory.

Nothing here knows processes or clocks, so that a simulation can ask the same scheduler for a thousand workers.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

_FEWEST_TO_SHARE = 2
"""Items that must wait at a worker for another one to read the scene as well and take half of them."""


@dataclass
class SceneItems:
    """Items of one scene that no worker has."""

    scene: str
    items: list[int]
    need: float = 0.0
    """Bytes of memory that a worker needs to trim objects of this scene."""


@dataclass
class _Hand:
    """What a worker has."""

    scene: str = ""
    need: float = 0.0
    waiting: deque[int] = field(default_factory=deque)
    shared: bool = False
    """Whether others may take items of it: not before it is known which of them are finished already."""


class Schedule:
    """Hands out items. A worker takes a scene, then its items one by one, and takes again when it has none.

    Args:
        scenes: the items by scene, in the order in which they are to be done.
        budget: bytes of memory that the workers' scenes may take together.
    """

    def __init__(self, scenes: Sequence[SceneItems], budget: float = float("inf")) -> None:
        self._scenes = deque(scenes)
        self._budget = budget
        self._hands: dict[int, _Hand] = {}
        self._needs = {entry.scene: entry.need for entry in scenes}
        self._used = 0.0
        self._barren_at = -1
        """Changes when there was last nothing to take for anyone: thousands of idle workers ask again and again."""
        self.changes = 0
        """Grows whenever something may be taken that could not be taken before."""
        self.scenes_taken = 0
        """How many times a scene was taken, which is how many times one is read."""

    @property
    def barren(self) -> bool:
        """Whether there is nothing to take for anyone, until `changes` grows."""
        return self._barren_at == self.changes

    @property
    def waiting(self) -> int:
        """Number of items that no worker has begun."""
        return sum(len(entry.items) for entry in self._scenes) + sum(len(h.waiting) for h in self._hands.values())

    def take(self, worker: int) -> SceneItems | None:
        """A scene and items of it for a worker that has none: all of the scene's, or half of another worker's.

        None if nothing is left, or if what is left does not fit into the memory beside what the others have.
        """
        if self.barren:
            return None
        hand = self._hands.setdefault(worker, _Hand())
        assert not hand.waiting, "a worker takes when it has nothing"
        free = self._budget - self._used + hand.need
        for position, entry in enumerate(self._scenes):
            if entry.need <= free:
                del self._scenes[position]
                return self._give(worker, entry)
        shared = self._half_of_another(worker, free)
        return self._give(worker, shared) if shared else None

    def next_item(self, worker: int) -> int | None:
        """The next item of a worker's scene, or None."""
        hand = self._hands[worker]
        return hand.waiting.popleft() if hand.waiting else None

    def drop(self, worker: int, done: set[int]) -> None:
        """Items of a worker that need not be done after all; others may take some of the rest from now on."""
        hand = self._hands[worker]
        hand.waiting = deque(item for item in hand.waiting if item not in done)
        hand.shared = True
        self.changes += 1

    def items_of(self, worker: int) -> list[int]:
        """Items that wait at a worker."""
        return list(self._hands[worker].waiting) if worker in self._hands else []

    def release(self, worker: int) -> None:
        """The worker no longer holds a scene, because it died or let it go; its items wait for another worker."""
        hand = self._hands.pop(worker, None)
        self._used -= hand.need if hand else 0.0
        self.changes += 1
        if hand and hand.waiting:
            self._scenes.appendleft(SceneItems(hand.scene, list(hand.waiting), hand.need))

    def holds_scene(self, worker: int) -> bool:
        """Whether a worker takes memory for a scene."""
        return worker in self._hands and self._hands[worker].need > 0

    def all_waiting(self) -> list[int]:
        """Items that no worker has begun."""
        held = [item for hand in self._hands.values() for item in hand.waiting]
        return [item for entry in self._scenes for item in entry.items] + held

    def take_away(self, scene: str) -> list[int]:
        """Remove and return all items of a scene that no worker has begun."""
        gone = [item for entry in self._scenes if entry.scene == scene for item in entry.items]
        self._scenes = deque(entry for entry in self._scenes if entry.scene != scene)
        return gone

    def put_back(self, scene: str, items: list[int]) -> None:
        """Items that must be done again, or later."""
        self._scenes.append(SceneItems(scene, items, self._needs[scene]))
        self.changes += 1

    def _give(self, worker: int, entry: SceneItems) -> SceneItems:
        before = self._hands[worker].need
        self.changes += before > entry.need
        self._used += entry.need - before
        self._hands[worker] = _Hand(entry.scene, entry.need, deque(entry.items))
        self.scenes_taken += 1
        return entry

    def _half_of_another(self, worker: int, free: float) -> SceneItems | None:
        sharing = [h for h in self._hands.values() if h.shared and len(h.waiting) >= _FEWEST_TO_SHARE]
        if not sharing and not self._scenes:
            self._barren_at = self.changes
        richest = max((h for h in sharing if h.need <= free), key=lambda hand: len(hand.waiting), default=None)
        if richest is None:
            return None
        items = [richest.waiting.pop() for _ in range(len(richest.waiting) // 2)]
        return SceneItems(richest.scene, items[::-1], richest.need)


def shard_of(scenes: Sequence[SceneItems], number: int, of: int) -> list[SceneItems]:
    """The scenes of one of several machines, numbered from 1: each scene is on one, and all have about as many items.

    >>> scenes = [SceneItems("a", [0, 1, 2]), SceneItems("b", [3]), SceneItems("c", [4, 5])]
    >>> [entry.scene for entry in shard_of(scenes, 1, 2)], [entry.scene for entry in shard_of(scenes, 2, 2)]
    (['a'], ['b', 'c'])
    """
    loads = [(0, shard) for shard in range(of)]  # a heap
    mine = set()
    for position in sorted(range(len(scenes)), key=lambda i: -len(scenes[i].items)):
        load, shard = loads[0]
        heapq.heapreplace(loads, (load + len(scenes[position].items), shard))
        if shard == number - 1:
            mine.add(position)
    return [entry for position, entry in enumerate(scenes) if position in mine]
