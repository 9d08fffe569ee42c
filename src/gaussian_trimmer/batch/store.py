"""What a batch writes: all of an item in `items/NAME`, whole or not there, and how it went in `records/NAME.json`."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from gaussian_trimmer.batch.items import Item
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.manifest import is_complete
from gaussian_trimmer.io.reading import read_json
from gaussian_trimmer.io.writing import atomic_folder, remove_leftovers, write_json, write_whole
from gaussian_trimmer.output.saving import RESULTS, result_files
from gaussian_trimmer.settings import from_plain, to_plain

ITEM = "item.json"


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
    """Why the selection was returned unchanged; empty if it was trimmed."""
    up_confidence: float = 0.0
    seconds: float = 0.0
    """How long the trim took, without reading the scene."""
    fingerprint: str = ""
    """Digest of its inputs and settings."""
    unwritten: bool = False
    """It failed because the output cannot be written, as on a full disk, and may be written by the next run."""


@dataclass(frozen=True)
class Finished:
    """The `item.json` of a finished item: nothing that differs from run to run."""

    name: str
    fingerprint: str
    counts: dict[str, int]
    views: tuple[int, int]
    refused: str | None
    up_confidence: float


@dataclass(frozen=True)
class _Record:
    """How an item went, in `records`."""

    name: str
    fingerprint: str
    message: str = ""
    """Why it failed; empty if it is done."""
    seconds: float = 0.0
    traceback: str = ""


class Store:
    """The output of a batch, in a folder."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def earlier(self, item: Item, fingerprint: str | None = None) -> Outcome | None:
        """Return what an earlier run left of an item, with this fingerprint if one is given; None if nothing whole."""
        found, record = self._finished(item.name), self._record(item.name)
        if found is not None and fingerprint in (None, found.fingerprint):
            known = record is not None and not record.message and record.fingerprint == found.fingerprint
            return outcome_of(item, found, record.seconds if record is not None and known else 0.0, fresh=False)
        if record is not None and record.message and fingerprint in (None, record.fingerprint):
            return Outcome(item, "failed", record.message, fresh=False, fingerprint=record.fingerprint)
        return None

    def record(self, outcome: Outcome, traceback: str = "") -> None:
        """Note how an item went; where nothing can be written, the next run tries a failed one again."""
        name = outcome.item.name
        record = _Record(name, outcome.fingerprint, outcome.message, round(outcome.seconds, 3), traceback)
        with suppress(OSError, InputError):
            self.write(f"records/{name}.json", json.dumps(to_plain(record), indent=1) + "\n")

    @contextmanager
    def result_folder(self, name: str, suffix: str, inputs: Iterable[Path]) -> Iterator[Path]:
        """Give a folder to write an item's files to; on success they are published whole.

        Raises:
            InputError: another run is writing this item, or it cannot be written.
        """
        folder = self._root / "items" / name
        folder.parent.mkdir(parents=True, exist_ok=True)
        names = (*result_files(suffix), ITEM)
        whole: AbstractContextManager[Path] = atomic_folder(folder, RESULTS, names=names, inputs=inputs, overwrite=True)
        with whole as part:
            yield part

    def write(self, name: str, text: str) -> None:
        """Write a small file whole.

        Raises:
            InputError: it cannot be written.
            OSError: likewise.
        """
        path = self._root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)

    def clean(self, name: str) -> None:
        """Remove what a process that was killed has left beside the results of an item."""
        remove_leftovers(self._root / "items" / name)

    def _finished(self, name: str) -> Finished | None:
        """Return the `item.json` of an item; None unless all its files are there, as large as they were written."""
        folder = self._root / "items" / name
        found: Finished | None = _read(folder / ITEM, Finished)
        if found is None or not all(isinstance(number, int) for number in found.counts.values()):
            return None
        return found if is_complete(folder) else None

    def _record(self, name: str) -> _Record | None:
        record: _Record | None = _read(self._root / "records" / f"{name}.json", _Record)
        return record


def outcome_of(item: Item, found: Finished, seconds: float, *, fresh: bool) -> Outcome:
    """Return the outcome of an item that is done."""
    return Outcome(
        item,
        "done",
        fresh=fresh,
        counts=found.counts,
        views=found.views,
        refused=found.refused or "",
        up_confidence=found.up_confidence,
        seconds=seconds,
        fingerprint=found.fingerprint,
    )


def write_finished(found: Finished, folder: Path) -> None:
    """Write the `item.json` of an item.

    Raises:
        InputError: it cannot be written.
    """
    write_json(to_plain(found), folder / ITEM)


def _read(path: Path, kind: Any) -> Any:
    """Return what a JSON file holds as a dataclass; None if it is missing or damaged."""
    with suppress(InputError, OSError):
        return from_plain(read_json(path), kind, "")
    return None
