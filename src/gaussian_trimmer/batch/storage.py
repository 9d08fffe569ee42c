"""Where a batch reads and writes: folders, or, with fsspec, the stores whose addresses it opens, such as s3://bucket.

Everything of an item is in `items/NAME`, with `item.json`, by which a later run knows what is finished; why an item
failed is in `records/NAME.json`. In a store, where no folder can be renamed, `item.json` comes last and goes first:
without it an item counts as absent.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import Any

from gaussian_trimmer.batch.items import is_address
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.writing import atomic_file, atomic_folder, remove_leftovers
from gaussian_trimmer.output.report import RESULTS, result_files

ITEM, _MANIFEST = "item.json", "manifest.json"
_MAX_RECORD_BYTES = 1 << 24
Json = dict[str, Any]


class OutputError(InputError):
    """The output cannot be written: the item is not to blame."""


class Store:
    """The output of a batch, in a folder."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def finished(self, name: str) -> Json | None:
        """The `item.json` of a finished item; None unless all its files are there, in the size they were written in."""
        item = self.read(f"items/{name}/{ITEM}")
        sizes = self._sizes(name, item) if item else None
        if not isinstance(sizes, dict):
            return None
        try:
            same = all(self._size(f"items/{name}/{file}") == size for file, size in sizes.items())
        except (OSError, ValueError):
            return None
        return item if same else None

    @contextmanager
    def result_folder(self, name: str, suffix: str, inputs: Iterable[Path]) -> Iterator[Path]:
        """Give a local folder to write an item's files to; on success they are published whole.

        Raises:
            OutputError: another run is writing this item, or it cannot be written.
        """
        folder, inside = self.root / "items" / name, False
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
            names = (*result_files(suffix), ITEM)
            with atomic_folder(folder, RESULTS, names=names, inputs=inputs, overwrite=True) as part:
                inside = True
                yield part
                inside = False
        except (InputError, OSError) as error:
            if inside:
                raise
            raise OutputError(str(error)) from error

    def read(self, name: str) -> Json | None:
        """A JSON object by its path in the output; None if it is missing or damaged."""
        try:
            value = json.loads(self._read_bytes(name))
        except (OSError, ValueError, RecursionError):
            return None
        return value if isinstance(value, dict) else None

    def write(self, name: str, text: str) -> None:
        """Write a small file whole.

        Raises:
            OutputError: it cannot be written.
        """
        path = self.root / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_file(path) as part:
                part.write_text(text, encoding="utf-8")
        except (InputError, OSError) as error:
            raise OutputError(f"Cannot write '{path}': {getattr(error, 'strerror', None) or error}.") from error

    def record_failure(self, name: str, message: str, fingerprint: str, traceback: str = "") -> None:
        """Note why an item failed; where nothing can be written, the next run tries it again."""
        record = {"name": name, "state": "failed", "message": message, "fingerprint": fingerprint}
        if traceback:
            record["traceback"] = traceback
        with suppress(OutputError):
            self.write(f"records/{name}.json", json.dumps(record, indent=1) + "\n")

    def failure(self, name: str) -> Json | None:
        """The record of an item that failed."""
        record = self.read(f"records/{name}.json")
        return record if record is not None and record.get("state") == "failed" else None

    def remove_records(self, *names: str) -> None:
        """Remove the records of items that have failed before."""
        for name in names:
            with suppress(OSError):
                (self.root / "records" / f"{name}.json").unlink()

    def recorded(self) -> list[str]:
        """Names of all items that have a record."""
        root = self.root / "records"
        return [path.relative_to(root).with_suffix("").as_posix() for path in root.rglob("*.json")]

    def clean(self, name: str) -> None:
        """Remove what a worker that was killed has left of an item."""
        folder = self.root / "items" / name
        for place in (folder, *folder.parents):
            if place.is_dir() and place.is_relative_to(self.root):
                remove_leftovers(place)

    def _sizes(self, name: str, item: Json) -> Any:
        manifest = self.read(f"items/{name}/{_MANIFEST}") or {}
        sizes = manifest.get("files")
        return sizes if isinstance(sizes, dict) and ITEM in sizes else None

    def _size(self, name: str) -> int:
        return (self.root / name).stat().st_size

    def _read_bytes(self, name: str) -> bytes:
        with (self.root / name).open("rb") as file:
            return file.read(_MAX_RECORD_BYTES)


class AddressStore(Store):
    """The output at an address that fsspec opens: every file appears whole, and `item.json` after all others."""

    def __init__(self, address: str) -> None:
        self._files, root = _file_system(address)
        super().__init__(Path())
        self._address, self._root = address, root

    @contextmanager
    def result_folder(self, name: str, suffix: str, inputs: Iterable[Path]) -> Iterator[Path]:
        """Give a local folder to write to, and upload it; two runs may write one item, and write the same."""
        with tempfile.TemporaryDirectory(prefix="gaussian-trimmer-") as place:
            folder = Path(place) / "results"
            folder.mkdir()
            yield folder
            self._try_to_write(name, lambda: self._upload(folder, f"items/{name}"))

    def write(self, name: str, text: str) -> None:
        """Write a small file whole."""
        self._try_to_write(name, lambda: self._put(name, text.encode()))

    def remove_records(self, *names: str) -> None:
        """Remove the records of items that have failed before."""
        for name in names:
            with suppress(OSError):
                self._files.rm_file(self._path(f"records/{name}.json"))

    def recorded(self) -> list[str]:
        """Names of all items that have a record."""
        start = self._path("records/")
        return [path.partition(start)[2].removesuffix(".json") for path in self._files.find(start)]

    def clean(self, name: str) -> None:
        """Nothing is left there: what is not complete counts as absent."""

    def _try_to_write(self, name: str, write: Callable[[], None]) -> None:
        try:
            write()
        except OSError as error:
            raise OutputError(f"Cannot write '{name}' to '{self._address}': {error.strerror or error}.") from error

    def _upload(self, folder: Path, name: str) -> None:
        if self._files.exists(self._path(f"{name}/{ITEM}")):
            self._files.rm_file(self._path(f"{name}/{ITEM}"))
        paths = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != ITEM)
        sizes = {path.relative_to(folder).as_posix(): path.stat().st_size for path in paths}
        for file in sizes:
            target = self._path(f"{name}/{file}")
            self._files.makedirs(target.rpartition("/")[0], exist_ok=True)
            self._files.put_file(str(folder / file), target)
        item = {**json.loads((folder / ITEM).read_text(encoding="utf-8")), "files": sizes}
        self._put(f"{name}/{ITEM}", (json.dumps(item, indent=1) + "\n").encode())

    def _put(self, name: str, data: bytes) -> None:
        target = self._path(name)
        self._files.makedirs(target.rpartition("/")[0], exist_ok=True)
        self._files.pipe_file(target, data)

    def _sizes(self, name: str, item: Json) -> Any:
        return item.get("files")

    def _size(self, name: str) -> int:
        return int(self._files.size(self._path(name)))

    def _read_bytes(self, name: str) -> bytes:
        return bytes(self._files.cat_file(self._path(name), end=_MAX_RECORD_BYTES))

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}"


def open_store(place: str | Path) -> Store:
    """The output in a folder, or at an address.

    Raises:
        InputError: fsspec is needed and not installed, or knows no such address.
    """
    return AddressStore(str(place)) if is_address(str(place)) else Store(Path(place))


@contextmanager
def local_copy(path: str) -> Iterator[Path]:
    """A file or folder of inputs on this machine: the path itself, or a copy of what lies at an address.

    Raises:
        InputError: it cannot be fetched.
    """
    if not is_address(path):
        yield Path(path)
        return
    files, source = _file_system(path)
    with tempfile.TemporaryDirectory(prefix="gaussian-trimmer-") as place:
        target = Path(place) / PurePosixPath(source).name
        try:
            if files.isdir(source):
                files.get(source, str(target), recursive=True)
            else:
                with files.open(source, "rb") as remote, target.open("wb") as local:
                    shutil.copyfileobj(remote, local, 1 << 22)
        except OSError as error:
            raise InputError(f"Cannot read '{path}': {error.strerror or error}.") from error
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
    except ImportError as error:
        raise InputError(
            f"'{address}' is opened by fsspec, which is not installed; pip install 'gaussian-trimmer[ray]', and for "
            "buckets s3fs or gcsfs."
        ) from error
    try:
        files, root = url_to_fs(address)
    except (ImportError, ValueError) as error:
        raise InputError(f"'{address}' cannot be opened: {error}.") from error
    return files, root.rstrip("/")
