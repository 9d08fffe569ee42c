"""What a picture says of itself before it is decoded, so that nothing larger than expected is.

A few kilobytes of PNG can claim, and be, gigabytes of pixels; decoders find out too late.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_MAX_SCANS = 64
"""Passes over a progressive JPEG; encoders write ten."""
_CHANNELS_OF_PNG = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
_TIFF_TYPES = {1: "B", 3: "H", 4: "I"}
_TIFF_WIDTH, _TIFF_HEIGHT, _TIFF_BITS, _TIFF_SAMPLES = 256, 257, 258, 277
_TIFF_TILES = (322, 323, 324, 325)
_MAX_TIFF_ENTRIES = 256


@dataclass(frozen=True)
class PictureHeader:
    """Size and depth that a picture announces."""

    width: int
    height: int
    bits: int
    """Bits of a pixel, all channels together; of JPEG and WebP the most that there can be."""

    @property
    def n_bytes(self) -> int:
        """Bytes of the pixels, as they are decoded before any conversion."""
        return self.width * self.height * max(8, self.bits) // 8


def picture_header(data: bytes) -> PictureHeader | None:
    """What the first bytes of a PNG, JPEG, WebP, BMP or TIFF say; None for anything else, or what is damaged.

    >>> picture_header(b"no picture") is None
    True
    """
    try:
        for begins, parse in _PARSERS:
            if data.startswith(begins):
                return parse(data)
    except (struct.error, IndexError, KeyError):
        return None
    return None


def decoded_picture(data: bytes, flags: int) -> NDArray[Any] | None:
    """The pixels of a picture, whose header has been looked at, by OpenCV's flags; None if it is damaged."""
    import cv2

    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        return None


def webp_size(data: bytes) -> tuple[int, int] | None:
    """Width and height that a WebP file announces; None if it is none."""
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


def _png(data: bytes) -> PictureHeader | None:
    length, name, width, height, depth, colours = struct.unpack_from(">I4sIIBB", data, 8)
    if name != b"IHDR" or length != 13:
        return None
    return PictureHeader(width, height, depth * _CHANNELS_OF_PNG[colours])


def _jpeg(data: bytes) -> PictureHeader | None:
    """The first frame header; between it and the beginning lie segments that say their lengths."""
    if data.count(b"\xff\xda") > _MAX_SCANS:  # every scan is a pass over all pixels, however few bytes it has
        return None
    at = 2
    while data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xFF:  # fill
            at += 1
        elif 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, at + 5)
            return PictureHeader(width, height, 32)
        elif marker in (0xD9, 0xDA):
            return None
        else:
            at += 2 if marker == 0x01 or 0xD0 <= marker <= 0xD8 else 2 + struct.unpack_from(">H", data, at + 2)[0]
    return None


def _webp(data: bytes) -> PictureHeader | None:
    size = webp_size(data)
    return size and PictureHeader(*size, 32)


def _bmp(data: bytes) -> PictureHeader | None:
    if struct.unpack_from("<I", data, 14)[0] < 40:  # the header of OS/2, which nobody writes any more
        return None
    width, height, _, depth = struct.unpack_from("<iiHH", data, 18)
    return PictureHeader(width, abs(height), depth) if width > 0 else None


def _tiff(data: bytes) -> PictureHeader | None:
    """The first picture of a TIFF; tiles, which may be larger than it, are not taken."""
    order = "<" if data[:2] == b"II" else ">"
    (start,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, start)
    if count > _MAX_TIFF_ENTRIES:
        return None
    entries = {}
    for i in range(count):
        tag, kind, n = struct.unpack_from(order + "HHI", data, start + 2 + 12 * i)
        if kind in _TIFF_TYPES and n >= 1:
            at = start + 10 + 12 * i
            if n * struct.calcsize(_TIFF_TYPES[kind]) > 4:
                (at,) = struct.unpack_from(order + "I", data, at)
            entries[tag] = struct.unpack_from(order + _TIFF_TYPES[kind], data, at)[0]
    if any(tag in entries for tag in _TIFF_TILES):
        return None
    bits = entries.get(_TIFF_BITS, 1) * entries.get(_TIFF_SAMPLES, 1)
    return PictureHeader(entries[_TIFF_WIDTH], entries[_TIFF_HEIGHT], bits)


_PARSERS = (
    (b"\x89PNG\r\n\x1a\n", _png),
    (b"\xff\xd8\xff", _jpeg),
    (b"RIFF", _webp),
    (b"BM", _bmp),
    (b"II*\0", _tiff),
    (b"MM\0*", _tiff),
)
