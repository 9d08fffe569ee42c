"""Rows of a scene as short text, for the JSON that marks are saved in. N Gaussians."""

from __future__ import annotations

import base64
import binascii
import zlib

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray


def pack_rows(selected: BoolArray) -> str:
    """Return which rows are selected, (N,), as text.

    >>> unpack_rows(pack_rows(np.array([True, False, True])), 3)
    array([ True, False,  True])
    """
    return base64.b64encode(zlib.compress(np.packbits(selected).tobytes())).decode()


def unpack_rows(packed: str, n: int) -> BoolArray:
    """Return the rows that `pack_rows` has packed, (N,).

    Args:
        packed: the text.
        n: number of Gaussians of the scene; nothing larger is unpacked.

    Raises:
        InputError: it is not such a text, or of another scene.
    """
    size = (n + 7) // 8
    try:
        stream = zlib.decompressobj()
        data = stream.decompress(base64.b64decode(packed, validate=True), size + 1)
    except (binascii.Error, zlib.error, ValueError) as error:
        raise InputError("The rows that a mark names cannot be read; mark again.") from error
    if len(data) != size:
        raise InputError(f"A mark names rows of another scene than this one of {n:,} Gaussians; open its own scene.")
    return np.unpackbits(np.frombuffer(data, np.uint8), count=n).view(np.bool_)
