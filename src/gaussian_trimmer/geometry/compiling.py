"""How kernels are compiled: kept on disk where Numba finds a folder that it may write to."""

from __future__ import annotations

import numba


def _can_cache() -> bool:
    """Return whether compiled code can be kept: Numba refuses the decorator where no folder for it is writable."""
    try:
        numba.njit(cache=True)(_can_cache)
    except RuntimeError:
        return False
    return True


CACHE = _can_cache()
"""Whether Numba keeps compiled kernels on disk; they are compiled in every process where it cannot."""
