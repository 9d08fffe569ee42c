"""How much memory the trims of a scene take, estimated from the size of its files."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.io.memory import TRIM_BYTES_PER_SCENE_BYTE

PROCESS_BYTES = 400 << 20
"""What a worker takes without a scene: the interpreter, libraries, compiled kernels, pictures of views."""
_BYTES_PER_FILE_BYTE = {
    ".ply": 1.0,
    ".compressed.ply": 4.0,
    ".splat": 2.0,
    ".spz": 12.0,
    ".sog": 48.0,
    ".glb": 1.2,
    "meta.json": 48.0,
    "lod-meta.json": 48.0,
    ".ckpt": 1.0,
    ".pth": 1.0,
    ".pt": 1.0,
}
"""Bytes of a scene's arrays for each byte of its file, at most, in files as programs write them; a .glb with plain
attributes."""


def scene_need(scene: str, level: int | None = None) -> float:
    """Return the bytes that a worker takes, beside `PROCESS_BYTES`, to trim objects of a scene; 0 if it is missing."""
    with suppress(InputError, OSError):  # Whoever reads the scene will say what is wrong with it.
        file = identify(Path(scene)).scene
        suffix, files = formats.format_suffix(file), formats.scene_files(file, level)
        size = sum(path.stat().st_size for path in files)
        return TRIM_BYTES_PER_SCENE_BYTE * _BYTES_PER_FILE_BYTE[suffix] * size
    return 0.0
