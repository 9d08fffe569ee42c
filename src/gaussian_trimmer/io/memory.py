"""How much memory this machine has, within the limits of a container."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

TRIM_BYTES_PER_SCENE_BYTE = 3.5
"""What a trim takes at most for each byte of the scene as arrays; measured, see docs/batch.md."""
_CONTAINER_LIMITS = (
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
    ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
)


def total_bytes() -> float:
    """Return the memory of this machine or container, in use or not; infinity where nobody says."""
    found = []
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        found.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for limit, _ in _CONTAINER_LIMITS:
        with suppress(OSError, ValueError):
            found.append(int(Path(limit).read_text()))
    return float(min(found, default=float("inf")))


def free_bytes() -> float:
    """Return the memory that is free on this machine and within its container; infinity where nobody says."""
    found: list[float] = []
    try:
        with Path("/proc/meminfo").open(encoding="ascii") as file:
            found += [1024 * int(line.split()[1]) for line in file if line.startswith("MemAvailable:")]
    except (OSError, ValueError):
        found.append(total_bytes())
    for limit, usage in _CONTAINER_LIMITS:
        with suppress(OSError, ValueError):
            found.append(int(Path(limit).read_text()) - int(Path(usage).read_text()))
    return float(min(found, default=float("inf")))
