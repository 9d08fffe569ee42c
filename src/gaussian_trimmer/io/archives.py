"""Members of zip archives from strangers, checked by name and size before anything is decompressed."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gaussian_trimmer.errors import InputError, shown

_MAX_DIRECTORY_BYTES = 1 << 24
_END = struct.Struct("<4s4H2LH")
_LONG_END = struct.Struct("<4sQ2H2L4Q")
_WHERE_THE_END_IS = _LONG_END.size + _END.size + (1 << 16) + 20
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, struct.error, NotImplementedError, RuntimeError, EOFError, ValueError,
    OverflowError, IndexError,
)  # fmt: skip
"""What zipfile raises for damaged archives."""


@contextmanager
def open_archive(path: Path, expected: str) -> Iterator[zipfile.ZipFile]:
    """Open a zip archive; whatever is found damaged while it is used is an error that says what was expected.

    Raises:
        InputError: the file cannot be read, or is no such archive, damaged or truncated.
    """
    try:
        _check_directory(path)
        with zipfile.ZipFile(path) as archive:
            yield archive
    except InputError:
        raise
    except _DAMAGE as error:
        raise InputError(f"'{path}' is no {expected}, damaged or truncated: {error}.") from error
    except OSError as error:
        raise InputError(f"Cannot read '{path}': {error.strerror or error}.") from error


def member_bytes(archive: zipfile.ZipFile, member: str | zipfile.ZipInfo, limit: int, path: Path) -> bytes:
    """The contents of a member of at most `limit` bytes.

    Raises:
        InputError: there is no such member, or it is packed otherwise than zip files usually are, or is larger.
    """
    info = member if isinstance(member, zipfile.ZipInfo) else find_member(archive, member, path)
    check_packing(info, path)
    if info.file_size > limit:
        raise InputError(
            f"'{path}' is damaged: its member '{shown(info.filename)}' claims {info.file_size} bytes, more than the "
            f"{limit} that it can need."
        )
    with archive.open(info) as file:
        return file.read(info.file_size)  # asked for no more, it inflates no more


def find_member(archive: zipfile.ZipFile, name: str, path: Path) -> zipfile.ZipInfo:
    """The entry of a member.

    Raises:
        InputError: there is none.
    """
    try:
        return archive.getinfo(name)
    except KeyError as error:
        raise InputError(f"'{path}' has no member '{shown(name)}'.") from error


def check_packing(info: zipfile.ZipInfo, path: Path) -> None:
    """Refuse other compression than deflate: some kinds take as much memory as the archive likes.

    Raises:
        InputError: the member is packed in another way.
    """
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise InputError(
            f"'{path}' has a member '{shown(info.filename)}' that is compressed otherwise than by deflate."
        )


def _check_directory(path: Path) -> None:
    """Refuse a list of members that takes more memory than the members of any file that is read here.

    Raises:
        InputError: the list is too long.
    """
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - _WHERE_THE_END_IS))
        tail = file.read(_WHERE_THE_END_IS)
    sizes = []
    for layout, signature, field in ((_END, b"PK\5\6", 5), (_LONG_END, b"PK\6\6", 8)):
        at = tail.rfind(signature)
        if 0 <= at <= len(tail) - layout.size:
            sizes.append(layout.unpack_from(tail, at)[field])
    if sizes and sizes[-1] > _MAX_DIRECTORY_BYTES:
        raise InputError(f"'{path}' is damaged: it claims a list of members of {sizes[-1]} bytes.")
