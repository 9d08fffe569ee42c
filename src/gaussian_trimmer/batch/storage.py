"""Where a batch reads and writes: folders, or, with fsspec, the stores whose addresses it opens, such as s3://bucket.

Everything of an item is in `items/NAME`, with `item.json`, by which a later run knows what is finished; why an item
failed is in `records/NAME.json`.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import Any

from gaussian_trimmer.batch.items import is_address
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.manifest import MANIFEST
from gaussian_trimmer.io.writing import atomic_file, atomic_folder, remove_leftovers
from gaussian_trimmer.output.report import RESULTS, result_files

ITEM = "item.json"
Json = dict[str, Any]


class Store:
    """The output of a batch, in a folder."""

    def __init__(self, root: str) -> None:
        self._root = root

    def finished(self, name: str) -> Json | None:
        """The `item.json` of a finished item; None unless all its files are there, in the size they were written in."""
        item, manifest = (self._json(f"items/{name}/{file}") for file in (ITEM, MANIFEST))
        if item is None or manifest is None:
            return None
        try:
            same = all(self._size(f"items/{name}/{file}") == size for file, size in manifest["files"].items())
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
            self._remove(f"records/{name}.json")

    @contextmanager
    def result_folder(self, name: str, suffix: str, inputs: Iterable[Path]) -> Iterator[Path]:
        """Give a local folder to write an item's files to; on success they are published whole.

        Raises:
            InputError: another run is writing this item, or it cannot be written.
        """
        names = (*result_files(suffix), ITEM)
        folder = Path(self._root, "items", name)
        folder.parent.mkdir(parents=True, exist_ok=True)
        with atomic_folder(folder, RESULTS, names=names, inputs=inputs, overwrite=True) as part:
            yield part

    def write(self, name: str, text: str) -> None:
        """Write a small file whole.

        Raises:
            InputError: it cannot be written.
            OSError: likewise.
        """
        path = Path(self._root, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_file(path) as part:
            part.write_text(text, encoding="utf-8")

    def clean(self, name: str) -> None:
        """Remove what a process that was killed has left of an item."""
        remove_leftovers(Path(self._root, "items", name))

    def _json(self, name: str) -> Json | None:
        """A JSON object by its path in the output; None if it is missing or damaged."""
        try:
            value = json.loads(self._read(name))
        except (OSError, ValueError):
            return None
        return value if isinstance(value, dict) else None

    def _read(self, name: str) -> bytes:
        return Path(self._root, name).read_bytes()

    def _size(self, name: str) -> int:
        return Path(self._root, name).stat().st_size

    def _remove(self, name: str) -> None:
        Path(self._root, name).unlink()


class AddressStore(Store):
    """The output at an address that fsspec opens.

    No folder can be renamed there, so `item.json` goes first and comes last: without it an item counts as absent.
    """

    def __init__(self, address: str) -> None:
        self._files, root = _file_system(address)
        super().__init__(root)

    @contextmanager
    def result_folder(self, name: str, suffix: str, inputs: Iterable[Path]) -> Iterator[Path]:
        """Give a local folder to write to, and upload it; two runs may write one item, and write the same."""
        with tempfile.TemporaryDirectory(prefix="gaussian-trimmer-") as place:
            folder = Path(place, "results")
            with atomic_folder(folder, RESULTS) as part:
                yield part
            with suppress(FileNotFoundError):
                self._remove(f"items/{name}/{ITEM}")
            files = (path for path in folder.rglob("*") if path.is_file())
            for path in sorted(files, key=lambda path: path.name == ITEM):
                self._files.put_file(str(path), self._path(f"items/{name}/{path.relative_to(folder).as_posix()}"))

    def write(self, name: str, text: str) -> None:
        """Write a small file whole."""
        self._files.pipe_file(self._path(name), text.encode())

    def clean(self, name: str) -> None:
        """Nothing is left there: what is not complete counts as absent."""

    def _path(self, name: str) -> str:
        path = f"{self._root}/{name}"
        self._files.makedirs(path.rpartition("/")[0], exist_ok=True)
        return path

    def _read(self, name: str) -> bytes:
        return bytes(self._files.cat_file(f"{self._root}/{name}"))

    def _size(self, name: str) -> int:
        return int(self._files.size(f"{self._root}/{name}"))

    def _remove(self, name: str) -> None:
        self._files.rm_file(f"{self._root}/{name}")


def open_store(place: str) -> Store:
    """The output in a folder, or at an address.

    Raises:
        InputError: fsspec is needed and not installed, or knows no such address.
    """
    return AddressStore(place) if is_address(place) else Store(place)


@contextmanager
def local_copy(path: str) -> Iterator[Path]:
    """A file or folder of inputs on this machine: the path itself, or a copy of what lies at an address.

    Raises:
        InputError: fsspec is not installed, or knows no such address.
        OSError: it cannot be fetched.
    """
    if not is_address(path):
        yield Path(path)
        return
    files, source = _file_system(path)
    with tempfile.TemporaryDirectory(prefix="gaussian-trimmer-") as place:
        target = Path(place, PurePosixPath(source).name)
        files.get(source, str(target), recursive=True)
        yield target


def size_of(path: str) -> int:
    """The size of a file, or of what lies at an address, in bytes.

    Raises:
        OSError: there is no such file.
    """
    if not is_address(path):
        return Path(path).stat().st_size
    files, source = _file_system(path)
    return int(files.size(source) or 0)


def _file_system(address: str) -> tuple[Any, str]:
    try:
        from fsspec.core import url_to_fs

        files, root = url_to_fs(address)
    except (ImportError, ValueError) as error:
        raise InputError(
            f"'{address}' cannot be opened ({error}); addresses need fsspec, pip install 'gaussian-trimmer[ray]', and "
            "for buckets s3fs or gcsfs."
        ) from error
    return files, root.rstrip("/")
