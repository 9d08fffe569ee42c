"""Tests of what is to be seen after an event, laws of pure functions, and of the thread in which the app works."""

import threading
from itertools import product
from types import SimpleNamespace

import pytest

from gaussian_trimmer.app.jobs import Worker
from gaussian_trimmer.app.viewpoints import (
    COLOURINGS,
    PARTS,
    WHENS,
    Event,
    Showing,
    due_after,
    showing_after,
)

SHOWINGS = [Showing(*values) for values in product(PARTS, WHENS, COLOURINGS)]


NONE, FRESH, STALE = STATES = ((None, False), ("result", False), ("result", True))
"""The trim of an object, and whether it was marked since."""


def now(state, n_selected=5):
    """What of a snapshot is looked at."""
    return SimpleNamespace(object=SimpleNamespace(result=state[0], stale=state[1], n_selected=n_selected))


@pytest.mark.parametrize("shown", SHOWINGS)
@pytest.mark.parametrize("state", STATES)
def test_undoing_cuts_nothing_out_and_tints_and_changes_stay(shown, state):
    then = showing_after(Event.STEPPED, now(state), shown)
    assert then.colours == shown.colours and then.when == shown.when
    assert then.part == ("Everything" if shown.part == "Scene without it" and state == NONE
                         else shown.part)  # fmt: skip
    assert due_after(Event.STEPPED, now(state), then, True) is False
    assert due_after(Event.CUT_OUT, now(state), then, True) is False


@pytest.mark.parametrize("shown", SHOWINGS)
def test_a_mark_shows_what_it_did_and_corrects_what_is_seen_cut_out(shown):
    then = showing_after(Event.MARKED, now(STALE), shown)
    assert then.part == shown.part and then.when == shown.when
    assert then.colours == ("Changes" if shown.when == "Cut-out" or shown.part == "Object" else "Objects")
    due = due_after(Event.MARKED, now(STALE), then, False)
    assert due == (shown.when == "Cut-out")
    first = showing_after(Event.MARKED, now(NONE), shown)
    assert first.when == "Selection"
    assert due_after(Event.MARKED, now(NONE), first, False) is False


@pytest.mark.parametrize("shown", SHOWINGS)
def test_what_is_asked_for_is_seen(shown):
    assert showing_after(Event.OPENED, now(FRESH), shown) == Showing("Everything", "Selection", "Objects")
    assert showing_after(Event.CUT_OUT, now(FRESH), shown) == Showing("Object", "Cut-out", "Own")
    assert showing_after(Event.TAKEN_OUT, now(FRESH), shown) == Showing("Everything", "Cut-out", "Own")
    chosen = showing_after(Event.PART_CHOSEN, now(FRESH), shown)
    assert chosen.part == shown.part
    assert chosen.colours == ("Objects" if shown.part == "Everything" else "Own")  # a tint would hide the edge
    assert chosen.when == ("Cut-out" if shown.part == "Scene without it" else shown.when)
    assert due_after(Event.PART_CHOSEN, now(STALE), chosen, True) is True
    empty = showing_after(Event.STEPPED, now(NONE, 0), shown)
    assert empty.part == "Everything" and empty == (shown if shown.part == "Everything" else Showing())


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
