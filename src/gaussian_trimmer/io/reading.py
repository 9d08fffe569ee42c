"""Files from others: regular ones only, read whole and within bounds, and refused if they change meanwhile.

Members of archives take no more memory than they may, and pictures say their size before they are decoded: a few
kilobytes of PNG can hold gigabytes of pixels.
"""

from __future__ import annotations

import json
import os
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError, clip_name

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

LARGEST = 1e15
"""Greatest magnitude of coordinates, coefficients and weights; the square of a greater one nears the end of float32."""
_BYTES_AT_ONCE = 1 << 20
_MAX_JSON_BYTES = 1 << 24
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
_FREE_BYTES, _MOST_BYTES_A_PIXEL = 1 << 18, 16
"""A PNG has no more bytes than these for metadata, and these for each pixel."""
_PNG = b"\x89PNG\r\n\x1a\n"
_BEST_RATIO = 1032
"""Of deflate: a byte becomes no more than so many."""
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""By the type of its colours."""
MAX_PIXELS = 1 << 27
"""Pixels of the largest picture that is decoded; cameras have up to 100 million."""


@contextmanager
def reading(path: Path, *others: Path) -> Iterator[None]:
    """Check that files are the same before and after they are read: a training may still be writing them.

    Raises:
        InputError: a file cannot be read, is not a regular file, or has changed in size, time or identity.
    """
    paths = path, *others
    try:
        before = [_state(each) for each in paths]
        yield
        after = [_state(each) for each in paths]
    except OSError as error:
        raise InputError(f"Cannot read '{error.filename or path}': {error.strerror or error}.") from error
    for each, *states in zip(paths, before, after, strict=True):
        if states[0] != states[1]:
            raise InputError(f"'{each}' changed while it was read; try again when it is complete.")


def is_file(path: Path) -> bool:
    """Whether a path leads to a regular file; one that the file system refuses, say for its length, does not.

    >>> is_file(Path("x" * 9999))
    False
    """
    return os.path.isfile(path)  # noqa: PTH113 (Path.is_file raises instead)


def is_folder(path: Path) -> bool:
    """Whether a path leads to a folder; one that the file system refuses does not."""
    return os.path.isdir(path)  # noqa: PTH112


def path_inside(folder: Path, name: str) -> Path | None:
    """The path of a name from a file in a folder of the user's; None if the name leads out of the folder.

    >>> path_inside(Path("images"), "left/1.png").as_posix()
    'images/left/1.png'
    >>> [path_inside(Path("images"), name) for name in ("../1.png", "/etc/passwd", "/", "")]
    [None, None, None, None]
    """
    relative = PurePath(name)
    if relative.anchor or ".." in relative.parts or not relative.name:
        return None
    return folder / relative


def file_bytes(path: Path, limit: int | None = None) -> bytes:
    """The contents of a regular file of at most `limit` bytes.

    Raises:
        InputError: the file cannot be read, or is larger.
    """
    try:
        size = _state(path)[0]
        if limit is not None and size > limit:
            raise InputError(f"'{path}' has {size} bytes; at most {limit} can be read of a file of its kind.")
        with path.open("rb") as file:
            return file.read(size)  # no more than that, should it be growing
    except OSError as error:
        raise InputError(f"Cannot read '{path}': {error.strerror or error}.") from error


def read_json(path: Path, limit: int = _MAX_JSON_BYTES) -> Any:
    """Return what a JSON file of at most `limit` bytes holds.

    Raises:
        InputError: there is no file, or it cannot be read as JSON.
    """
    if not is_file(path):
        raise InputError(f"There is no file '{path}'.")
    with reading(path):
        data = file_bytes(path, limit)
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise InputError(f"'{path}' cannot be read as JSON ({clip_name(str(error))}).") from error


def read_into(array: NDArray[np.generic], file: BinaryIO, path: Path) -> None:
    """Fill a contiguous array with the bytes that follow in an open file.

    Raises:
        InputError: the file ends too early.
    """
    data = array.reshape(-1).view(np.uint8).data
    for start in range(0, len(data), _BYTES_AT_ONCE):
        piece = data[start : start + _BYTES_AT_ONCE]
        if file.readinto(piece) < len(piece):  # type: ignore[attr-defined]
            raise InputError(f"'{path}' became shorter while it was read; try again when it is complete.")


def _state(path: Path) -> tuple[int, int, int, int]:
    """Size, time of the last change and identity of a regular file."""
    status = path.stat()
    if not stat.S_ISREG(status.st_mode) and not stat.S_ISDIR(status.st_mode):  # opening a folder fails by itself
        raise InputError(f"'{path}' is not a regular file.")
    return status.st_size, status.st_mtime_ns, status.st_ino, status.st_dev


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


def picture_size(data: bytes) -> tuple[int, int] | None:
    """Return width and height that a PNG, JPEG, WebP, BMP or TIFF announces, before its metadata turns it.

    Nothing else, and nothing damaged, has a size.

    >>> picture_size(b"no picture") is None
    True
    """
    if size := webp_size(data):
        return size
    # Not Image.open, which warns of large pictures and refuses larger ones before their size can be told.
    from PIL import BmpImagePlugin, JpegImagePlugin, PngImagePlugin, TiffImagePlugin

    readers: dict[bytes, Callable[[BytesIO], ImageFile]] = {
        _PNG: PngImagePlugin.PngImageFile,
        b"\xff\xd8\xff": JpegImagePlugin.JpegImageFile,
        b"BM": BmpImagePlugin.BmpImageFile,
        b"II*\0": TiffImagePlugin.TiffImageFile,
        b"MM\0*": TiffImagePlugin.TiffImageFile,
    }
    reader = next((reader for start, reader in readers.items() if data.startswith(start)), None)
    try:
        image = reader(BytesIO(data)) if reader else None
    except (OSError, ValueError, SyntaxError, LookupError, TypeError, OverflowError, struct.error, Warning):
        return None  # what Pillow raises for damaged files, the last where Python makes errors of warnings
    if image is None:
        return None
    most = _FREE_BYTES + _MOST_BYTES_A_PIXEL * image.size[0] * image.size[1]
    if reader is PngImagePlugin.PngImageFile and len(data) > most:
        return None  # the decoder would inflate a thousand times as much, whatever the size says
    return image.size


def decoded_picture(data: bytes, flags: int) -> NDArray[Any] | None:
    """The pixels of a picture whose header has been checked, by OpenCV's flags; None if it is damaged."""
    import cv2

    if data.startswith(_PNG):
        chunk, width, height, depth, colours = struct.unpack_from(">4s2I2B", data, 12)
        bits = width * height * depth * _PNG_CHANNELS.get(colours, 0)
        if chunk != b"IHDR" or bits > 8 * _BEST_RATIO * len(data):
            return None  # the decoder would take memory for all pixels first
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        return None


def webp_size(data: bytes) -> tuple[int, int] | None:
    """Width and height that a WebP file announces; None if it is none. Pillow would allocate the pixels."""
    if len(data) < 30 or data[:4] != b"RIFF" or data[8:12] != b"WEBP":
        return None
    match data[12:16]:
        case b"VP8L":
            (bits,) = struct.unpack_from("<I", data, 21)
            return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
        case b"VP8X":
            return int.from_bytes(data[24:27], "little") + 1, int.from_bytes(data[27:30], "little") + 1
        case b"VP8 ":
            width, height = struct.unpack_from("<HH", data, 26)
            return width & 0x3FFF, height & 0x3FFF
    return None
