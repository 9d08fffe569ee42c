"""What a batch writes.

Everything of an item is in `items/NAME`, with `item.json`, by which a later run knows what is finished; why an item
failed is in `records/NAME.json`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.manifest import MANIFEST
from gaussian_trimmer.io.writing import atomic_folder, remove_leftovers, write_whole
from gaussian_trimmer.output.saving import RESULTS, result_files

ITEM = "item.json"
Json = dict[str, Any]


class Store:
    """The output of a batch, in a folder."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def finished(self, name: str) -> Json | None:
        """The `item.json` of a finished item; None unless all its files are there, in the size they were written in."""
        item, manifest = (self._json(f"items/{name}/{file}") for file in (ITEM, MANIFEST))
        if item is None or manifest is None:
            return None
        files = manifest["files"]
        try:
            same = all((self._root / "items" / name / file).stat().st_size == size for file, size in files.items())
        except OSError:
            return None
        return item if same else None

    def failure(self, name: str) -> Json | None:
        """The record of an item that failed."""
        return self._json(f"records/{name}.json")

    def record_failure(self, name: str, message: str, fingerprint: str, traceback: str = "") -> None:
        """Note why an item failed; where nothing can be written, the next run tries it again."""
        record = {"name": name, "message": message, "fingerprint": fingerprint, "traceback": traceback}
        with suppress(OSError, InputError):
            self.write(f"records/{name}.json", json.dumps(record, indent=1) + "\n")

    def forget_failure(self, name: str) -> None:
        """Remove the record of an item that failed before, if there is one."""
        with suppress(OSError):
            (self._root / "records" / f"{name}.json").unlink()

    @contextmanager
    def result_folder(self, name: str, suffix: str, inputs: Iterable[Path]) -> Iterator[Path]:
        """Give a local folder to write an item's files to; on success they are published whole.

        Raises:
            InputError: another run is writing this item, or it cannot be written.
        """
        names = (*result_files(suffix), ITEM)
        folder = self._root / "items" / name
        folder.parent.mkdir(parents=True, exist_ok=True)
        with atomic_folder(folder, RESULTS, names=names, inputs=inputs, overwrite=True) as part:
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

    def _json(self, name: str) -> Json | None:
        """A JSON object by its path in the output; None if it is missing or damaged."""
        try:
            value = json.loads((self._root / name).read_bytes())
        except (OSError, ValueError):
            return None
        return value if isinstance(value, dict) else None
