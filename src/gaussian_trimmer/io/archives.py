"""Zip archives: whatever is found damaged is an InputError, and no member takes more memory than it may."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gaussian_trimmer.errors import InputError, clip_name

_ERRORS_OF_DAMAGE = (
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
_KNOWN_COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Other ways of compression take as much memory as the archive likes."""


@contextmanager
def open_archive(path: Path, expected: str) -> Iterator[zipfile.ZipFile]:
    """Open a zip archive; whatever is found damaged while it is used is an error that names what was expected.

    Raises:
        InputError: the file cannot be read, is not such an archive, is damaged or truncated.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            if any(info.compress_type not in _KNOWN_COMPRESSIONS for info in archive.infolist()):
                raise InputError(f"'{path}' has a member that is compressed otherwise than by deflate.")
            yield archive
    except InputError:
        raise
    except _ERRORS_OF_DAMAGE as error:
        raise InputError(f"'{path}' is not a {expected}, damaged or truncated: {error}.") from error
    except OSError as error:
        raise InputError(f"Cannot read '{path}': {error.strerror or error}.") from error


def member_bytes(archive: zipfile.ZipFile, name: str, limit: int, path: Path) -> bytes:
    """The contents of a member of at most `limit` bytes.

    Raises:
        InputError: there is no such member, or it is larger.
    """
    if name not in archive.NameToInfo:
        raise InputError(f"'{path}' has no member '{clip_name(name)}'.")
    size = archive.getinfo(name).file_size
    if size > limit:
        raise InputError(
            f"'{path}' is damaged: its member '{clip_name(name)}' claims {size} bytes, more than the {limit} that it "
            "can "
            "need."
        )
    with archive.open(name) as file:
        return file.read(size)  # asked for no more, it inflates no more
