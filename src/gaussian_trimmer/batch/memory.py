"""How much memory the trims of a scene take, from the size of its file alone, and how much there is."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.compressed_ply import is_compressed
from gaussian_trimmer.formats.ply_table import read_header

PROCESS_BYTES = 400 << 20
"""What a worker takes without a scene: the interpreter, libraries, compiled kernels, pictures of views."""
BYTES_PER_SCENE_BYTE = 3.5
"""What a trim takes at most, beside that, for each byte of the scene as arrays; measured, see docs/scale.md."""
_EXPANSION = {
    ".ply": 1.0, ".compressed.ply": 4.0, ".splat": 2.0, ".ksplat": 4.0, ".spz": 12.0, ".sog": 48.0,
    ".glb": 1.2, "meta.json": 48.0, ".ckpt": 1.0,
}  # fmt: skip
"""Bytes of a scene's arrays for each byte of its file, at most, in files as programs write them; a .glb with plain
attributes."""
SHARE_OF_FREE = 0.8
"""Of the memory that is free when a batch begins, what it may take if nobody says how much."""
_CGROUP = (("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
           ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"))  # fmt: skip


def scene_need(scene: str, size: int) -> float:
    """Bytes of memory that a worker takes, beside `PROCESS_BYTES`, to trim objects of a scene.

    Args:
        scene: path or address of the file.
        size: its size in bytes.

    >>> scene_need("a.ply", 1000)
    3500.0
    """
    suffix = formats.format_suffix(scene)
    if suffix == "meta.json":  # the Gaussians are in the textures beside it
        size = sum(path.stat().st_size for path in Path(scene).parent.glob("*.webp")) or size
    if suffix == ".ply" and Path(scene).is_file():
        with suppress(InputError, OSError):  # Whoever reads the scene will say what is wrong with it.
            suffix = ".compressed.ply" if is_compressed(read_header(Path(scene))) else ".ply"
    return BYTES_PER_SCENE_BYTE * _EXPANSION[suffix] * size


def free_bytes() -> float:
    """Memory that is free on this machine and within the limits of its container; infinite where nobody says."""
    found = []
    try:
        with Path("/proc/meminfo").open(encoding="ascii") as file:
            found += [1024 * int(line.split()[1]) for line in file if line.startswith("MemAvailable:")]
    except (OSError, ValueError):
        if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
            found.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for limit, usage in _CGROUP:
        try:
            found.append(int(Path(limit).read_text()) - int(Path(usage).read_text()))
        except (OSError, ValueError):
            continue
    return float(min(found, default=float("inf")))
