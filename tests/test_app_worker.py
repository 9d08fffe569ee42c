"""Tests of the thread in which the app works."""

import threading

from gaussian_trimmer.app.jobs import Worker


def finish(worker):
    done = threading.Event()
    worker.submit(done.set)
    assert done.wait(10)


def test_jobs_are_done_in_order_and_one_that_fails_stops_none(capsys):
    seen, worker = [], Worker()
    for number in range(50):
        worker.submit(lambda number=number: seen.append(number))
    worker.submit(lambda: [][1])
    worker.submit(lambda: seen.append(50))
    finish(worker)
    worker.stop()
    assert seen == list(range(51))
    assert "IndexError" in capsys.readouterr().err


def test_cancelling_concerns_the_present_job_alone():
    begun, seen, worker = threading.Event(), [], Worker()

    def long():
        begun.set()
        while not worker.cancelled():
            threading.Event().wait(0.01)
        seen.append("stopped")

    worker.cancel()  # nothing is being done: no later job is meant
    worker.submit(long)
    worker.submit(lambda: seen.append(worker.cancelled()))
    assert begun.wait(10)
    worker.cancel()
    finish(worker)
    worker.stop()
    assert seen == ["stopped", False]


def test_stopping_ends_the_present_job_and_drops_the_others():
    begun, seen, worker = threading.Event(), [], Worker()

    def long():
        begun.set()
        while not worker.cancelled():
            threading.Event().wait(0.01)

    worker.submit(long)
    worker.submit(lambda: seen.append("never"))
    assert begun.wait(10)
    worker.stop()
    for submit in (worker.submit, worker.submit_if_idle):
        submit(lambda: seen.append("after the end"))
    assert not worker.busy and not seen


def test_a_job_that_gives_way_is_dropped_or_cancelled_by_later_ones():
    begun, go_on, seen, worker = threading.Event(), threading.Event(), [], Worker()
    worker.submit(lambda: go_on.wait(10))
    worker.submit_if_idle(lambda: seen.append("dropped"))
    worker.submit(lambda: seen.append("first"))
    go_on.set()
    finish(worker)

    def long():
        begun.set()
        while not worker.cancelled():
            threading.Event().wait(0.01)
        seen.append("cancelled")

    worker.submit_if_idle(long)
    assert begun.wait(10)
    worker.submit(lambda: seen.append("second"))
    worker.submit_if_idle(lambda: seen.append("done"))
    worker._thread.submit(go_on.clear).result(10)
    worker.stop()
    assert seen == ["first", "cancelled", "second", "done"]
