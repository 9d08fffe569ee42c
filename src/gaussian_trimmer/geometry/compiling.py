"""How kernels are compiled: kept on disk where Numba finds a folder that it may write to, and that has room."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import numba
from numba.core.caching import FunctionCache


def _can_cache() -> bool:
    """Return whether compiled code can be kept: Numba refuses the decorator where no folder for it is writable."""
    try:
        numba.njit(cache=True)(_can_cache)
    except RuntimeError:
        return False
    return True


def _go_on_without_room() -> None:
    """Have Numba use kernels that it cannot keep, say because the disk is full: that is said once, and given up."""
    save: Callable[..., None] = FunctionCache.save_overload

    def save_where_possible(kept: Any, signature: Any, compiled: Any) -> None:
        try:
            save(kept, signature, compiled)
        except OSError as error:
            FunctionCache.save_overload = lambda *_: None  # type: ignore[method-assign, unused-ignore]
            logging.getLogger(__name__).warning(
                "Compiled kernels cannot be kept in '%s': %s. Every run compiles them again until that is mended.",
                kept.cache_path,
                error.strerror or str(error),
            )

    FunctionCache.save_overload = save_where_possible  # type: ignore[method-assign, unused-ignore]


_go_on_without_room()
CACHE = _can_cache()
"""Whether Numba keeps compiled kernels on disk; they are compiled in every process where it cannot."""
