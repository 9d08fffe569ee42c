"""How kernels are compiled, and how they run side by side.

Kernels are plain loops over a share of the work, called from Python threads; they release the interpreter's lock. Loops
that Numba makes parallel take three times as long to compile, and may abort where two threads enter them at once.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import numba


def _can_cache() -> bool:
    """Whether compiled code can be kept: Numba refuses the decorator where no folder for it is writable."""
    try:
        numba.njit(cache=True)(_can_cache)
    except RuntimeError:
        return False
    return True


CACHE = _can_cache()
"""Whether Numba keeps compiled kernels on disk; they are compiled in every process where it cannot."""


WORTH_A_THREAD = 8192
"""Gaussians from which on another thread saves more than it takes to wake it, where each is little work."""


def side_by_side(work: Callable[[int, int], Any], n: int, at_most: int | None = None, at_least: int = 1) -> None:
    """Call work(first, last) for shares that together are the range from 0 to n, on as many threads as Numba is given.

    Args:
        work: called with where a share begins and ends; it calls no `side_by_side` itself.
        n: size of the work.
        at_most: size of the largest share; None: there is one share a thread.
        at_least: size of the smallest share that is worth a thread.
    """
    threads = numba.get_num_threads()
    size = max(-(-n // threads), at_least)
    if at_most is not None:
        size = min(size, at_most)
    shares = [(first, min(first + size, n)) for first in range(0, n, size)]
    if threads == 1 or len(shares) <= 1:
        for share in shares:
            work(*share)
        return
    others = [_pool(threads).submit(work, *share) for share in shares[1:]]
    work(*shares[0])
    for other in others:
        other.result()


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Threads beside the calling one."""
    return ThreadPoolExecutor(threads - 1, "gaussian-trimmer")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # Threads do not outlive a fork.
