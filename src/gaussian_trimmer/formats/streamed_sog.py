"""Streamed SOG, as large captures are published: lod-meta.json, and chunks that are SOGs.

A tree divides space into leaves. Each leaf says, for each level of detail (0 is the finest), which rows of which chunk
are its own; together, the leaves of a level are that level.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.formats import sog
from gaussian_trimmer.formats.packing import check_count
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.io.reading import file_bytes, is_file, path_inside, reading

META = "lod-meta.json"
"""What the file is called that lists levels and chunks."""
Box = Sequence[Sequence[float]]
"""Least and greatest corner, (2, 3)."""
_MAX_META_BYTES = 32 << 20
_MAX_LEVELS = 64
_CONTAINER_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")
_TRIM_BYTES_PER_SCENE_BYTE = 3.5
"""What a trim takes at most for each byte of the scene as arrays; measured."""
_SHARE_OF_MEMORY = 0.5
"""Of this machine's memory, what a level may take that nobody asked for by number."""


@dataclass(frozen=True, eq=False)
class Level:
    """The leaves of one level of detail, in the order of their rows."""

    runs: IntArray
    """Chunk, first row and number of rows of each leaf, (L, 3)."""
    bounds: Float64Array
    """Least and greatest corner of each leaf, (L, 2, 3)."""

    def __len__(self) -> int:
        """Return the number of Gaussians."""
        return int(self.runs[:, 2].sum())

    def touching(self, box: Box) -> Level:
        """Return the leaves that touch a box."""
        low, high = np.asarray(box, np.float64).reshape(2, 3)
        touch = ((self.bounds[:, 0] <= high) & (self.bounds[:, 1] >= low)).all(axis=1)
        return Level(self.runs[touch], self.bounds[touch])


@dataclass(frozen=True, eq=False)
class StreamedSog:
    """What a lod-meta.json says, checked as far as it can be without the chunks."""

    path: Path
    chunks: tuple[str, ...]
    """Names of the chunks' files, as seen from the folder."""
    environment: str | None
    """Name of the file of what surrounds the capture, such as a sky; it is never read."""
    levels: dict[int, Level]

    def chunks_of(self, level: Level) -> list[str]:
        """Return the names of the chunks that leaves need."""
        return [self.chunks[i] for i in np.unique(level.runs[:, 0])]

    def missing(self, level: Level) -> list[str]:
        """Return the names of the chunks of leaves that are not there."""
        return [name for name in self.chunks_of(level) if not is_file(self.path.parent / name)]

    @property
    def coarsest(self) -> int | None:
        """Number of the coarsest level of which all chunks are there; None if there is none."""
        return max((number for number, level in self.levels.items() if not self.missing(level)), default=None)

    def choose_level(self, wanted: int | None, box: Box | None = None) -> int:
        """Return the wanted level, or the finest that memory allows to work on; the coarsest if none does.

        Raises:
            InputError: there is no such level.
        """
        if wanted is not None:
            if wanted not in self.levels:
                raise InputError(f"'{self.path}' has no level {wanted}; its levels are {self._numbers()}.")
            return wanted
        allowed = _SHARE_OF_MEMORY * total_bytes() / _TRIM_BYTES_PER_SCENE_BYTE
        return next((n for n in self.levels if self.array_bytes(n, box) <= allowed), max(self.levels))

    def array_bytes(self, number: int, box: Box | None = None) -> int:
        """Return the bytes of a level's arrays, at most."""
        level = self.levels[number] if box is None else self.levels[number].touching(box)
        present = [path for name in self.chunks_of(level) if is_file(path := self.path.parent / name)]
        coefficients = 0 if present and sog.read_meta(present[0]).sh is None else 45
        return 4 * (14 + coefficients) * len(level)

    def describe(self, number: int) -> str:
        """Return a sentence on a level among the others."""
        left_out = (
            f"; its environment {clip_name(self.environment)} is left out" if self.environment is not None else ""
        )
        return f"level {number} (of {self._numbers()}), {len(self.levels[number]):,} Gaussians{left_out}"

    def _numbers(self) -> str:
        return ", ".join(map(str, self.levels))


def read(
    path: Path, level: int | None = None, bounds: Box | None = None, say: Callable[[str], None] = lambda text: None
) -> Gaussians:
    """Return the Gaussians of a level, chunk after chunk, rows in the chunks' order.

    Args:
        path: the lod-meta.json.
        level: 0 is the finest; None: the finest that this machine's memory allows to work on.
        bounds: only leaves that touch this box are read.
        say: called with a sentence on what is read and what is left out.

    Raises:
        InputError: a file cannot be read, is damaged, missing or outside the folder, announces more than it can hold,
            there is no such level, or nothing in the box.
    """
    streamed = open_streamed(path)
    number = streamed.choose_level(level, bounds)
    say(f"{path}: {streamed.describe(number)}")
    chosen = streamed.levels[number] if bounds is None else streamed.levels[number].touching(bounds)
    if len(chosen) == 0:
        raise InputError(f"No leaf of level {number} of '{path}' touches the box.")
    if missing := streamed.missing(chosen):
        whole = [other for other, leaves in streamed.levels.items() if not streamed.missing(leaves)]
        cure = f"level {whole[0]} is complete" if whole else "get all files of the capture"
        raise InputError(
            f"Chunks of level {number} of '{path}' are missing, {len(missing)} in all, such as "
            f"'{clip_name(missing[0])}'; {cure}."
        )
    return _assemble(streamed, chosen)


def scene_files(path: Path, level: int | None = None) -> list[Path]:
    """Return the files that a level consists of; errors as of `read`."""
    streamed = open_streamed(path)
    chunks = streamed.chunks_of(streamed.levels[streamed.choose_level(level)])
    return [path, *(file for name in chunks for file in sog.scene_files(path.parent / name))]


def _assemble(streamed: StreamedSog, level: Level) -> Gaussians:
    """Return the Gaussians of leaves, of which no more than one chunk is in memory beside what is returned."""
    paths = {i: streamed.path.parent / streamed.chunks[i] for i in np.unique(level.runs[:, 0])}
    for i, path in paths.items():
        _check_runs(level.runs[level.runs[:, 0] == i, 1:], sog.read_meta(path).count, path, streamed.path)
    files = [file for path in paths.values() for file in sog.scene_files(path)]
    check_count(len(level), streamed.path, sum(file.stat().st_size for file in files))
    arrays: dict[str, FloatArray] = {}
    start = 0
    with reading(*files):
        for i, path in paths.items():
            chunk = sog.read(path)
            for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"):
                values = getattr(chunk, name)
                whole = arrays.setdefault(name, np.empty((len(level), *values.shape[1:]), np.float32))
                if values.shape[1:] != whole.shape[1:]:
                    raise InputError(f"'{path}' has another SH degree than the chunks of '{streamed.path}' before it.")
                place = start
                for _, first, count in level.runs[level.runs[:, 0] == i]:
                    whole[place : place + count] = values[first : first + count]
                    place += count
            start = place
    return Gaussians(**arrays, model=chunk.model)  # type: ignore[arg-type]  # none of them is the extra columns


def _check_runs(runs: IntArray, count: int, chunk: Path, path: Path) -> None:
    """Refuse first rows and numbers of rows (R, 2), in order, that overlap or go beyond the rows of a chunk."""
    ends = runs.sum(axis=1)
    if ends[-1] > count or (runs[1:, 0] < ends[:-1]).any():
        raise InputError(f"'{path}' is damaged: its leaves ask for other rows than the {count} of '{chunk}'.")


def open_streamed(path: Path) -> StreamedSog:
    """Return what a lod-meta.json says.

    Raises:
        InputError: it cannot be read, is not that of a streamed SOG, or names a chunk twice or outside its folder.
    """
    data = file_bytes(path, _MAX_META_BYTES)
    try:
        document = json.loads(data)
        chunks = tuple(_chunk_name(name, path) for name in document["filenames"])
        if len({name.casefold() for name in chunks}) < len(chunks):
            raise ValueError("it names a chunk twice")
        leaves: dict[int, list[tuple[list[int], Any]]] = {}
        for bound, lods in _leaves(document["tree"]):
            for number, run in lods.items():
                leaves.setdefault(_whole(number, _MAX_LEVELS), []).append((_run(run, len(chunks)), bound))
        levels = {number: level for number in sorted(leaves) if len(level := _level(leaves[number]))}
        if not levels:
            raise ValueError("it has no leaf with a Gaussian")
        environment = document.get("environment")
    except (ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError) as error:
        raise InputError(f"'{path}' is not a streamed SOG, or damaged: {clip_name(str(error))}.") from error
    return StreamedSog(path, chunks, None if environment is None else clip_name(str(environment)), levels)


def _chunk_name(name: Any, path: Path) -> str:
    """Return the name of a chunk, without what changes nothing, such as './'."""
    inside = path_inside(path.parent, name)
    if inside is None or not name.lower().endswith((sog.META, ".sog")):
        raise ValueError(f"'{name}' does not name a SOG in its folder")
    return str(PurePosixPath(name))


def _leaves(tree: Any) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Give the box and the rows by level of each leaf."""
    pending = [tree]
    while pending:
        node = pending.pop()
        if "lods" in node:
            yield node["bound"], node["lods"]
        pending += node.get("children") or []


def _level(leaves: list[tuple[list[int], Any]]) -> Level:
    """Return leaves that have rows, in the order of their rows."""
    runs = np.array([run for run, _ in leaves], np.int64)  # (L, 3)
    bounds = np.array([[bound["min"], bound["max"]] for _, bound in leaves], np.float64).reshape(-1, 2, 3)
    if not np.isfinite(bounds).all():
        raise ValueError("a leaf has a bound that is not finite")
    order = np.lexsort((runs[:, 1], runs[:, 0]))
    order = order[runs[order, 2] > 0]
    return Level(runs[order], bounds[order])


def _run(entry: Any, n_chunks: int) -> list[int]:
    """Return chunk, first row and number of rows."""
    return [_whole(entry["file"], n_chunks), _whole(entry["offset"], 1 << 40), _whole(entry["count"], 1 << 40)]


def _whole(value: Any, limit: int) -> int:
    """Return a whole number below a limit, which text may hold."""
    number = int(value)
    if isinstance(value, (bool, float)) or not 0 <= number < limit:
        raise ValueError(f"{value} is not a whole number below {limit}")
    return number


def total_bytes() -> float:
    """Return the memory of this machine or container, in use or not; infinity where nobody says."""
    found = []
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        found.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for limit in _CONTAINER_LIMITS:
        with suppress(OSError, ValueError):
            found.append(int(Path(limit).read_text()))
    return float(min(found, default=float("inf")))
