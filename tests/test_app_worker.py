"""Tests of the thread in which the app works."""

import threading

from gaussian_trimmer.app.worker import Worker


def finish(worker):
    done = threading.Event()
    worker.submit("last", done.set)
    assert done.wait(10)


def test_jobs_are_done_in_order_and_one_at_a_time():
    seen, running = [], []

    def job(number):
        running.append(number)
        assert len(running) == 1
        seen.append(number)
        running.remove(number)

    worker = Worker(lambda name, error: seen.append(error))
    for number in range(50):
        worker.submit(f"job {number}", lambda number=number: job(number))
    finish(worker)
    worker.stop()
    assert seen == list(range(50))


def test_an_error_is_told_and_the_next_job_is_done():
    errors = []
    worker = Worker(lambda name, error: errors.append((name, str(error))))
    worker.submit("bad", lambda: [][1])
    finish(worker)
    worker.stop()
    assert errors == [("bad", "list index out of range")]


def test_cancelling_concerns_the_present_job_alone():
    begun, seen = threading.Event(), []
    worker = Worker(lambda name, error: seen.append(error))

    def long():
        begun.set()
        while not worker.cancelled():
            threading.Event().wait(0.01)
        seen.append(worker.doing)

    worker.cancel()  # nothing is being done: no later job is meant
    worker.submit("long", long)
    worker.submit("after", lambda: seen.append(worker.cancelled()))
    assert begun.wait(10)
    worker.cancel()
    finish(worker)
    worker.stop()
    assert seen == ["long", False]
