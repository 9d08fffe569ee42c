"""Pictures inside a page: JPEG in the best quality in which all of them together are small enough."""

from __future__ import annotations

import base64
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import FloatArray

_QUALITIES = (88, 75, 55, 35, 15)
_SAMPLED = 16
"""Pictures by which a quality is judged before all are written."""
_WHOLE = np.float32(255)


def data_uris(pictures: Sequence[NDArray[np.uint8]], limit: int) -> list[str]:
    """Addresses that hold the pictures themselves, in the order of the pictures.

    Args:
        pictures: BGR, 8 bits a channel, (H, W, 3).
        limit: characters that all addresses together may have; the quality falls until they do, down to the lowest.
    """
    found: list[str] = []
    few = pictures[:: -(-len(pictures) // _SAMPLED)] if pictures else []
    for quality in _QUALITIES:
        sample = sum(len(_data_uri(picture, quality)) for picture in few) * len(pictures)
        if sample > limit * len(few) and quality != _QUALITIES[-1]:
            continue
        found = [_data_uri(picture, quality) for picture in pictures]
        if sum(map(len, found)) <= limit:
            break
    return found


def above_its_alpha(premultiplied: FloatArray, alpha: FloatArray) -> NDArray[np.uint8]:
    """What was rendered over black, and below it its opacity in grey, (2 H, W, 3): JPEG has no opacity of its own.

    Args:
        premultiplied: colours over black, (H, W, 3).
        alpha: opacity in [0, 1], (H, W).
    """
    both = np.concatenate([premultiplied[..., ::-1], np.repeat(alpha[..., None], 3, axis=2)])
    return np.ascontiguousarray((np.clip(both, 0, 1) * _WHOLE + np.float32(0.5)).astype(np.uint8))


def _data_uri(picture: NDArray[np.uint8], quality: int) -> str:
    done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1])
    assert done, "OpenCV writes JPEG"
    return f"data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode('ascii')}"
