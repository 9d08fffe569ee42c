"""Members of untrusted zip archives, checked by name and size before anything is decompressed."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gaussian_trimmer.errors import InputError, shown

_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    NotImplementedError,
    RuntimeError,
    EOFError,
    ValueError,
    OverflowError,
    IndexError,
)
"""What zipfile raises for damaged archives."""


@contextmanager
def open_archive(path: Path, expected: str) -> Iterator[zipfile.ZipFile]:
    """Open a zip archive; whatever is found damaged while it is used is an error that names what was expected.

    Raises:
        InputError: the file cannot be read, or is no such archive, damaged or truncated.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(info.compress_size for info in archive.infolist()) > path.stat().st_size:
                raise zipfile.BadZipFile("its members claim more bytes than it has")
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
        InputError: there is no such member, it is larger, or compressed otherwise than by deflate.
    """
    try:
        info = archive.getinfo(member) if isinstance(member, str) else member
    except KeyError as error:
        raise InputError(f"'{path}' has no member '{shown(str(member))}'.") from error
    check_packing(info, path)
    if info.file_size > limit:
        raise InputError(
            f"'{path}' is damaged: its member '{shown(info.filename)}' claims {info.file_size} bytes, more than the "
            f"{limit} that it can need."
        )
    with archive.open(info) as file:
        return file.read(info.file_size)  # asked for no more, it inflates no more


def check_packing(info: zipfile.ZipInfo, path: Path) -> None:
    """Refuse other compression than deflate: some kinds take as much memory as the archive likes.

    Raises:
        InputError: the member is packed in another way.
    """
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise InputError(
            f"'{path}' has a member '{shown(info.filename)}' that is compressed otherwise than by deflate."
        )
