"""Lossless WebP textures, with their size known before they are decoded."""

from __future__ import annotations

import cv2
import numpy as np

from gaussian_trimmer.formats.packing import ByteArray
from gaussian_trimmer.io.images import decoded_picture

_LOSSLESS = [cv2.IMWRITE_WEBP_QUALITY, 101]


def encode_webp(pixels: ByteArray) -> bytes:
    """A lossless WebP file of pixels (H, W, 4), red, green, blue, alpha; colours under an alpha of zero are lost."""
    done, data = cv2.imencode(".webp", pixels[..., [2, 1, 0, 3]], _LOSSLESS)
    assert done
    return bytes(data)


def decode_webp(data: bytes) -> ByteArray | None:
    """Pixels (H, W, 4), red, green, blue, alpha, of a WebP file; None if it is damaged."""
    image = decoded_picture(data, cv2.IMREAD_UNCHANGED)
    if image is None or image.ndim != 3 or image.dtype != np.uint8:
        return None
    pixels = np.full((*image.shape[:2], 4), 255, np.uint8)
    pixels[..., :3] = image[..., 2::-1]
    if image.shape[2] == 4:
        pixels[..., 3] = image[..., 3]
    return pixels
