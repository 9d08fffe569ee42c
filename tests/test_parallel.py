"""Shares and pieces of work on several threads: complete, in order, and over once one of them fails."""

import os
import subprocess
import sys
import threading
import time

import numba
import pytest

from gaussian_trimmer import parallel
from gaussian_trimmer.parallel import parallel_for, parallel_map


@pytest.mark.parametrize(("threads", "n", "at_most"), [(1, 7, None), (2, 7, None), (4, 3, None), (2, 10, 3), (2, 0, 5)])
def test_shares_are_the_whole_range(threads, n, at_most):
    before, shares = numba.get_num_threads(), []
    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
    try:
        parallel_for(lambda first, last: shares.append((first, last)), n, at_most)
    finally:
        numba.set_num_threads(before)
    assert [place for share in sorted(shares) for place in range(*share)] == list(range(n))
    assert all(last - first <= (at_most or n) for first, last in shares)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(("n", "starts"), [(7, [0, 3, 6]), (3, [0]), (0, [0])])
def test_what_shares_of_rows_give_is_in_order_whatever_the_threads(monkeypatch, threads, n, starts):
    monkeypatch.setattr(numba, "get_num_threads", lambda: threads)
    monkeypatch.setattr(parallel, "_IN_CACHE", 3)
    found = parallel.in_shares(lambda rows: (rows.start, list(range(n))[rows]), n)
    assert [start for start, _ in found] == starts
    assert [place for _, places in found for place in places] == list(range(n))


def test_an_error_in_any_share_is_raised(monkeypatch):
    monkeypatch.setattr(numba, "get_num_threads", lambda: 3)

    def work(first, last):
        if last == 3:
            raise ValueError("the last share")

    with pytest.raises(ValueError, match="the last share"):
        parallel_for(work, 3)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="There is no fork here.")
def test_shares_are_worked_on_after_a_fork():
    code = (
        "import os\n"
        "from gaussian_trimmer.parallel import parallel_for\n"
        "parallel_for(lambda first, last: None, 8)\n"
        "if os.fork() == 0:\n"
        "    parallel_for(lambda first, last: None, 8)\n"
        "    os._exit(7)\n"
        "print(os.waitstatus_to_exitcode(os.wait()[1]))"
    )
    environment = {**os.environ, "NUMBA_NUM_THREADS": "2"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60)
    assert done.stdout == "7\n", done.stderr


@pytest.fixture
def two_threads():
    before = numba.get_num_threads()
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("Numba was started with one thread.")
    numba.set_num_threads(2)
    yield
    numba.set_num_threads(before)


def test_what_is_found_ahead_comes_in_order_on_several_threads(two_threads):
    names = set()

    def work(first, second):
        time.sleep(0.01 * (first % 3))
        names.add(threading.current_thread().name)
        inner = list(parallel_map(str, "ab"))  # goes on in the same thread
        return first * second, inner, numba.get_num_threads()

    found = list(parallel_map(work, range(12), range(12)))
    assert found == [(i * i, ["a", "b"], 1) for i in range(12)]
    assert len(names) == 2 and threading.current_thread().name not in names


def test_an_exception_ends_the_others_before_it_is_seen(two_threads):
    running = []

    def work(item):
        running.append(item)
        time.sleep(0.02)
        if item == 1:
            raise ValueError(item)
        running.remove(item)

    with pytest.raises(ValueError, match="1"):
        list(parallel_map(work, range(50)))
    before = list(running)
    time.sleep(0.1)
    assert running == before == [1]
    with pytest.raises(ValueError, match="argument"):
        list(parallel_map(max, range(2), range(3)))
