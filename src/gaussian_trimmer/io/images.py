"""What a picture says of itself before it is decoded: a few kilobytes of PNG can hold gigabytes of pixels."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

_FREE_BYTES, _MOST_BYTES_A_PIXEL = 1 << 18, 16
"""A PNG has no more bytes than these for metadata, and these for each pixel."""
MAX_PIXELS = 1 << 27
"""Pixels of the largest picture that is decoded; cameras have up to 100 million."""


@dataclass(frozen=True)
class PictureHeader:
    """Size that a picture announces, before any turn that its metadata asks for."""

    width: int
    height: int

    @property
    def n_pixels(self) -> int:
        """Number of pixels."""
        return self.width * self.height


def picture_header(data: bytes) -> PictureHeader | None:
    """The size of a PNG, JPEG, WebP, BMP or TIFF; None for anything else, or what is damaged.

    >>> picture_header(b"no picture") is None
    True
    """
    if size := webp_size(data):
        return PictureHeader(*size)
    # Not Image.open, which warns of large pictures and refuses larger ones before their size can be told.
    from PIL import BmpImagePlugin, JpegImagePlugin, PngImagePlugin, TiffImagePlugin

    readers: dict[bytes, Callable[[BytesIO], ImageFile]] = {
        b"\x89PNG\r\n\x1a\n": PngImagePlugin.PngImageFile,
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
    return PictureHeader(*image.size)


def decoded_picture(data: bytes, flags: int) -> NDArray[Any] | None:
    """The pixels of a picture whose header has been checked, by OpenCV's flags; None if it is damaged."""
    import cv2

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
