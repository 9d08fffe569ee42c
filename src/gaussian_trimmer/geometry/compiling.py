"""How kernels are compiled, and that one parallel kernel runs at a time."""

from __future__ import annotations

import threading

import numba

KERNEL_LOCK = threading.Lock()
"""Held while a parallel kernel runs: Numba's fallback threading layer aborts the process on concurrent entry."""


def _can_cache() -> bool:
    """Whether compiled code can be kept: Numba refuses the decorator where no folder for it is writable."""
    try:
        numba.njit(cache=True)(_can_cache)
    except RuntimeError:
        return False
    return True


CACHE = _can_cache()
"""Whether Numba keeps compiled kernels on disk; they are compiled in every process where it cannot."""
