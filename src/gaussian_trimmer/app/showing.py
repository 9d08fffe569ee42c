"""What is to be seen after each action, and what the app does by itself then: pure functions of event and state."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import Literal, get_args

from gaussian_trimmer.app.snapshots import Snapshot

Part = Literal["Everything", "Object", "Scene without it"]
When = Literal["Selection", "Cut-out"]
Colouring = Literal["Own", "Objects", "Changes"]
PARTS, WHENS, COLOURINGS = get_args(Part), get_args(When), get_args(Colouring)
"""As the page names them."""


@dataclass(frozen=True)
class Showing:
    """What is to be seen."""

    part: Part = "Everything"
    when: When = "Selection"
    """The selection, or the cut-out; an object that has not been cut out is shown as it is selected."""
    colours: Colouring = "Objects"
    """Those of the scene, the objects tinted, or what was changed tinted: by the trim, or else by the last marks."""
    ghost: bool = False
    """With the object, the rest is there, grey and seen through, and can be marked."""


class Event(Enum):
    """What has just been done."""

    OPENED = "a scene, a project or a selection was opened, or objects were found"
    MARKED = "the active object was marked"
    CUT_OUT = "the active object was cut out"
    PART_CHOSEN = "another part is to be seen"
    STEPPED = "a step was undone or redone, the object cleared, or another one chosen"


def showing_after(event: Event, now: Snapshot, showing: Showing) -> Showing:
    """Return what is to be seen after an event; tints and changes stay until something else is asked for.

    Args:
        event: what has been done.
        now: the state after it.
        showing: what was seen before, or what has just been chosen.
    """
    selected, cut = now.object.n_selected > 0, now.object.result is not None
    match event:
        case Event.OPENED:
            return Showing()
        case Event.MARKED:
            corrected = showing.when == "Cut-out" and cut
            colours: Colouring = "Changes" if corrected or showing.part == "Object" else "Objects"
            return replace(showing, when="Cut-out" if corrected else "Selection", colours=colours)
        case Event.CUT_OUT:  # in its own colours: a tint would hide what is wrong at the edge
            return Showing("Object", "Cut-out", "Own")
        case Event.PART_CHOSEN:
            colours = "Objects" if showing.part == "Everything" else "Own"
            when: When = "Cut-out" if showing.part == "Scene without it" and cut else showing.when
            return replace(showing, when=when, colours=colours)
        case Event.STEPPED:
            if not selected:
                return showing if showing.part == "Everything" else Showing()
            return replace(showing, part="Everything") if showing.part == "Scene without it" and not cut else showing


def due_after(event: Event, now: Snapshot, showing: Showing, due: bool) -> bool:
    """Tell whether a correction is to be cut out after an event, when nobody wants anything else; no undoing does that.

    Args:
        event: what has been done.
        now: the state after it.
        showing: what is seen after it.
        due: whether that was so before it.
    """
    if event is Event.PART_CHOSEN:
        return due
    return event is Event.MARKED and now.object.stale and showing.when == "Cut-out"


def compared(showing: Showing) -> tuple[Showing, str]:
    """Return what to compare with what is shown, and its name: selection and cut-out, or the scene with and without."""
    if showing.part == "Object":
        when: When = "Selection" if showing.when == "Cut-out" else "Cut-out"
        return replace(showing, when=when), when
    if showing.part == "Everything":
        return Showing("Scene without it", "Cut-out", "Own"), "Without it"
    return Showing("Everything", "Selection", "Own"), "With it"
