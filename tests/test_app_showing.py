"""Tests of what is to be seen after an event, and what is due then: laws of two pure functions."""

from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import pytest

from gaussian_trimmer.app.showing import (
    COLOURINGS,
    PARTS,
    WHENS,
    Due,
    Event,
    Showing,
    compared,
    due_after,
    showing_after,
)
from gaussian_trimmer.app.snapshots import Cut, CutState

SHOWINGS = [Showing(*values) for values in product(PARTS, WHENS, COLOURINGS)]


def now(state, n_selected=5):
    """What of a snapshot is looked at."""
    part = SimpleNamespace(cut=Cut(state, "result" if state in (CutState.FRESH, CutState.STALE) else None))
    part.n_selected = n_selected
    return SimpleNamespace(object=part, objects=(part,))


@pytest.mark.parametrize("shown", SHOWINGS)
@pytest.mark.parametrize("state", CutState)
def test_undoing_cuts_nothing_out_and_tints_and_changes_stay(shown, state):
    then = showing_after(Event.STEPPED, now(state), shown)
    assert then.colours == shown.colours and then.when == shown.when
    assert then.part == ("Everything" if shown.part == "Scene without it" and state in (CutState.NONE, CutState.WANTED)
                         else shown.part)  # fmt: skip
    assert due_after(Event.STEPPED, now(state), then, Due.CORRECTION) is Due.NOTHING
    assert due_after(Event.CUT_OUT, now(state), then, Due.CORRECTION) is Due.NOTHING


@pytest.mark.parametrize("shown", SHOWINGS)
def test_a_mark_shows_what_it_did_and_corrects_what_is_seen_cut_out(shown):
    then = showing_after(Event.MARKED, now(CutState.STALE), shown)
    assert then.part == shown.part and then.when == shown.when
    assert then.colours == ("Changes" if shown.when == "Cut-out" or shown.part == "Object" else "Objects")
    due = due_after(Event.MARKED, now(CutState.STALE), then, Due.NOTHING)
    assert due is (Due.CORRECTION if shown.when == "Cut-out" else Due.NOTHING)
    first = showing_after(Event.MARKED, now(CutState.NONE), shown)
    assert first.when == "Selection"
    assert due_after(Event.MARKED, now(CutState.NONE), first, Due.NOTHING) is Due.NOTHING


@pytest.mark.parametrize("shown", SHOWINGS)
def test_what_is_asked_for_is_seen(shown):
    assert showing_after(Event.OPENED, now(CutState.FRESH), shown) == Showing("Everything", "Selection", "Objects")
    assert showing_after(Event.CUT_OUT, now(CutState.FRESH), shown) == Showing("Object", "Cut-out", "Own")
    chosen = showing_after(Event.PART_CHOSEN, now(CutState.FRESH), shown)
    assert chosen.part == shown.part
    assert chosen.colours == ("Objects" if shown.part == "Everything" else "Own")  # a tint would hide the edge
    assert chosen.when == ("Cut-out" if shown.part == "Scene without it" else shown.when)
    assert due_after(Event.PART_CHOSEN, now(CutState.STALE), chosen, Due.CORRECTION) is Due.CORRECTION
    empty = showing_after(Event.STEPPED, now(CutState.NONE, 0), shown)
    assert empty.part == "Everything" and empty == (shown if shown.part == "Everything" else Showing())


def test_work_of_last_time_is_due_until_it_is_done():
    wanted = now(CutState.WANTED)
    due = due_after(Event.OPENED, wanted, Showing(), Due.NOTHING)
    assert due is Due.WORK_OF_LAST_TIME
    for event in (Event.MARKED, Event.STEPPED, Event.PART_CHOSEN):
        assert due_after(event, wanted, Showing(), due) is due
    assert due_after(Event.STEPPED, wanted, Showing(), Due.NOTHING) is Due.NOTHING  # it was cancelled, or failed
    assert due_after(Event.STEPPED, now(CutState.NONE), Showing(), due) is Due.NOTHING  # it was undone


@pytest.mark.parametrize("shown", SHOWINGS)
def test_selection_and_cut_out_or_the_scene_with_and_without_are_compared(shown):
    other, name = compared(shown)
    if shown.part == "Object":
        assert other == replace(shown, when={"Selection": "Cut-out", "Cut-out": "Selection"}[shown.when])
        assert name == {"Selection": "Selection", "Cut-out": "Cut-out"}[other.when]
    else:
        assert {shown.part, other.part} == {"Everything", "Scene without it"}
        assert name == {"Everything": "With it", "Scene without it": "Without it"}[other.part]
