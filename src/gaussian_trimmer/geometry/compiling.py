"""How kernels are compiled, and how they run side by side.

Kernels are plain loops over a share of the work, called from Python threads; they release the interpreter's lock. Loops
that Numba makes parallel take three times as long to compile, and may abort where two threads enter them at once.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache
from typing import Any, TypeVar

import numba

Made = TypeVar("Made")
_MOST_AT_ONCE = 4
"""Pieces of work that `map_side_by_side` does at once, since each takes the memory of a view."""


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


def map_side_by_side(work: Callable[..., Made], *items: Iterable[Any]) -> Iterator[Made]:
    """Like `map`, but found ahead on a few threads, among which those of `side_by_side` are shared.

    A whole view on each thread keeps two cores twice as busy as halves of one view do: less of the work is Python's.
    """
    threads = numba.get_num_threads()
    if threads == 1 or getattr(_here, "is_one_of_many", False):
        yield from map(work, *items)
        return
    pool, found = _pool_of_many(threads), deque[Future[Made]]()
    try:
        for arguments in zip(*items, strict=True):
            found.append(pool.submit(work, *arguments))
            if len(found) > _MOST_AT_ONCE:
                yield found.popleft().result()
        while found:
            yield found.popleft().result()
    finally:
        wait([unwanted for unwanted in found if not unwanted.cancel()])  # nothing goes on after an exception


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Threads beside the calling one."""
    return ThreadPoolExecutor(threads - 1, "gaussian-trimmer")


@cache
def _pool_of_many(threads: int) -> ThreadPoolExecutor:
    """Threads that do whole pieces of work each. They are not those of `side_by_side`, for which they may wait."""
    at_once = min(threads, _MOST_AT_ONCE)

    def prepare() -> None:
        _here.is_one_of_many = True
        numba.set_num_threads(max(1, threads // at_once))  # of this thread alone

    return ThreadPoolExecutor(at_once, "gaussian-trimmer-views", prepare)


_here = threading.local()


def _forget_threads() -> None:
    _pool.cache_clear()
    _pool_of_many.cache_clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_threads)  # Threads do not outlive a fork.
