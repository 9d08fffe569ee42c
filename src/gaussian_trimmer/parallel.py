"""Kernels and threads: shares of one loop, and whole pieces of work such as objects.

Kernels are plain loops over a share of the work, called from Python threads; they release the interpreter's lock. Loops
that Numba makes parallel take three times as long to compile, and may abort where two threads enter them at once. What
is compiled is kept on disk where Numba finds a folder that it may write to, and that has room.
"""

from __future__ import annotations

import logging
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache
from itertools import chain, islice
from typing import Any, TypeVar

Made = TypeVar("Made")
WORTH_A_THREAD = 8192
"""Number of Gaussians from which another thread saves more time than waking it takes, where each is little work."""
_IN_CACHE = 1 << 14
"""Number of Gaussians whose columns stay in a processor's cache from one NumPy call to the next."""


def parallel_for(work: Callable[[int, int], Any], n: int, at_most: int | None = None, at_least: int = 1) -> None:
    """Call work(first, last) for shares that together are the range from 0 to n, on as many threads as Numba is given.

    Args:
        work: called with where a share begins and ends. What it calls in turn is done in its own thread.
        n: size of the work.
        at_most: size of the largest share; None: there is one share a thread.
        at_least: size of the smallest share that is worth a thread.
    """
    largest = at_most or max(n, 1)
    if n <= min(at_least, largest) or getattr(_here, "in_share", False):
        threads = 1  # Asking for their number takes as long as a little work.
    else:
        threads = _numba().get_num_threads()
    size = min(max(-(-n // threads), at_least), largest)
    shares = [(first, min(first + size, n)) for first in range(0, n, size)]
    if threads == 1 or len(shares) <= 1:
        for share in shares:
            work(*share)
        return

    def alone(first: int, last: int) -> None:
        _here.in_share = True
        try:
            work(first, last)
        finally:
            _here.in_share = False

    others = [_loop_threads().submit(alone, *share) for share in shares[1:]]
    alone(*shares[0])
    for other in others:
        other.result()


def for_each(work: Callable[[Any], Made], items: Sequence[Any]) -> list[Made]:
    """Return what work(item) returns for each of some items, found on as many threads as Numba is given."""
    found = list[Any]([None] * len(items))

    def share(first: int, last: int) -> None:
        for place in range(first, last):
            found[place] = work(items[place])

    parallel_for(share, len(items))
    return found


def in_shares(work: Callable[[slice], Made], n: int) -> list[Made]:
    """Return what work(rows) returns for each share of n rows, in order; the shares do not depend on the threads.

    Args:
        work: called with a slice of the rows; at least once, where there are none with an empty one.
        n: number of rows.
    """
    return for_each(work, [slice(first, min(first + _IN_CACHE, n)) for first in range(0, max(n, 1), _IN_CACHE)])


def parallel_map(work: Callable[..., Made], *items: Iterable[Any]) -> Iterator[Made]:
    """Like `map`, but computed ahead on as many threads as Numba is given; those left over are for loops within.

    It is for pieces whose work is mostly Python's, such as objects and parts of a scene; views are drawn together.

    Args:
        work: called with one element of each of the items.
        items: what the work is done for, as many of each.
    """
    threads = _numba().get_num_threads()
    if threads == 1 or getattr(_here, "in_worker_thread", False):
        yield from map(work, *items)
        return
    pieces = zip(*items, strict=True)
    ahead = list(islice(pieces, threads))
    if len(ahead) < 2:  # a single piece shares its own work among the threads
        for arguments in ahead:
            yield work(*arguments)
        return
    pool, found = _worker_threads(threads, len(ahead)), deque[Future[Made]]()
    try:
        for arguments in chain(ahead, pieces):
            found.append(pool.submit(work, *arguments))
            if len(found) > len(ahead):
                yield found.popleft().result()
        while found:
            yield found.popleft().result()
    finally:
        wait([unwanted for unwanted in found if not unwanted.cancel()])  # nothing goes on after an exception


def compiled(**options: Any) -> Any:
    """Return the decorator that compiles a kernel by options of `numba.njit`, and keeps it where that can be."""
    return _numba().njit(cache=keeps_kernels(), **options)


@cache
def keeps_kernels() -> bool:
    """Whether Numba keeps compiled kernels on disk; they are compiled in every process where it cannot.

    It refuses the decorator where no folder for them is writable. Kernels that cannot be kept, say because the disk is
    full, are used all the same: that is said once, and keeping them given up.
    """
    from numba.core.caching import FunctionCache

    save: Callable[..., None] = FunctionCache.save_overload

    def save_where_possible(kept: Any, signature: Any, kernel: Any) -> None:
        try:
            save(kept, signature, kernel)
        except OSError as error:
            FunctionCache.save_overload = lambda *_: None  # type: ignore[method-assign, unused-ignore]
            logging.getLogger(__name__).warning(
                "Compiled kernels cannot be kept in '%s': %s. Every run compiles them again until that is mended.",
                kept.cache_path,
                error.strerror or str(error),
            )

    FunctionCache.save_overload = save_where_possible  # type: ignore[method-assign, unused-ignore]
    try:
        _numba().njit(cache=True)(save_where_possible)
    except RuntimeError:
        return False
    return True


def _numba() -> Any:
    import numba  # takes a third of a second, and conversions need none of it

    return numba


@cache
def _loop_threads() -> ThreadPoolExecutor:
    """Threads for shares of loops, beside those that begin these loops."""
    return ThreadPoolExecutor(max(1, _numba().config.NUMBA_NUM_THREADS - 1), "gaussian-trimmer")


@cache
def _worker_threads(threads: int, at_once: int) -> ThreadPoolExecutor:
    """Threads that do whole pieces of work each. They are not those of `parallel_for`, for which they may wait."""

    def prepare() -> None:
        _here.in_worker_thread = True
        _numba().set_num_threads(max(1, threads // at_once))  # of this thread alone

    return ThreadPoolExecutor(at_once, "gaussian-trimmer-pieces", prepare)


_here = threading.local()


def _forget_threads() -> None:
    _loop_threads.cache_clear()
    _worker_threads.cache_clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_threads)  # Threads do not outlive a fork.
