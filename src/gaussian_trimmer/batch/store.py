"""What a batch writes: all of an item in `items/NAME`, whole or not there, and how it went in `records/NAME.json`."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field, replace
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
    warnings: tuple[str, ...] = ()
    """What may be wrong although it was trimmed, a sentence each."""
    shrunk_side: str = ""
    """What one of these says of a side from which much of the selection was taken; empty if none does."""
    up_confidence: float = 0.0
    seconds: float = 0.0
    """How long the trim took, without reading the scene."""
    fingerprint: str = ""
    """Digest of its inputs and settings."""
    unwritten: bool = False
    """It failed because the output cannot be written, as on a full disk, and may be written by the next run."""

    @property
    def told(self) -> str:
        """What there is to say of it: why it failed or was not trimmed, or what may be wrong."""
        return self.message or self.refused or " ".join(self.warnings)


_RESULT = ("fingerprint", "counts", "views", "refused", "warnings", "shrunk_side", "up_confidence")
"""What the `item.json` of a finished item says of its outcome: nothing that differs from run to run."""
_COURSE = ("fingerprint", "message", "seconds")
"""What `records` say of how an item went; without a message it is done."""


class Store:
    """The output of a batch, in a folder."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def earlier(self, item: Item, fingerprint: str | None = None) -> Outcome | None:
        """Return what an earlier run left of an item, with this fingerprint if one is given; None if nothing whole."""
        found, record = self._finished(item), self._record(item)
        if found is not None and fingerprint in (None, found.fingerprint):
            known = record is not None and not record.message and record.fingerprint == found.fingerprint
            return replace(found, seconds=record.seconds) if record is not None and known else found
        if record is not None and record.message and fingerprint in (None, record.fingerprint):
            return record
        return None

    def record(self, outcome: Outcome, traceback: str = "") -> None:
        """Note how an item went; where nothing can be written, the next run tries a failed one again."""
        told = {**_fields(outcome, _COURSE), "seconds": round(outcome.seconds, 3), "traceback": traceback}
        with suppress(OSError, InputError):
            self.write(f"records/{outcome.item.name}.json", json.dumps(told, indent=1) + "\n")

    @contextmanager
    def result_folder(self, item: Item, inputs: Iterable[Path]) -> Iterator[Path]:
        """Give a folder to write an item's files to; on success they are published whole.

        Raises:
            InputError: another run is writing this item, or it cannot be written.
        """
        folder, suffix = self._root / "items" / item.name, item.suffix
        folder.parent.mkdir(parents=True, exist_ok=True)
        names = (*result_files(suffix, html=item.html), *item.placing.patterns(suffix), ITEM)
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
        """Remove what a process that was killed has left of an item, or beside its results."""
        folder = self._root / "items" / name
        remove_leftovers(folder)
        for place in (folder, *folder.parents):
            if place == self._root:
                break
            with suppress(OSError):  # It holds results.
                place.rmdir()

    def _finished(self, item: Item) -> Outcome | None:
        """Return what `item.json` says; None unless all files of the item are there, as large as they were written."""
        folder = self._root / "items" / item.name
        return _read(folder / ITEM, item, "done", _RESULT) if is_complete(folder) else None

    def _record(self, item: Item) -> Outcome | None:
        return _read(self._root / "records" / f"{item.name}.json", item, "failed", _COURSE)


def write_finished(outcome: Outcome, folder: Path) -> None:
    """Write the `item.json` of an item that is done.

    Raises:
        InputError: it cannot be written.
    """
    write_json(_fields(outcome, _RESULT), folder / ITEM)


def _fields(outcome: Outcome, names: Sequence[str]) -> dict[str, Any]:
    return {"name": outcome.item.name, **{name: to_plain(getattr(outcome, name)) for name in names}}


def _read(path: Path, item: Item, state: str, names: Sequence[str]) -> Outcome | None:
    """Return what a JSON file says of an item in these fields; None if it is missing or damaged."""
    with suppress(InputError, OSError):
        found = read_json(path)
        if isinstance(found, dict) and found.keys() >= set(names):
            given = {"item": item, "state": state, "fresh": False, **{name: found[name] for name in names}}
            outcome: Outcome = from_plain(given, Outcome, "", {Item: lambda data, where: data})
            return outcome
    return None
