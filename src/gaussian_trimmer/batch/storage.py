"""Where a batch reads and writes: folders, or, with fsspec, the stores whose addresses it opens, such as s3://bucket.

Everything of an item is in `items/NAME`, with `item.json`, by which a later run knows what is finished. In a store,
where no folder can be renamed, `item.json` comes last and goes first: without it an item counts as absent.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any, Protocol

from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.io.writing import atomic_file, atomic_folder, remove_leftovers
from gaussian_trimmer.output.report import RESULTS, result_files

ITEM, MANIFEST, REPORT = "item.json", "manifest.json", "report.json"
_MAX_RECORD = 1 << 24
Json = dict[str, Any]


class Store(Protocol):
    """The output of a batch."""

    def finished(self, name: str) -> Json | None:
        """What `item.json` of a finished item says; None unless all its files are as they were written."""
        ...

    def result_folder(self, name: str, suffix: str, inputs: Iterable[Path]) -> Any:
        """A context that gives a folder on this machine to write an item's files to, and publishes them whole.

        Raises:
            InputError: another run is writing this item, or it cannot be written.
        """
        ...

    def read(self, name: str) -> Json | None:
        """A file of JSON, by its path in the store; None if it is missing or damaged."""
        ...

    def clean(self, name: str) -> None:
        """Remove what a dead worker has left of an item."""
        ...

    def write(self, name: str, text: str) -> None:
        """Write a small file whole.

        Raises:
            InputError: it cannot be written.
        """
        ...


def is_address(path: str) -> bool:
    """Whether a path is for fsspec to open.

    >>> is_address("s3://bucket/scene.ply"), is_address("scenes/a.ply")
    (True, False)
    """
    return "://" in path


def open_store(place: str | Path) -> Store:
    """The output in a folder, or at an address.

    Raises:
        InputError: fsspec is needed and not installed, or knows no such address.
    """
    place = str(place)
    return AddressStore(place) if is_address(place) else FolderStore(Path(place))


class FolderStore:
    """The output in a folder that every worker sees."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def finished(self, name: str) -> Json | None:
        """As in `Store`."""
        item = self.read(f"items/{name}/{ITEM}")
        manifest = self.read(f"items/{name}/{MANIFEST}") if item else None
        if item is None or manifest is None or not isinstance(sizes := manifest.get("files"), dict):
            return None
        folder = self.root / "items" / name
        try:
            same = ITEM in sizes and all((folder / file).stat().st_size == size for file, size in sizes.items())
        except (OSError, ValueError):
            return None
        return item if same else None

    @contextmanager
    def result_folder(self, name: str, suffix: str, inputs: Iterable[Path]) -> Iterator[Path]:
        """As in `Store`."""
        folder = self.root / "items" / name
        names = (*result_files(suffix), ITEM)
        with atomic_folder(folder, RESULTS, names=names, inputs=inputs, overwrite=True) as part:
            yield part

    def read(self, name: str) -> Json | None:
        """As in `Store`."""
        path = self.root / name
        try:
            if path.stat().st_size > _MAX_RECORD:
                return None
            return _parsed(path.read_bytes())
        except OSError:
            return None

    def clean(self, name: str) -> None:
        """As in `Store`."""
        for place in (self.root / "items" / name, self.root / "items", self.root):
            remove_leftovers(place)

    def write(self, name: str, text: str) -> None:
        """As in `Store`."""
        path = self.root / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"Cannot write '{path}': {error.strerror or error}.") from error
        with atomic_file(path) as part:
            part.write_text(text, encoding="utf-8")


class AddressStore:
    """The output at an address of fsspec's: every file appears whole, and `item.json` after all others."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._files, self._root = _file_system(address)

    def finished(self, name: str) -> Json | None:
        """As in `Store`."""
        item = self.read(f"items/{name}/{ITEM}")
        if item is None or not isinstance(sizes := item.get("files"), dict):
            return None
        try:
            same = all(self._files.size(self._path(f"items/{name}/{file}")) == size for file, size in sizes.items())
        except (OSError, ValueError):
            return None
        return item if same else None

    @contextmanager
    def result_folder(self, name: str, suffix: str, inputs: Iterable[Path]) -> Iterator[Path]:
        """As in `Store`. Two runs may write one item at a time; what they write is equal."""
        with tempfile.TemporaryDirectory(prefix="gaussian-trimmer-") as place:
            folder = Path(place) / "results"
            folder.mkdir()
            yield folder
            try:
                self._publish(folder, f"items/{name}")
            except OSError as error:
                raise InputError(
                    f"Cannot write 'items/{shown(name)}' to '{self.address}': {error.strerror or error}."
                ) from error

    def read(self, name: str) -> Json | None:
        """As in `Store`."""
        try:
            return _parsed(self._files.cat_file(self._path(name), end=_MAX_RECORD))
        except (OSError, ValueError):
            return None

    def clean(self, name: str) -> None:
        """As in `Store`; what is not complete counts as absent there."""

    def write(self, name: str, text: str) -> None:
        """As in `Store`."""
        try:
            self._put(name, text.encode())
        except OSError as error:
            raise InputError(f"Cannot write '{name}' to '{self.address}': {error.strerror or error}.") from error

    def _publish(self, folder: Path, name: str) -> None:
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

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}"


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


def size_of(address: str) -> int:
    """The size of a file at an address, in bytes.

    Raises:
        OSError: there is no such file.
    """
    files, path = _file_system(address)
    return int(files.size(path) or 0)


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


def _parsed(data: bytes) -> Json | None:
    try:
        value = json.loads(data)
    except (ValueError, RecursionError):
        return None
    return value if isinstance(value, dict) else None
