"""A selection on disk: the mask as .npy, and beside it the marks, a checksum and what the marks removed, as JSON.

The checksum says whether the .npy is still what the marks made, and so whether what is beside it is about it.
"""

from __future__ import annotations

import base64
import json
import os
import zlib
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.io.reading import file_bytes, is_file
from gaussian_trimmer.io.writing import atomic_file
from gaussian_trimmer.selecting.marks_file import is_marks_file, marks_as_json
from gaussian_trimmer.selecting.select import Selection

_MAX_JSON_BYTES = 1 << 26


def save_selection(selection: Selection, path: Path) -> None:
    """Write a selection and, beside it, its marks; what was there before stays as `.before.json`.

    Raises:
        InputError: a file cannot be written.
    """
    marks_path = path.with_suffix(".json")
    if is_marks_file(marks_path):
        with atomic_file(path.with_suffix(".before.json")) as part:
            part.write_bytes(marks_path.read_bytes())
    checksum = save_array(selection.mask, path)
    contents = marks_as_json(selection.marks, marks_path.parent)
    contents["selection"] = {
        "file": path.name, "crc32": checksum, "selected": int(np.count_nonzero(selection.mask)),
        "excluded": _packed(selection.excluded),
    }  # fmt: skip
    with atomic_file(marks_path) as part:
        part.write_text(json.dumps(contents, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def save_array(selection: NDArray[Any], path: Path) -> int:
    """Write an .npy file and return its checksum; `np.save` does not notice everywhere that a disk is full, but memory
    has room.

    Raises:
        InputError: the file cannot be written.
    """
    buffer = BytesIO()
    np.save(buffer, selection, allow_pickle=False)
    with atomic_file(path) as part:
        part.write_bytes(buffer.getbuffer())
    return zlib.crc32(buffer.getbuffer())


def is_own_selection(path: Path) -> bool:
    """Whether a selection is as this program wrote it, by the checksum in the marks beside it."""
    return _noted_of(path) is not None


def excluded_from(path: Path, n: int) -> BoolArray | None:
    """Which of n Gaussians the marks of a saved selection removed, (N,).

    None if the selection was not made by marks, was changed since, or is of another scene.
    """
    noted = _noted_of(path)
    packed = noted.get("excluded") if noted is not None else None
    if not isinstance(packed, str):
        return None
    size = -(-n // 8)
    with suppress(ValueError, zlib.error):
        bits = zlib.decompressobj().decompress(base64.b64decode(packed, validate=True), size + 1)
        if len(bits) == size:
            return np.unpackbits(np.frombuffer(bits, np.uint8), count=n).view(np.bool_)
    return None


def _packed(mask: BoolArray) -> str:
    """A mask as text: a bit a Gaussian, compressed, as base 64."""
    return base64.b64encode(zlib.compress(np.packbits(mask).tobytes(), 9)).decode()


def _noted_of(path: Path) -> dict[str, Any] | None:
    """What the marks beside a selection say of it, if it is as they made it."""
    marks_path = path.with_suffix(".json")
    if not (os.path.lexists(path) and is_file(path) and is_marks_file(marks_path)):
        return None
    with suppress(OSError, ValueError, RecursionError, InputError):
        noted = json.loads(file_bytes(marks_path, _MAX_JSON_BYTES)).get("selection")
        if isinstance(noted, dict) and noted.get("crc32") == zlib.crc32(path.read_bytes()):
            return noted
    return None
