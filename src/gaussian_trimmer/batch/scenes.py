"""Parts of a batch: items of one scene, and how much memory they take, estimated from the size of the scene's file."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from gaussian_trimmer import formats
from gaussian_trimmer.batch.items import Item
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.memory import TRIM_BYTES_PER_SCENE_BYTE

PROCESS_BYTES = 400 << 20
"""What a worker takes without a scene: the interpreter, libraries, compiled kernels, pictures of views."""
_BYTES_PER_FILE_BYTE = {
    ".ply": 1.0,
    ".compressed.ply": 4.0,
    ".splat": 2.0,
    ".ksplat": 4.0,
    ".spz": 12.0,
    ".sog": 48.0,
    ".glb": 1.2,
    "meta.json": 48.0,
    "lod-meta.json": 48.0,
    ".ckpt": 1.0,
    ".pth": 1.0,
    ".pt": 1.0,
}
"""Bytes of a scene's arrays for each byte of its file, at most, in files as programs write them; a .glb with plain
attributes."""


@dataclass(frozen=True)
class Part:
    """Items of one scene that are trimmed one after the other."""

    items: tuple[Item, ...]
    need: float = 0.0
    """Bytes of memory that this takes beside `PROCESS_BYTES`."""
    losses: int = 0
    """How many times it was lost with its process."""

    def split(self, size: int) -> Iterator[Part]:
        """The same items in parts of at most so many."""
        for start in range(0, len(self.items), size):
            yield replace(self, items=self.items[start : start + size])


def by_scene(items: Sequence[Item]) -> list[Part]:
    """A part for each scene, in the order of their first items."""
    groups: dict[tuple[str, int | None], list[Item]] = {}
    for item in items:
        groups.setdefault((item.scene, item.level), []).append(item)
    return [Part(tuple(group), scene_need(*scene)) for scene, group in groups.items()]


def shard_of(scenes: Sequence[Part], number: int, of: int) -> list[Part]:
    """The scenes of one of several machines, numbered from 1: each scene is on one, and all have about as many items.

    >>> a, b = Item("a.ply", name="x"), Item("b.ply", name="y")
    >>> [len(part.items) for part in shard_of([Part((a, a, a)), Part((b,)), Part((b, b))], 2, 2)]
    [1, 2]
    """
    loads = [(0, shard) for shard in range(of)]  # a heap
    mine = set()
    for position in sorted(range(len(scenes)), key=lambda i: -len(scenes[i].items)):
        load, shard = loads[0]
        heapq.heapreplace(loads, (load + len(scenes[position].items), shard))
        if shard == number - 1:
            mine.add(position)
    return [part for position, part in enumerate(scenes) if position in mine]


def scene_need(scene: str, level: int | None = None) -> float:
    """Bytes of memory that a worker takes, beside `PROCESS_BYTES`, to trim objects of a scene; 0 if it is missing."""
    with suppress(InputError, OSError):  # Whoever reads the scene will say what is wrong with it.
        file = formats.find_scene(Path(scene))
        suffix, files = formats.format_suffix(file), formats.scene_files(file, level)
        size = sum(path.stat().st_size for path in files)
        return TRIM_BYTES_PER_SCENE_BYTE * _BYTES_PER_FILE_BYTE[suffix] * size
    return 0.0
